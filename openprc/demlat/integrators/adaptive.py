"""The loop of schemes that choose their steps: error control, knots, dense output.

Frames do not cut steps: they are interpolated. Knots of signals do: what jumps there would cost
the order, and motions that a held signal makes at once are booked as work.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.aligned import aligned_zeros, aligned_zeros_like
from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.copying import copy, copy_if_any
from openprc.demlat.integrators.embedded import (
    Stages,
    Tableau,
    begin_next,
    blend_ledger,
    interpolate,
    run_stages,
)
from openprc.demlat.integrators.error_norm import (
    FAR,
    FAST,
    relative_error,
    rms_moved,
    rms_speed,
    worst_coordinate,
)
from openprc.demlat.integrators.knots import knot_after
from openprc.demlat.integrators.ledger import make_rates
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, Body, Reals
from openprc.errors import Diverged

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.schema.experiment import Experiment

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
TIME, OLD_TIME, STEP, LAST_ERROR = range(FAST + 1, FAST + 5)
# Entries of the counts.
STEPS, REJECTED, PLACE, DENSE, WORST = range(5)
# What an entry says of the place where the state is: forces there are not known, are known but
# change as the state is at a knot, are those of the last stage, are those of the first one.
AT_START, AT_KNOT, AT_END, IS_READY = range(4)


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
    clock : (6,) f8
        Largest rms displacement and velocity so far; end and start of the last step, next step,
        error of the last one.
    counts : (5,) i8
        Accepted and rejected steps; where the state is; whether the stages of the dense output
        are known; the coordinate that allowed no step.
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
        state = [aligned_zeros_like(body.mass) for _ in range(6)]
        stages = Stages(
            pitch=pitch,
            forces=aligned_zeros(number * pitch, body.mass.dtype),
            rates=rates,
            kept=None if rates is None else np.zeros((number, rates.size), rates.dtype),
            x=state[0],
            v=state[1],
            old_x=state[2],
            old_v=state[3],
            old_ledger=ledger,
            evaluations=np.zeros(1, np.int64),
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
            start=aligned_zeros_like(body.mass),
            weights=np.zeros((2, number)),
            sums=aligned_zeros(6 * LEDGER_STRIDE, body.mass.dtype),
            clock=np.zeros(6),
            counts=np.zeros(5, np.int64),
        )

    @property
    def effort(self) -> dict[str, int]:
        """Numbers of accepted steps, of rejected ones, and of evaluations of all forces."""
        steps, rejected = (int(self.counts[at]) for at in (STEPS, REJECTED))
        evaluations = int(self.stages.evaluations[0])
        return {"steps": steps, "rejected": rejected, "evaluations": evaluations}

    def explain(self, experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
        """Return what to raise when no step is small enough at `time` [s]."""
        axis, place = divmod(int(self.counts[WORST]), assembly.packing.stride)
        node = place // assembly.packing.scenes
        return Diverged(
            f"the integrator {experiment.integrator!r} found no step small enough at"
            f" t = {time:.6g} s for node {node} along {'xyz'[axis]}",
            expected="forces that are finite and smooth between the knots of the signals",
            fix="look there for a bar of no length, a panel folded onto its crease or a force"
            f" without bound, or loosen the tolerance of {self.tolerance:g}, which cannot be less"
            " than the rounding of the numbers; frames up to then are in the partial file",
            key="simulation.tolerance",
        )


def _longest_step(body: Body) -> float:
    if body.drives is None:
        return math.inf
    signals = body.drives.signals
    smooth = signals.dt[~signals.knots]
    return MOST_SAMPLES * float(smooth.min(initial=math.inf))


@jit
def _ready(work: Any, body: Any, state: Any, energy: Any, control: Any) -> None:
    """Go over to the segments that begin at a knot; have the forces there in the first stage."""
    t, counts, stages = work.clock[TIME], work.counts, work.stages
    if counts[PLACE] == AT_START or counts[PLACE] == AT_KNOT:
        t_to = min(knot_after(body.drives, t), t + control.frame_time)
        stepping.cross_knot(body, state, energy, t, t_to)
        run_stages(work.table, stages, body, state.x, state.v, work.table.parts[0], t, t_to)
    elif counts[PLACE] == AT_END:
        begin_next(work.table, stages, body, state.x.size)
    counts[PLACE] = IS_READY


@jit
def _step_end(t: float, h: float, knot: float) -> float:
    """Return where a step of about `h` ends: on a knot that is near, halfway to one not far."""
    if t + 1.001 * h >= knot:
        return knot
    return t + 0.5 * (knot - t) if t + 2.0 * h > knot else t + h


@jit
def take_step(work: Any, body: Any, state: Any, energy: Any, control: Any) -> int:
    """Take one step with an error below the tolerance; return -1.

    Returns a coordinate when it has left the plausible range, or `FAILED` when no step is small
    enough.
    """
    clock, counts = work.clock, work.counts
    _ready(work, body, state, energy, control)
    t = clock[TIME]
    knot = knot_after(body.drives, t)
    h = min(clock[STEP], work.longest)
    power = 1.0 / work.table.error_order
    rejected = False
    while True:
        t_to = _step_end(t, h, knot)
        if t_to - t < LEAST_STEP * max(t, control.frame_time):
            counts[WORST] = worst_coordinate(work, body)
            return stepping.FAILED
        run_stages(work.table, work.stages, body, state.x, state.v, work.table.parts[1], t, t_to)
        error = relative_error(work, body, t_to - t)
        if error < 1.0:
            break
        rejected = True
        counts[REJECTED] += 1
        shrink = SAFETY * error**-power
        h = (t_to - t) * (shrink if shrink > SHRINK else SHRINK)  # also for NaN
    stages, lanes = work.stages, body.lanes
    copy(lanes, stages.old_x, state.x)
    copy(lanes, stages.old_v, state.v)
    copy(lanes, state.x, stages.x)
    copy(lanes, state.v, stages.v)
    copy_if_any(lanes, stages.old_ledger, state.ledger)
    weights = work.table.weights[work.table.stages]
    blend_ledger(state.ledger, stages.old_ledger, stages.kept, weights, t_to - t)
    clock[FAR] = max(clock[FAR], rms_moved(work))
    clock[FAST] = max(clock[FAST], rms_speed(work))
    clock[OLD_TIME], clock[TIME] = t, t_to
    counts[STEPS] += 1
    counts[DENSE] = 0
    counts[PLACE] = AT_KNOT if t_to == knot else AT_END
    before, now = max(clock[LAST_ERROR], 1e-4), max(error, 1e-10)
    memory = MEMORY * 5.0 * power
    grow = SAFETY * now ** (0.75 * memory - power) * before**memory
    grow = min(max(grow, SHRINK), 1.0 if rejected else GROW)
    proposed = grow * (t_to - t)
    # A step cut short by a knot says nothing against the one that was intended.
    clock[STEP] = max(proposed, h) if t_to - t < h else proposed
    clock[LAST_ERROR] = now
    if not math.sqrt(max(work.free, 1)) * rms_moved(work) < 0.5 * control.limit:
        return stepping.first_escaped(state.x, control.limit)
    return -1


@jit
def _start(work: Any, lanes: Any, state: Any, h: float) -> None:
    work.clock[:] = 0.0
    work.counts[:] = 0
    work.stages.evaluations[0] = 0
    work.clock[STEP] = h
    copy(lanes, work.start, state.x)
    squares = 0.0
    for at in range(state.v.size):
        squares += state.v[at] * state.v[at]
    work.clock[FAST] = math.sqrt(squares / max(work.free, 1))


@jit
def _fill_in(work: Any, body: Any, now: float) -> None:
    """Interpolate what is to be saved within the last step."""
    table, stages = work.table, work.stages
    t, t_to = work.clock[OLD_TIME], work.clock[TIME]
    if not work.counts[DENSE]:
        run_stages(table, stages, body, stages.old_x, stages.old_v, table.parts[2], t, t_to)
        work.counts[DENSE] = 1
    interpolate(table, stages, body, work.weights, t, t_to - t, t_to, now)


@chosen_by_type(stepping.to_time)
def _to_time(scheme, body, state, energy, control, frame):
    if control.instance_class is not AdaptiveControl:
        return None

    def run(scheme, body, state, energy, control, frame):
        if frame == 0:
            _start(scheme, body.lanes, state, control.h)
        stages = scheme.stages
        target = (frame + 1) * control.frame_time
        slack = FRAME_SLACK * target
        while scheme.clock[TIME] < target - slack:
            escaped = take_step(scheme, body, state, energy, control)
            if escaped != -1:
                return scheme.clock[TIME], escaped
        if scheme.clock[TIME] > target + slack:
            _fill_in(scheme, body, target)
        else:
            # What is saved at a knot is what holds from then on, as with fixed steps.
            if scheme.counts[PLACE] == AT_KNOT:
                _ready(scheme, body, state, energy, control)
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
