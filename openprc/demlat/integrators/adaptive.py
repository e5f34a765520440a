"""The loop of schemes that choose their steps: error control, knots, dense output.

The error of a step is measured against the motion: positions against the rms displacement
since t = 0, velocities against the rms velocity, each the largest so far, at least `QUIET` and
at most one in the engine's units (which are those of the mean bar and of its vibration), and
the root mean square over all free coordinates is compared with the tolerance. Neither the place
of the scene nor its units matter then.

Frames do not cut steps: they are interpolated. Knots of signals do: what jumps there would cost
the order, and motions that a held signal makes at once are booked as work.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.jit import jit
from openprc.demlat.compiled.lanes import load, splat, store
from openprc.demlat.integrators import Settings
from openprc.demlat.integrators.copying import copy, copy_if_any
from openprc.demlat.integrators.embedded import (
    Stages,
    Tableau,
)
from openprc.demlat.integrators.ledger import make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, Body, Reals

#: Smallest motion that errors are measured against, in the engine's units.
QUIET = 1e-3
#: A step is this much smaller than the estimate says, and changes by at most these factors.
SAFETY, SHRINK, GROW = 0.9, 0.2, 8.0
#: Exponent of the previous error in the choice of the step (Gustafsson's PI control; Hairer &
#: Wanner, Solving Ordinary Differential Equations II, sec. IV.2, doi:10.1007/978-3-642-05221-7).
MEMORY = 0.04
#: Steps below this share of the time are lost in its rounding.
LEAST_STEP = 1e-13
#: Slack, relative to the time, within which a frame counts as lying on a step's end.
FRAME_SLACK = 1e-12
#: Steps are at most so many samples of a smooth signal long, lest a pulse be stepped over.
MOST_SAMPLES = 10.0

# Entries of the clock.
TIME, OLD_TIME, STEP, LAST_STEP, LAST_ERROR, FAR, FAST = range(7)
# Entries of the counts.
STEPS, REJECTED, EVALUATIONS, AT_KNOT, FIRST_STAGE, DENSE = range(6)


class AdaptiveControl(NamedTuple):
    """Frames, first guess of the step, and the guard's limit; times in units of the engine."""

    frame_time: float
    h: float
    limit: float


class Adaptive(NamedTuple):
    """A pair and the state of its step control.

    Attributes
    ----------
    table : Tableau
    stages : Stages
    tolerance : float
    longest : float [s]
        A step is at most that long.
    free : int
        Number of coordinates that the scheme determines.
    start : (K,) [m]
        Positions at t = 0.
    weights : (2, S)
        Scratch of the dense output.
    sums : (6 * LEDGER_STRIDE,)
        Scratch of the error norm.
    clock : (7,) f8
        Ends of the last step; next step; length and error of the last one; largest rms
        displacement and velocity so far.
    counts : (6,) i8
        Accepted and rejected steps, evaluations of all forces; whether the state is at a knot
        not yet crossed, whether the first stage of the next step is known, whether the stages of
        the dense output are.
    """

    table: Tableau
    stages: Stages
    tolerance: float
    longest: float
    free: int
    start: Reals
    weights: Reals
    sums: Reals
    clock: NDArray[np.float64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, table: Tableau, body: Body, settings: Settings) -> Adaptive:
        """Return work arrays for a pair and a body."""
        size, number = body.mass.size, len(table.nodes)
        pitch = size
        if pitch * body.mass.itemsize % 4096 == 0:
            pitch += len(body.lanes)  # or all stages would compete for the same cache lines
        rates = make_rates(body, settings)
        ledger = np.zeros(0) if rates is None else np.zeros_like(rates)
        state = [np.zeros_like(body.mass) for _ in range(6)]
        stages = Stages(
            pitch=pitch,
            forces=np.zeros(number * pitch, body.mass.dtype),
            rates=None if rates is None else np.zeros((number, rates.size), rates.dtype),
            x=state[0],
            v=state[1],
            old_x=state[2],
            old_v=state[3],
            old_ledger=ledger,
            out_x=state[4],
            out_v=state[5],
            out_ledger=ledger.copy(),
        )
        return cls(
            table=table,
            stages=stages,
            tolerance=settings.tolerance,
            longest=_longest_step(body),
            free=int(np.count_nonzero(body.inverse_mass)),
            start=np.zeros_like(body.mass),
            weights=np.zeros((2, number)),
            sums=np.zeros(6 * LEDGER_STRIDE, body.mass.dtype),
            clock=np.zeros(7),
            counts=np.zeros(6, np.int64),
        )

    @property
    def effort(self) -> dict[str, int]:
        """Numbers of accepted steps, of rejected ones, and of evaluations of all forces."""
        names = ("steps", "rejected", "evaluations")
        return {name: int(self.counts[at]) for at, name in enumerate(names)}


def _longest_step(body: Body) -> float:
    if body.drives is None:
        return math.inf
    signals = body.drives.signals
    smooth = signals.dt[~signals.knots]
    return MOST_SAMPLES * float(smooth.min(initial=math.inf))


@jit
def _sum(sums: Any, row: int) -> float:
    result = 0.0
    for lane in range(LEDGER_STRIDE):
        result += sums[row * LEDGER_STRIDE + lane]
    return result


@jit
def _add_up(work: Any, body: Any, h: float) -> None:
    """Sum the squares of two error estimates of x and of v, of displacements and velocities."""
    table, stages, lanes = work.table, work.stages, body.lanes
    zero = splat(lanes, 0.0)
    x1, x2, v1, v2, far, fast = zero, zero, zero, zero, zero, zero
    count = table.stages + 1 if table.late_error else table.stages
    for at in range(0, stages.x.size, len(lanes)):
        ex1, ex2, ev1, ev2 = zero, zero, zero, zero
        for j in range(count):
            force = load(lanes, stages.forces, at, j * stages.pitch)
            ev1 += table.error[0, j] * force
            ev2 += table.error[1, j] * force
            ex1 += table.double_error[0, j] * force
            ex2 += table.double_error[1, j] * force
        mobility = h * load(lanes, body.inverse_mass, at, 0)
        ev1 *= mobility
        ev2 *= mobility
        mobility *= h
        ex1 *= mobility
        ex2 *= mobility
        x1 += ex1 * ex1
        x2 += ex2 * ex2
        v1 += ev1 * ev1
        v2 += ev2 * ev2
        moved = load(lanes, stages.x, at, 0) - load(lanes, work.start, at, 0)
        far += moved * moved
        u = load(lanes, stages.v, at, 0)
        fast += u * u
    store(lanes, work.sums, 0, x1)
    store(lanes, work.sums, LEDGER_STRIDE, x2)
    store(lanes, work.sums, 2 * LEDGER_STRIDE, v1)
    store(lanes, work.sums, 3 * LEDGER_STRIDE, v2)
    store(lanes, work.sums, 4 * LEDGER_STRIDE, far)
    store(lanes, work.sums, 5 * LEDGER_STRIDE, fast)


@jit
def _relative_error(work: Any, body: Any, h: float) -> float:
    """Return the error of the step just tried in units of what is tolerated; may be NaN.

    Two estimates are combined as by Hairer, Norsett & Wanner, sec. II.10; with one of them
    zero the other is left.
    """
    _add_up(work, body, h)
    free, clock = max(work.free, 1), work.clock
    far = max(math.sqrt(_sum(work.sums, 4) / free), clock[FAR])
    fast = max(math.sqrt(_sum(work.sums, 5) / free), clock[FAST])
    x_unit = work.tolerance * min(max(far, QUIET), 1.0)
    v_unit = work.tolerance * min(max(fast, QUIET), 1.0)
    first = _sum(work.sums, 0) / (x_unit * x_unit) + _sum(work.sums, 2) / (v_unit * v_unit)
    second = _sum(work.sums, 1) / (x_unit * x_unit) + _sum(work.sums, 3) / (v_unit * v_unit)
    if first == 0.0:
        return 0.0
    return first / math.sqrt(2.0 * free * (first + 0.01 * second))


@jit
def _worst(work: Any, body: Any) -> int:
    """Return the coordinate whose velocity has the largest estimated error."""
    table, stages = work.table, work.stages
    worst, largest = 0, -1.0
    for at in range(stages.x.size):
        error = 0.0
        for j in range(table.stages):
            error += table.error[0, j] * stages.forces[at + j * stages.pitch]
        error = abs(error * body.inverse_mass[at])
        if not error <= largest:
            worst, largest = at, error
    return worst


@jit
def _begin_step(work: Any, body: Any, state: Any, energy: Any, control: Any) -> None:
    """Have the force at the start of the next step in the first stage."""
    t, counts = work.clock[TIME], work.counts
    if counts[AT_KNOT]:
        _cross(work, body, state, energy, control)
    elif not counts[FIRST_STAGE]:
        begin_next(work.table, work.stages, body, state.x.size)
    counts[FIRST_STAGE] = 1
    counts[DENSE] = 0


@jit
def _cross(work: Any, body: Any, state: Any, energy: Any, control: Any) -> None:
    """Go over to the segments that begin at the present time, and evaluate the forces there."""
    t, counts = work.clock[TIME], work.counts
    t_to = min(knot_after(body.drives, t), t + control.frame_time)
    stepping.cross_knot(body, state, energy, t, t_to)
    evaluate_row(work.stages, body, state.x, state.v, 0, t, t, t_to)
    counts[EVALUATIONS] += 1
    counts[AT_KNOT] = 0
    counts[FIRST_STAGE] = 1


@jit
def _try(work: Any, body: Any, x: Any, v: Any, t: float, t_to: float) -> float:
    """Compute the end of a step; return its relative error."""
    table, stages = work.table, work.stages
    last = table.stages
    count = last + 1 if table.late_error else last
    for row in range(1, count):
        stage(table, stages, body, x, v, row, t, t_to - t, t_to)
    work.counts[EVALUATIONS] += count - 1
    if not table.late_error:
        combine(table, stages, body, x, v, last, t_to - t)
        place_driven(body.drives, stages.x, stages.v, t_to, t, t_to)
    return _relative_error(work, body, t_to - t)


@jit
def _accept(work: Any, body: Any, state: Any, t: float, t_to: float) -> None:
    """Make the end of the step the state, and keep its start for the dense output."""
    table, stages, clock, counts = work.table, work.stages, work.clock, work.counts
    lanes = body.lanes
    copy(lanes, stages.old_x, state.x)
    copy(lanes, stages.old_v, state.v)
    copy(lanes, state.x, stages.x)
    copy(lanes, state.v, stages.v)
    if not table.late_error:
        evaluate_row(stages, body, state.x, state.v, table.stages, t_to, t, t_to)
        counts[EVALUATIONS] += 1
    copy_if_any(lanes, stages.old_ledger, state.ledger)
    blend_ledger(
        state.ledger, stages.old_ledger, stages.rates, table.weights[table.stages], t_to - t
    )
    free = max(work.free, 1)
    clock[FAR] = max(clock[FAR], math.sqrt(_sum(work.sums, 4) / free))
    clock[FAST] = max(clock[FAST], math.sqrt(_sum(work.sums, 5) / free))
    clock[OLD_TIME] = t
    clock[TIME] = t_to
    clock[LAST_STEP] = t_to - t
    counts[STEPS] += 1
    counts[FIRST_STAGE] = 0


@jit
def _step_end(t: float, h: float, knot: float) -> float:
    """Return where a step of about `h` ends: on a knot that is near, halfway to one not far."""
    if t + 1.001 * h >= knot:
        return knot
    return t + 0.5 * (knot - t) if t + 2.0 * h > knot else t + h


@jit
def take_step(work: Any, body: Any, state: Any, energy: Any, control: Any) -> int:
    """Take one step with an error below the tolerance; return -1.

    Returns a coordinate when it has left the plausible range, or one plus the number of
    coordinates when no step is small enough for it.
    """
    clock, counts = work.clock, work.counts
    _begin_step(work, body, state, energy, control)
    t = clock[TIME]
    knot = knot_after(body.drives, t)
    h = min(clock[STEP], work.longest)
    power = 1.0 / work.table.error_order
    rejected = False
    while True:
        t_to = _step_end(t, h, knot)
        if t_to - t < LEAST_STEP * max(t, control.frame_time):
            escaped = stepping.first_escaped(work.stages.x, control.limit)
            return escaped if escaped >= 0 else state.x.size + _worst(work, body)
        error = _try(work, body, state.x, state.v, t, t_to)
        if error < 1.0:
            break
        rejected = True
        counts[REJECTED] += 1
        shrink = SAFETY * error**-power
        h = (t_to - t) * (shrink if shrink > SHRINK else SHRINK)  # also for NaN
    _accept(work, body, state, t, t_to)
    before, now = max(clock[LAST_ERROR], 1e-4), max(error, 1e-10)
    memory = MEMORY * 5.0 * power
    grow = SAFETY * now ** (0.75 * memory - power) * before**memory
    grow = min(max(grow, SHRINK), 1.0 if rejected else GROW)
    proposed = grow * (t_to - t)
    # A step cut short by a knot says nothing against the one that was intended.
    clock[STEP] = max(proposed, h) if t_to - t < h else proposed
    clock[LAST_ERROR] = now
    counts[AT_KNOT] = 1 if t_to == knot else 0
    if not math.sqrt(_sum(work.sums, 4)) < 0.5 * control.limit:
        return stepping.first_escaped(state.x, control.limit)
    return -1


@jit
def _start(work: Any, body: Any, state: Any, control: Any) -> None:
    work.clock[:] = 0.0
    work.counts[:] = 0
    work.clock[STEP] = control.h
    copy(body.lanes, work.start, state.x)
    squares = 0.0
    for at in range(state.v.size):
        squares += state.v[at] * state.v[at]
    work.clock[FAST] = math.sqrt(squares / max(work.free, 1))
    evaluate_row(work.stages, body, state.x, state.v, 0, 0.0, 0.0, control.h)
    work.counts[EVALUATIONS] = 1
    work.counts[FIRST_STAGE] = 1


@jit
def _fill_in(work: Any, body: Any, now: float) -> None:
    """Interpolate what is to be saved within the last step."""
    table, stages, counts = work.table, work.stages, work.counts
    t, t_to = work.clock[OLD_TIME], work.clock[TIME]
    if not counts[DENSE]:
        for row in range(table.stages + 1, table.nodes.size):
            stage(table, stages, body, stages.old_x, stages.old_v, row, t, t_to - t, t_to)
            counts[EVALUATIONS] += 1
        counts[DENSE] = 1
    interpolate(table, stages, body, work.weights, t, t_to - t, t_to, now)


@chosen_by_type(stepping.to_time)
def _to_time(scheme, body, state, energy, control, frame):
    if control.instance_class is not AdaptiveControl:
        return None

    def run(scheme, body, state, energy, control, frame):
        if frame == 0:
            _start(scheme, body, state, control)
        stages = scheme.stages
        target = (frame + 1) * control.frame_time
        slack = FRAME_SLACK * target
        while scheme.clock[TIME] < target - slack:
            escaped = take_step(scheme, body, state, energy, control)
            if escaped >= 0:
                return scheme.clock[TIME], escaped
        if scheme.clock[TIME] > target + slack:
            _fill_in(scheme, body, target)
        else:
            # What is saved at a knot is what holds from then on, as with fixed steps.
            if scheme.counts[AT_KNOT]:
                _cross(scheme, body, state, energy, control)
            copy(body.lanes, stages.out_x, state.x)
            copy(body.lanes, stages.out_v, state.v)
            copy_if_any(body.lanes, stages.out_ledger, state.ledger)
        return target, -1

    return run


@chosen_by_type(stepping.output)
def _output(scheme, state, control, frame):
    if control.instance_class is not AdaptiveControl:
        return None

    def interpolated(scheme, state, control, frame):
        return scheme.stages.out_x, scheme.stages.out_v, scheme.stages.out_ledger

    return interpolated
