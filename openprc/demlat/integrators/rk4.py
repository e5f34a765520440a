"""The classical fourth-order Runge-Kutta scheme, a block of frames in one compiled call.

Positions and velocities advance together, ``k_x`` being the *stage's* velocity: with the
velocity of the step's start the scheme would be of first order and feed energy into every
mode. Driven axes, and forces, are evaluated at every stage's own time. Work and loss are two
more unknowns of the same system, so the energy balance is of fourth order as well.

Stability: see `openprc.demlat.stability`.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba  # noqa: TID253 - compiling is what this file is for

from openprc.demlat import signals
from openprc.demlat.models.barhinge import kernels, laws, tables
from openprc.demlat.models.barhinge.tables import (
    BarTable,
    Drives,
    FrameBuffer,
    HingeTable,
    NodeTable,
    Reals,
    Work,
)
from openprc.demlat.signals import SignalTable

body_forces = kernels.body_forces
add_actuator_forces = kernels.add_actuator_forces
place_driven = kernels.place_driven
jumps_at = kernels.jumps_at
potential_energy = kernels.potential_energy
kinetic_energy = kernels.kinetic_energy
jit = kernels.jit


@jit
def reaction_power(v: Reals, force: Reals, nodes: NodeTable) -> float:
    """Return the power [W] that holds the driven axes on course against the body's forces."""
    power = 0.0
    for i in range(nodes.mass.size):
        for a in range(3):
            if nodes.driven[i, a]:
                power -= force[i, a] * v[i, a]
    return power


@jit
def step(
    x: Reals,
    v: Reals,
    ledger: Reals,
    work: Work,
    nodes: NodeTable,
    bars: BarTable,
    hinges: HingeTable,
    drives: Drives,
    table: SignalTable,
    t: float,
    h: float,
) -> None:
    """Advance `x`, `v` and `ledger` (work in, dissipated) in place from `t` to ``t + h``."""
    n = nodes.mass.size
    work_in = 0.0
    dissipated = 0.0
    for stage in range(4):
        share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
        if stage == 0:
            for i in range(n):
                for a in range(3):
                    work.stage_x[i, a] = x[i, a]
                    work.stage_v[i, a] = v[i, a]
                    work.sum_x[i, a] = 0.0
                    work.sum_v[i, a] = 0.0
        else:
            # work.force and work.stage_v still hold the derivative of the stage before.
            for i in range(n):
                for a in range(3):
                    acceleration = work.force[i, a] * nodes.inverse_mass[i, a]
                    work.stage_x[i, a] = x[i, a] + share * h * work.stage_v[i, a]
                    work.stage_v[i, a] = v[i, a] + share * h * acceleration
        stage_t = t + share * h
        place_driven(work.stage_x, work.stage_v, drives, table, stage_t, t, t + h)
        loss = body_forces(work.stage_x, work.stage_v, work.force, nodes, bars, hinges)
        power = reaction_power(work.stage_v, work.force, nodes)
        power += add_actuator_forces(work.stage_v, work.force, drives, table, stage_t, t, t + h)
        work_in += weight * power
        dissipated += weight * loss
        for i in range(n):
            for a in range(3):
                work.sum_x[i, a] += weight * work.stage_v[i, a]
                work.sum_v[i, a] += weight * work.force[i, a] * nodes.inverse_mass[i, a]
    for i in range(n):
        for a in range(3):
            x[i, a] += h * work.sum_x[i, a]
            v[i, a] += h * work.sum_v[i, a]
    place_driven(x, v, drives, table, t + h, t, t + h)
    ledger[0] += h * work_in
    ledger[1] += h * dissipated


@jit
def first_escaped(x: Reals, limit: float) -> int:
    """Return the first node with a coordinate that is not below `limit` [m], or -1."""
    for i in range(x.shape[0]):
        for a in range(3):
            if not abs(x[i, a]) < limit:  # also true for NaN
                return i
    return -1


@jit
def save_frame(
    row: int,
    x: Reals,
    v: Reals,
    ledger: Reals,
    nodes: NodeTable,
    bars: BarTable,
    hinges: HingeTable,
    out: FrameBuffer,
) -> None:
    """Copy the state and its energies into row `row` of `out`."""
    for i in range(x.shape[0]):
        for a in range(3):
            out.x[row, i, a] = x[i, a]
            out.v[row, i, a] = v[i, a]
    out.kinetic[row] = kinetic_energy(v, nodes, False)
    out.potential[row] = potential_energy(x, nodes, bars, hinges)
    # What moves the driven masses themselves also comes from the actuators.
    out.work_in[row] = ledger[0] + kinetic_energy(v, nodes, True)
    out.dissipated[row] = ledger[1]


def _compile(function: Callable[..., Any]) -> Callable[..., Any]:
    try:
        compiled: Callable[..., Any] = numba.njit(error_model="numpy", cache=True)(function)
    except RuntimeError:
        # There is no folder in which the compiled code could be kept.
        compiled = numba.njit(error_model="numpy")(function)
    return compiled


# numba keys its cache on the bytecode of a function and on what it closes over, not on the
# functions that it calls. Closing over a stamp of their source makes an edit there count.


def _build_begin(source_stamp: int) -> Callable[..., Any]:
    def begin(
        x: Reals,
        v: Reals,
        ledger: Reals,
        nodes: NodeTable,
        bars: BarTable,
        hinges: HingeTable,
        drives: Drives,
        table: SignalTable,
        h: float,
        out: FrameBuffer,
    ) -> None:
        _ = source_stamp
        place_driven(x, v, drives, table, 0.0, 0.0, h)
        ledger[0] = -kinetic_energy(v, nodes, True)
        save_frame(0, x, v, ledger, nodes, bars, hinges, out)

    return _compile(begin)


def _build_advance(source_stamp: int) -> Callable[..., Any]:
    def advance(
        x: Reals,
        v: Reals,
        ledger: Reals,
        work: Work,
        nodes: NodeTable,
        bars: BarTable,
        hinges: HingeTable,
        drives: Drives,
        table: SignalTable,
        first_frame: int,
        n_frames: int,
        steps_per_frame: int,
        h: float,
        limit: float,
        out: FrameBuffer,
    ) -> tuple[int, int, int]:
        _ = source_stamp
        for frame in range(n_frames):
            for substep in range(steps_per_frame):
                # From the count of steps: adding up h would drift.
                number = (first_frame + frame) * steps_per_frame + substep
                step(x, v, ledger, work, nodes, bars, hinges, drives, table, number * h, h)
                escaped = first_escaped(x, limit)
                if escaped >= 0:
                    return frame, escaped, number + 1
                # Cross a sample of the signals: from here on the later segment counts.
                t = (number + 1) * h
                if jumps_at(x, drives, table, t, t + h):
                    ledger[0] -= potential_energy(x, nodes, bars, hinges)
                    place_driven(x, v, drives, table, t, t, t + h)
                    ledger[0] += potential_energy(x, nodes, bars, hinges)
                else:
                    place_driven(x, v, drives, table, t, t, t + h)
            save_frame(frame, x, v, ledger, nodes, bars, hinges, out)
        return n_frames, -1, 0

    return _compile(advance)


def _source_stamp() -> int:
    stamp = 0
    for module in (laws, kernels, tables, signals):
        stamp = zlib.crc32(Path(str(module.__file__)).read_bytes(), stamp)
    return zlib.crc32(Path(__file__).read_bytes(), stamp)


#: ``begin(x, v, ledger, nodes, bars, hinges, drives, table, h, out)``: put driven axes in place
#: and save the frame t = 0 in row 0 of `out`.
begin = _build_begin(_source_stamp())
#: ``advance(x, v, ledger, work, nodes, bars, hinges, drives, table, first_frame, n_frames,
#: steps_per_frame, h, limit, out)``: step through `n_frames` frames after `first_frame`,
#: filling `out`. Returns (frames done, -1, 0), or with the node that left the range below
#: `limit` and the number of the step in which it did.
advance = _build_advance(_source_stamp())
