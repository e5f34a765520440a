"""Frames as openprc up to 0.1.1 would have computed them.

What its files hold under the label t is put together of two instants: driven nodes at t, and
free nodes a step later; the state at t = 0 is missing. Here frame k is the state at
``k * save_interval``, as everywhere else. So with ``save_interval = dt`` the frame f of such a
file, for which m steps were taken a frame, is: driven nodes from frame ``f m``, free nodes from
frame ``f m + 1``.

Positions and velocities have been rounded to float32 twice, before and after they were given
their units, as they were for storing; energies and quantities of elements come from the unrounded
state.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.legacy.body import LegacyScales, legacy_body, legacy_state
from openprc.demlat.models.barhinge.divergence import strained_most
from openprc.demlat.models.barhinge.support import ESCAPE_FACTOR, scene_size
from openprc.demlat.models.barhinge.tables import FrameBuffer
from openprc.demlat.observables import bar_forces, bar_lengths, hinge_angles, hinge_torques
from openprc.errors import Diverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: A block of frames has about this many numbers, ...
BLOCK_NUMBERS = 1 << 19
#: ... and at most about this many steps times elements.
BLOCK_WORK = 4_000_000


def legacy_blocks(experiment: Experiment) -> Iterator[tuple[int, FrameBuffer]]:
    """Integrate, yielding (number of the first frame, block of frames).

    Parameters
    ----------
    experiment : Experiment
        One for which `openprc.demlat.legacy.findings.legacy_refusals` yields nothing.

    Raises
    ------
    Diverged
        When a node leaves the range of plausible positions.
    """
    # Compiled code is loaded when something runs.
    from openprc.demlat.legacy.kernels import advance  # noqa: PLC0415

    scales = LegacyScales.for_experiment(experiment)
    body, sampling = legacy_body(experiment, scales)
    state = legacy_state(experiment, scales)
    n_steps, n_frames = experiment.steps_per_frame, experiment.n_frames
    largest = _frames_a_block(experiment)
    limit = ESCAPE_FACTOR * scene_size(experiment) / float(scales.length)
    h = float(experiment.dt / scales.time)
    time, frame = 0.0, 0
    while frame < n_frames:
        count = min(largest, n_frames - frame)
        # Summed up, because that is where halfway between two samples was decided.
        times = np.cumsum(np.r_[time, np.full(count * n_steps, experiment.dt)])
        time = times[-1]
        x = np.zeros((count, len(body.mass), 3))
        v, ledger = np.zeros_like(x), np.zeros((count, 5))
        rows = sampling.rows(times[:-1])
        done, escaped = advance(body, state, rows, h, n_steps, frame == 0, limit, x, v, ledger)
        if done:
            yield frame, _frames(experiment, scales, x[:done], v[:done], ledger[:done])
        if escaped >= 0:
            raise _diverged(experiment, state.x * float(scales.length), escaped, frame + done)
        frame += count


def _frames_a_block(experiment: Experiment) -> int:
    geometry = experiment.geometry
    numbers = 6 * geometry.n_nodes + 2 * (len(geometry.bars) + len(geometry.hinges)) + 9
    work = geometry.n_nodes + len(geometry.bars) + 4 * len(geometry.hinges)
    work = 4 * experiment.steps_per_frame * work
    return max(1, min(BLOCK_NUMBERS // numbers, BLOCK_WORK // work))


def _frames(
    experiment: Experiment, scales: LegacyScales, x: Reals, v: Reals, ledger: Reals
) -> FrameBuffer:
    geometry = experiment.geometry
    at, speed = x * float(scales.length), v * float(scales.velocity)
    length = bar_lengths(at, geometry.bars)
    angle = hinge_angles(at, geometry.hinges)
    # Hinges with damping are refused, so their rates do not matter.
    moment = hinge_torques(angle, np.zeros_like(angle), geometry.hinges)
    stretch = length - geometry.bars.relaxed_length
    soft = geometry.hinges.stiffness > 0
    energy = np.stack(
        [
            0.5 * np.einsum("n,bna,bna->b", geometry.masses, speed, speed),
            0.5 * np.einsum("m,bm,bm->b", geometry.bars.stiffness, stretch, stretch),
            0.5 * np.sum(moment[:, soft] ** 2 / geometry.hinges.stiffness[soft], axis=1),
            -experiment.gravity[2] * np.einsum("n,bn->b", geometry.masses, at[:, :, 2]),
        ],
        axis=1,
    )
    return FrameBuffer(
        x=_stored(x, scales.length),
        v=_stored(v, scales.velocity),
        length=length,
        tension=bar_forces(at, speed, length, geometry.bars),
        angle=angle,
        moment=moment,
        energy=energy,
        ledger=ledger * float(scales.moment),
    )


def _stored(values: Reals, unit: Any) -> Reals:
    stored: Reals = (values.astype("f4") * unit).astype("f4").astype("f8")
    return stored


def _diverged(experiment: Experiment, positions: Reals, node: int, frame: int) -> Diverged:
    at = f"t = {frame * experiment.save_interval:.6g} s"
    return Diverged(
        f"node {node} left the range of plausible positions by {at}"
        f"{strained_most(experiment, positions, node)}",
        expected=f"coordinates below {ESCAPE_FACTOR * scene_size(experiment):.3g} m",
        fix="use another integrator: 'legacy' feeds energy into every mode whose damping ratio"
        " is less than a quarter of its angular frequency times dt",
        key="simulation.integrator",
    )
