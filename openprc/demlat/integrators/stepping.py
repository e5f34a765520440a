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
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, WORK_IN

#: Steps between two looks at whether a coordinate is still a plausible number.
GUARD_INTERVAL = 100


def step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""


def to_time(scheme: Any, body: Any, state: Any, energy: Any, control: Any, frame: int) -> Any:
    """Advance `state` from `frame` to the next one; return (time, escaped coordinate or -1)."""


def output(scheme: Any, state: Any, control: Any, frame: int) -> Any:
    """Return the positions, velocities and ledger of `frame`, to be saved."""


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


@jit
def potential(body: Any, x: Any, v: Any, energy: Any) -> float:
    """Return the potential energy."""
    observe(body, x, v, energy)
    return total(energy, 1) + total(energy, 2) + total(energy, 3)


def cross_knot(body: Any, state: Any, energy: Any, t: float, t_to: float) -> None:
    """Hand driven coordinates over to the segments that begin at `t`.

    A held signal moves its coordinates at once; the elastic energy that this takes or gives is
    the actuator's work. Where no energies are kept, `energy` is None.
    """


@chosen_by_type(cross_knot)
def _cross_knot(body, state, energy, t, t_to):
    if isinstance(energy, types.NoneType):

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
def fixed_steps(
    scheme: Any, body: Any, state: Any, energy: Any, number: int, count: int, h: float, limit: float
) -> Any:
    """Take `count` steps beginning with step `number`; return (steps taken, escaped).

    Escaped is -1, a coordinate, or `OVERFULL` where contacts had no room.
    """
    for done in range(count):
        # From the count of steps: adding up h would drift.
        t = (number + done) * h
        remember(body.contacts, state)
        step(scheme, body, state, t, h)
        if collide(scheme, body, state, h):
            return done + 1, OVERFULL
        if (number + done) % GUARD_INTERVAL == 0 or done == count - 1:
            escaped = first_escaped(state.x, limit)
            if escaped >= 0:
                return done + 1, escaped
        t = (number + done + 1) * h
        cross_knot(body, state, energy, t, t + h)
    return count, -1


@jit
def save_frame(
    body: Any, x: Any, v: Any, ledger: Any, energy: Any, scale: Any, row: int, buffer: Any
) -> None:
    """Copy the state and what is derived from it into a row of the frame buffer."""
    observe(body, x, v, energy)
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
    for kind in range(4):
        buffer.energy[row, kind] = joule * total(energy, kind)
    driven_energy(body.drives, v, ledger, 1.0)
    for kind in range(5):
        buffer.ledger[row, kind] = joule * total(ledger, kind)
    driven_energy(body.drives, v, ledger, -1.0)


class FixedControl(NamedTuple):
    """How schemes with a fixed step advance: steps to a frame, step, and the guard's limit."""

    frame_time: float
    steps_per_frame: int
    h: float
    limit: float


@chosen_by_type(to_time)
def _fixed(scheme, body, state, energy, control, frame):
    if control.instance_class is not FixedControl:
        return None

    def run(scheme, body, state, energy, control, frame):
        number, count = frame * control.steps_per_frame, control.steps_per_frame
        taken, escaped = fixed_steps(
            scheme, body, state, energy, number, count, control.h, control.limit
        )
        return (number + taken) * control.h, escaped

    return run


@chosen_by_type(output)
def _state_itself(scheme, state, control, frame):
    if control.instance_class is not FixedControl:
        return None
    return lambda scheme, state, control, frame: (state.x, state.v, state.ledger)


@entry
def begin(stamp: int) -> Any:
    """``begin(body, state, energy, h, scale, buffer)``.

    Put driven coordinates in place and save the frame t = 0 in row 0 of `buffer`.
    """

    def begin(body, state, energy, h, scale, buffer):
        _ = stamp
        place_driven(body.drives, state.x, state.v, 0.0, 0.0, h)
        driven_energy(body.drives, state.v, state.ledger, -1.0)
        save_frame(body, state.x, state.v, state.ledger, energy, scale, 0, buffer)

    return begin


@entry
def advance(stamp: int) -> Any:
    """``advance(scheme, body, state, energy, control, first, count, scale, buffer)``.

    Step through `count` frames after frame `first`, filling `buffer`. Returns the number of
    frames done, -1 and 0; or also the coordinate that left the plausible range, and the time
    at which it was seen to have done so.
    """

    def advance(scheme, body, state, energy, control, first, count, scale, buffer):
        _ = stamp
        for frame in range(count):
            reached, escaped = to_time(scheme, body, state, energy, control, first + frame)
            if escaped != -1:
                return frame, escaped, reached
            x, v, ledger = output(scheme, state, control, first + frame + 1)
            save_frame(body, x, v, ledger, energy, scale, frame, buffer)
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
            number = (first + frame) * control.steps_per_frame
            fixed_steps(
                scheme, body, state, None, number, control.steps_per_frame, control.h, math.inf
            )
            save_scenes(body, state.x, state.v, scale, row + frame, buffer)

    return advance_scenes
