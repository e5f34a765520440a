"""Solutions of one scene that become better and better, and what they differ by."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.contact.findings import can_touch
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import stable_step
from openprc.errors import NotConverged, OpenPRCError
from openprc.hooks.running import silent
from openprc.tradeoff.outcome import error_over_time, run_in_memory
from openprc.tradeoff.settings import configured

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.hooks.protocols import Progress
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Tolerances that the scheme which chooses its steps is asked for, as far as need be.
TOLERANCES = (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
#: A run for the reference may take so many times what one run of a setting may.
PATIENCE = 10.0
#: Beyond the time at which two of its solutions part by this, errors say nothing about a setting.
HORIZON_ERROR = 1e-6
#: The same where steps are refined by hand, which never gets so far.
COARSE_HORIZON_ERROR = 1e-3
#: Differences have to fall at least by this power of the step to be called convergence.
LEAST_RATE = 0.5
#: A difference below this is rounding.
ROUNDING = 1e-11


@dataclass(frozen=True, kw_only=True)
class Refined:
    """The last one of a sequence of solutions; see `ConvergedReference` for its fields."""

    positions: Reals
    horizon: float
    method: str
    setting: dict[str, Any]
    differences: tuple[float, ...]
    rate: float | None
    uncertainty: float
    converged: bool


@dataclass(frozen=True, kw_only=True)
class Check:
    """What a second method says of a solution; see `ConvergedReference` for its fields."""

    method: str
    difference: float | None = None
    uncertainty: float | None = None
    agrees: bool = True
    note: str = ""


def by_tolerance(
    experiment: Experiment, stride: int, *, longest: float, needed: float, progress: Progress
) -> Refined:
    """Let dop853 run a scene at falling tolerances.

    Parameters
    ----------
    experiment : Experiment
    stride : int
        Which frames are kept.
    longest : float [s]
        A run may take `PATIENCE` times this.
    needed : float [1]
        Difference that is small enough.
    progress : callable
    """
    frames: Reals | None = None
    profiles: list[Reals] = []
    tried: list[float] = []
    for number, tolerance in enumerate(TOLERANCES):
        progress(0.1 * number, f"reference: dop853 to {tolerance:g}")
        setting = {"integrator": "dop853", "tolerance": tolerance}
        outcome = run_in_memory(configured(experiment, setting), stride=stride)
        if frames is not None:
            profiles.append(error_over_time(frames, outcome.positions))
        frames = outcome.positions
        tried.append(tolerance)
        # A tenth of the tolerance takes a third more.
        too_long = 1.33 * outcome.seconds > PATIENCE * longest
        if len(profiles) >= 2 and (profiles[-1].max() <= needed or too_long):
            break
    assert frames is not None  # noqa: S101 - there are tolerances
    stop = _first_above(profiles[-1], max(HORIZON_ERROR, needed))
    differences = tuple(float(profile[: max(stop, 1)].max()) for profile in profiles)
    return Refined(
        positions=frames[:stop],
        horizon=(stop - 1) * stride * experiment.save_interval,
        method=f"dop853 at tolerances {tried[0]:g} to {tried[-1]:g}",
        setting={"integrator": "dop853", "tolerance": tried[-1]},
        differences=differences,
        rate=None,
        uncertainty=max(differences[-1], float(np.finfo(float).eps)),
        converged=differences[-1] <= max(0.5 * differences[0], ROUNDING),
    )


def by_step(
    experiment: Experiment,
    integrator: str,
    stride: int,
    *,
    longest: float,
    needed: float,
    progress: Progress,
) -> Refined:
    """Let a scheme run a scene at falling steps; parameters as of `by_tolerance`.

    Raises
    ------
    NotConverged
        When there is time for less than three.
    """
    solutions = list(
        _refined(
            experiment,
            integrator,
            stride,
            longest=PATIENCE * longest,
            needed=needed,
            progress=progress,
        )
    )
    if len(solutions) < 3:
        raise NotConverged(
            f"no reference: {len(solutions)} steps of {integrator} are stable and affordable, and"
            " three are needed to see convergence",
            expected=f"runs that take less than {PATIENCE * longest:g} s",
            fix="allow longer ones with --longest, or shorten the scene",
        )
    counts, frames = [n for n, _ in solutions], [x for _, x in solutions]
    profiles = [error_over_time(a, b) for a, b in itertools.pairwise(frames)]
    stop = len(frames[0])
    for bound in (math.inf, COARSE_HORIZON_ERROR):
        stop = _first_above(profiles[-1], bound)
        differences = tuple(float(profile[: max(stop, 1)].max()) for profile in profiles)
        rate, converged = _fall(differences)
        if converged or stop < 2:
            break
    # The tail of a geometric series, at no more than the order that the scheme has.
    power = min(max(rate or LEAST_RATE, LEAST_RATE), INTEGRATORS[integrator].order)
    uncertainty = max(differences[-1] / (2.0**power - 1.0), float(np.finfo(float).eps))
    return Refined(
        positions=frames[-1][:stop],
        horizon=(stop - 1) * stride * experiment.save_interval,
        method=f"{integrator} with {counts[0]} to {counts[-1]} steps a frame",
        setting={"integrator": integrator, "steps_per_frame": counts[-1]},
        differences=differences,
        rate=rate,
        uncertainty=uncertainty,
        converged=converged,
    )


def _fall(differences: tuple[float, ...]) -> tuple[float | None, bool]:
    """Return the rate of the last differences, if any, and whether they converge."""
    # Differences of rounding fall no further, and are as good as none.
    last = [d for d in differences if d > ROUNDING][-3:]
    rates = [math.log2(a / b) for a, b in itertools.pairwise(last)]
    rate = sum(rates) / len(rates) if rates else None
    if differences[-1] <= ROUNDING:
        return rate, True
    falls = rate is not None and rate >= LEAST_RATE
    return rate, falls and differences[-1] == min(differences)


def _refined(
    experiment: Experiment,
    integrator: str,
    stride: int,
    *,
    longest: float,
    needed: float = 0.0,
    progress: Progress = silent,
) -> Iterator[tuple[int, Reals]]:
    """Yield (steps a frame, frames) for steps that are halved, while that is affordable."""
    plain = configured(experiment, {"integrator": integrator, "step_check": "warn"})
    steps = max(1, math.ceil(1.5 * experiment.save_interval / stable_step(plain)))
    before: Reals | None = None
    last = math.inf
    for number in itertools.count(1):
        progress(0.0, f"reference: {integrator}, {steps} steps a frame")
        setting = {"integrator": integrator, "steps_per_frame": steps}
        outcome = run_in_memory(configured(experiment, setting), stride=stride)
        yield steps, outcome.positions
        difference = math.inf
        if before is not None:
            difference = float(error_over_time(before, outcome.positions).max())
        if 2.0 * outcome.seconds > longest:
            return
        # Two differences show whether they fall; rounding cannot be refined.
        rounding = last < 1e-8 and difference > 0.5 * last
        if number >= 3 and (difference <= max(needed, ROUNDING) or rounding):
            return
        before, last, steps = outcome.positions, difference, 2 * steps


def second_opinion(
    positions: Reals,
    experiment: Experiment,
    integrator: str,
    *,
    stride: int,
    uncertainty: float,
    longest: float,
) -> Check:
    """Compare frames with a second method, extrapolated to vanishing steps by its order.

    Parameters
    ----------
    positions : (T, N, 3) [m]
    experiment : Experiment
        That ends with the last of them.
    uncertainty : float [1]
        What they are wrong by: nobody need know better.
    """
    order = INTEGRATORS[integrator].order
    if can_touch(experiment):
        order = 0  # impacts leave nothing to extrapolate by
    name = integrator + (" with Richardson's extrapolation" if order else "")
    best: tuple[float, float] | None = None
    before = extrapolated = None
    try:
        for _, frames in _refined(experiment, integrator, stride, longest=longest):
            earlier, extrapolated = extrapolated, frames
            if before is not None and order:
                extrapolated = frames + (frames - before) / (2.0**order - 1.0)
            before = frames
            if earlier is None:
                continue
            own = float(error_over_time(earlier, extrapolated).max())
            other = float(error_over_time(extrapolated, positions).max())
            if best is None or own < best[0]:
                best = own, other
            if own < max(uncertainty, ROUNDING):
                break
    except OpenPRCError as problem:
        return Check(method=name, note=f"{integrator} could not check it: {problem.found}")
    if best is None:
        why = "no two of its runs are affordable"
        return Check(method=name, note=f"{integrator} could not check it: {why}")
    own, other = best
    agrees = other <= 10.0 * (own + uncertainty)
    return Check(
        method=name,
        difference=other,
        uncertainty=own,
        agrees=agrees,
        note="" if agrees else f"{integrator} comes to another motion: it differs by {other:.1e}",
    )


def _first_above(profile: Reals, bound: float) -> int:
    """Return the number of frames before the first one that is wrong by more than `bound`."""
    above = np.flatnonzero(~(profile <= bound))
    return int(above[0]) if len(above) else len(profile)
