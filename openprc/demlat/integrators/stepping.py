"""The compiled loop over frames and steps, shared by every scheme.

A scheme is a NamedTuple of work arrays; its class decides, when the loop is compiled, which
`step` (fixed step) or which `to_time` (adaptive) is called. A scheme's module says so with
`openprc.demlat.compiled.jit.chosen_by_type`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, entry, jit
from openprc.demlat.contact.hook import OVERFULL, collide, remember
from openprc.demlat.models.barhinge.drive_kernels import driven_energy, jumps_at, place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import observe
from openprc.demlat.models.barhinge.rigid_elements import (
    begin_rigid,
    find_reactions,
    is_constrained,
    observe_rigid,
    take_impact,
)
from openprc.demlat.models.barhinge.tables import BEND_ENERGY, LEDGER_STRIDE, WORK_IN

#: What stands in the place of an escaped coordinate when the scheme could not take a step.
FAILED = -3
#: Steps between two looks at whether a coordinate is still a plausible number.
GUARD_INTERVAL = 100


def step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""


def to_time(scheme: Any, body: Any, state: Any, energy: Any, control: Any, frame: int) -> Any:
    """Advance `state` from `frame` to the next one; return (time, escaped coordinate or -1)."""


def output(scheme: Any, state: Any, control: Any, frame: int) -> Any:
    """Return the positions, velocities and ledger of `frame`, to be saved."""


def failed(scheme: Any, body: Any) -> bool:
    """Say whether the last step could not be taken; for schemes with the mark ``can_fail``."""


@chosen_by_type(failed)
def _never_fails(scheme, body):
    if getattr(scheme.instance_class, "can_fail", False):
        return None
    return lambda scheme, body: False


@jit
def first_escaped(x: Any, limit: float) -> int:
    """Return the first coordinate that is not below `limit`, or -1."""
    for at in range(x.size):
        if not abs(x[at]) < limit:  # also true for NaN
            return at
    return -1


@jit
def total(energy: Any, row: int) -> float:
    """Return the sum over the lanes of a row."""
    result = 0.0
    for lane in range(LEDGER_STRIDE):
        result += energy[row * LEDGER_STRIDE + lane]
    return result


def energy_of_bends(body: Any, energy: Any) -> float:
    """Return what `observe` found for bends; 0 where the scene has none, and no row for them."""


@chosen_by_type(energy_of_bends)
def _energy_of_bends(body, energy):
    if len(dict(zip(body.fields, body.types, strict=True))["bends"]) == 0:
        return lambda body, energy: 0.0
    return lambda body, energy: total(energy, BEND_ENERGY)


@jit
def potential(body: Any, x: Any, v: Any, energy: Any) -> float:
    """Return the potential energy."""
    observe(body, x, v, energy)
    return total(energy, 1) + total(energy, 2) + total(energy, 3) + energy_of_bends(body, energy)


def cross_knot(body: Any, state: Any, energy: Any, t: float, t_to: float) -> None:
    """Hand driven coordinates over to the segments that begin at `t`.

    A held signal moves its coordinates at once; the elastic energy that this takes or gives is
    the actuator's work. Where no energies are kept, `energy` is None. Scenes with constraints
    have no such jumps.
    """


@chosen_by_type(cross_knot)
def _cross_knot(body, state, energy, t, t_to):
    if isinstance(energy, types.NoneType) or is_constrained(body):

        def place_only(body, state, energy, t, t_to):
            place_driven(body.drives, state.x, state.v, t, t, t_to)

        return place_only

    def place_and_book(body, state, energy, t, t_to):
        if jumps_at(body.drives, state.x, t, t_to):
            before = potential(body, state.x, state.v, energy)
            place_driven(body.drives, state.x, state.v, t, t, t_to)
            after = potential(body, state.x, state.v, energy)
            state.ledger[WORK_IN * LEDGER_STRIDE] += after - before
        else:
            place_driven(body.drives, state.x, state.v, t, t, t_to)

    return place_and_book


@jit
def save_frame(
    body: Any, x: Any, v: Any, ledger: Any, energy: Any, scale: Any, row: int, buffer: Any
) -> None:
    """Copy the state and what is derived from it into a row of the frame buffer."""
    observe(body, x, v, energy)
    observe_rigid(body, x)
    length, velocity, force, moment, joule = scale
    for a in range(len(body.space)):
        for n in range(buffer.x.shape[1]):
            buffer.x[row, n, a] = length * x[a * body.stride + n]
            buffer.v[row, n, a] = velocity * v[a * body.stride + n]
    for e in range(buffer.length.shape[1]):
        buffer.length[row, e] = length * body.scratch[0][e]
        buffer.tension[row, e] = force * body.scratch[1][e]
    for e in range(buffer.angle.shape[1]):
        angle = body.scratch[2][e] + body.scratch[4][e]
        buffer.angle[row, e] = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
        buffer.moment[row, e] = moment * body.scratch[3][e]
    for e in range(buffer.bend_angle.shape[1]):
        buffer.bend_angle[row, e] = math.pi - body.scratch[5][e]
        buffer.bend_moment[row, e] = moment * body.scratch[6][e]
    for kind in range(buffer.energy.shape[1]):
        buffer.energy[row, kind] = joule * total(energy, kind)
    driven_energy(body.drives, v, ledger, 1.0)
    for kind in range(buffer.ledger.shape[1]):
        buffer.ledger[row, kind] = joule * total(ledger, kind)
    driven_energy(body.drives, v, ledger, -1.0)


class FixedControl(NamedTuple):
    """How schemes with a fixed step advance: steps to a frame, step, and the guard's limit.

    Without a guard the limit is 0: a scene of an ensemble must not stop the others.
    """

    frame_time: float
    steps_per_frame: int
    h: float
    limit: float


@chosen_by_type(to_time)
def _fixed(scheme, body, state, energy, control, frame):
    if control.instance_class is not FixedControl:
        return None

    return take_fixed_steps


def take_fixed_steps(scheme, body, state, energy, control, frame):
    """Take the steps from `frame` to the next one.

    Returns the time, and -1 or what stopped the run: a coordinate that left the plausible
    range, `OVERFULL` where contacts had no room, or `FAILED`.
    """
    number, count, h = frame * control.steps_per_frame, control.steps_per_frame, control.h
    for done in range(count):
        # From the count of steps: adding up h would drift.
        t = (number + done) * h
        remember(body.contacts, state)
        step(scheme, body, state, t, h)
        t = (number + done + 1) * h
        if collide(scheme, body, state, h):
            return t, OVERFULL
        if failed(scheme, body):
            return t, FAILED
        guarded = (number + done) % GUARD_INTERVAL == 0 or done == count - 1
        if guarded and control.limit > 0.0:
            escaped = first_escaped(state.x, control.limit)
            if escaped >= 0:
                return t, escaped
        cross_knot(body, state, energy, t, t + h)
        take_impact(body, state)
    find_reactions(body, state, (number + count) * h, h)
    return (number + count) * h, -1


@chosen_by_type(output)
def _state_itself(scheme, state, control, frame):
    if control.instance_class is not FixedControl:
        return None
    return lambda scheme, state, control, frame: (state.x, state.v, state.ledger)


@entry
def advance(stamp: int) -> Any:
    """``advance(scheme, body, state, energy, control, first, count, scale, buffer)``.

    Step through `count` frames after frame `first`, filling `buffer`. With ``first = -1`` the
    first one is t = 0, for which driven coordinates are put in place. Returns the number of
    frames done, -1 and 0; or also the coordinate that left the plausible range (or what else
    `fixed_steps` says), and the time at which it was seen to have done so.
    """

    def advance(scheme, body, state, energy, control, first, count, scale, buffer):
        _ = stamp
        for row in range(count):
            frame = first + row
            x, v, ledger = state.x, state.v, state.ledger
            if frame < 0:
                place_driven(body.drives, x, v, 0.0, 0.0, control.h)
                begin_rigid(body, state)
                driven_energy(body.drives, v, ledger, -1.0)
            else:
                reached, escaped = to_time(scheme, body, state, energy, control, frame)
                if escaped != -1:
                    return row, escaped, reached
                x, v, ledger = output(scheme, state, control, frame + 1)
            find_reactions(body, state, (frame + 1) * control.frame_time, control.h)
            save_frame(body, x, v, ledger, energy, scale, row, buffer)
        return count, -1, 0.0

    return advance


@jit
def save_scenes(body, x, v, scale, row, buffer) -> None:
    """Copy the states of all scenes side by side into a row of the ensemble's buffer."""
    length, velocity = scale
    scenes = buffer.x.shape[0]
    for a in range(len(body.space)):
        for n in range(buffer.x.shape[2]):
            for s in range(scenes):
                at = a * body.stride + n * scenes + s
                buffer.x[s, row, n, a] = length * x[at]
                buffer.v[s, row, n, a] = velocity * v[at]


@entry
def advance_scenes(stamp: int) -> Any:
    """``advance_scenes(scheme, body, state, control, first, count, scale, buffer)``.

    As `advance`, for an ensemble: positions and velocities only, and a scene that diverges
    does not stop the others. With ``first = -1`` the first row is the frame t = 0.
    """

    def advance_scenes(scheme, body, state, control, first, count, scale, buffer):
        _ = stamp
        row = 0
        if first < 0:
            place_driven(body.drives, state.x, state.v, 0.0, 0.0, control.h)
            save_scenes(body, state.x, state.v, scale, 0, buffer)
            row = 1
            first = 0
        for frame in range(count - row):
            to_time(scheme, body, state, None, control, first + frame)
            save_scenes(body, state.x, state.v, scale, row + frame, buffer)

    return advance_scenes
