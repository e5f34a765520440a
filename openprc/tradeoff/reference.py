"""The motion that errors are measured against, and how well it is known."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
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
#: Frames are thinned to about so many numbers.
LARGEST = 20_000_000


@dataclass(frozen=True, kw_only=True)
class ConvergedReference:
    """Frames, and what proves them.

    Attributes
    ----------
    positions : (T, N, 3) [m]
    stride : int
        Which frames of the scene these are: every stride-th.
    horizon, duration : float [s]
        Up to where errors mean something, and how long the scene is.
    method : str
        How the frames were made.
    setting : mapping
        Of the run that the frames are of; see `openprc.tradeoff.settings.configured`.
    differences : tuple of float [1]
        Between solutions that follow each other in refinement, coarse ones first.
    rate : float or None
        Power of the step by which differences fall; None where a tolerance was lowered.
    uncertainty : float [1]
        What the frames are wrong by, in the unit of `relative_error`.
    check_method : str
        An independent second method; empty where there is none.
    check_difference, check_uncertainty : float or None [1]
        Between both methods, and of the second one by its own refinement.
    closed_form_difference : float or None [1]
        From the formula of the scene, where there is one.
    converged : bool
        Whether differences fall, and both methods agree as well as they know.
    notes : tuple of str
    """

    positions: Reals
    stride: int
    horizon: float
    duration: float
    method: str
    setting: Mapping[str, Any]
    differences: tuple[float, ...]
    rate: float | None
    uncertainty: float
    check_method: str = ""
    check_difference: float | None = None
    check_uncertainty: float | None = None
    closed_form_difference: float | None = None
    converged: bool = True
    notes: tuple[str, ...] = field(default=())

    @property
    def floor(self) -> float:
        """Errors below this are not told apart from those of the reference."""
        return 10.0 * self.uncertainty

    def sentence(self) -> str:
        """Say in one sentence what is known."""
        text = f"{self.method}: good to {self.uncertainty:.1e}"
        if self.check_difference is not None:
            text += (
                f"; {self.check_method} differs by {self.check_difference:.1e},"
                f" being good to {self.check_uncertainty:.1e} itself"
            )
        elif not self.check_method:
            text += "; no second method can do this scene"
        if self.closed_form_difference is not None:
            text += f"; from the closed form it differs by {self.closed_form_difference:.1e}"
        return text if self.converged else f"NOT CONVERGED - {text}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON; without the frames."""
        names = (
            "stride", "horizon", "duration", "method", "setting", "differences", "rate",
            "uncertainty", "check_method", "check_difference", "check_uncertainty",
            "closed_form_difference", "converged", "notes",
        )  # fmt: skip
        values = {name: getattr(self, name) for name in names}
        values["differences"], values["notes"] = list(self.differences), list(self.notes)
        values["setting"] = dict(self.setting)
        return values


def is_smooth(experiment: Experiment) -> bool:
    """Say whether a scheme that chooses its steps can run it: no constraints, no impacts."""
    return not (has_constraints(experiment) or can_touch(experiment))


def has_constraints(experiment: Experiment) -> bool:
    """Say whether elements are rigid, or have hard stops."""
    geometry = experiment.geometry
    rigid = geometry.bars.rigid.any() or geometry.hinges.rigid.any()
    return bool(rigid) or has_stops(experiment)


def has_stops(experiment: Experiment) -> bool:
    """Say whether hinges have hard stops."""
    hinges = experiment.geometry.hinges
    return bool((hinges.limited & (hinges.law == "linear")).any())


def converged_reference(
    experiment: Experiment,
    *,
    longest: float,
    needed: float = ROUNDING,
    exact: Callable[[Reals], Reals] | None = None,
    progress: Progress = silent,
) -> ConvergedReference:
    """Integrate a scene until its frames are known, and say how well.

    A smooth scene is integrated by dop853 at falling tolerances, and once more by rk4 with
    Richardson's extrapolation; a body with rigid elements by rk4-dae at falling steps, and by
    rattle; one with contact by rk4, and by verlet; one with hard stops by rk4-projection.
    Where solutions part before the end, the horizon is where they part.

    Parameters
    ----------
    experiment : Experiment
    longest : float [s]
        Refinement ends before a run would take longer than `PATIENCE` times this.
    needed : float [1]
        Uncertainty that is good enough.
    exact : callable, optional
        Times (T,) [s] to positions (T, N, 3) [m], where a formula gives them.

    Raises
    ------
    NotConverged
        When not even the first frames are known to a tenth.
    UnsupportedScene, Diverged
        When the scene cannot be run, or no step that is affordable keeps it together.

    References
    ----------
    Richardson's extrapolation and estimates of the order from three grids: Roache 1998,
    doi:10.1146/annurev.fluid.29.1.123.
    """
    stride = max(1, experiment.n_frames * experiment.geometry.n_nodes * 3 // LARGEST)
    if is_smooth(experiment):
        found = _by_tolerance(experiment, stride, longest=longest, needed=needed, progress=progress)
        second = ("rk4", 4)
    else:
        rigid = has_constraints(experiment)
        first = ("rk4-dae", 4) if rigid else ("rk4", 4)
        second = ("rattle", 2) if rigid else ("verlet", 2)
        if has_stops(experiment):
            first, second = ("rk4-projection", 2), ("", 0)
        found = _by_step(
            experiment, first[0], stride, longest=longest, needed=needed, progress=progress
        )
    found = _cut_at_horizon(found, experiment)
    if second[0]:
        progress(0.7, f"reference: checking with {second[0]}")
        found = _checked(found, experiment, second[0], longest=longest)
    if exact is not None:
        times = np.arange(len(found.positions)) * stride * experiment.save_interval
        formula = np.asarray(exact(times), dtype=np.float64)
        difference = float(error_over_time(found.positions, formula).max())
        found = replace(found, closed_form_difference=difference)
    if not found.uncertainty < 0.1:
        raise NotConverged(
            f"no reference: refinement still changes the motion by {found.uncertainty:.2g} of it"
            f" ({found.method})",
            expected="solutions that come together",
            fix="allow longer runs with --longest, or shorten the scene",
            key="simulation.duration",
        )
    return found


# --- the first method ---------------------------------------------------------------------------


def _by_tolerance(
    experiment: Experiment, stride: int, *, longest: float, needed: float, progress: Progress
) -> ConvergedReference:
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
    differences = tuple(float(profile.max()) for profile in profiles)
    return ConvergedReference(
        positions=frames,
        stride=stride,
        horizon=_until(profiles[-1], HORIZON_ERROR, experiment, stride),
        duration=experiment.duration,
        method=f"dop853 at tolerances {tried[0]:g} to {tried[-1]:g}",
        setting={"integrator": "dop853", "tolerance": tried[-1]},
        differences=differences,
        rate=None,
        uncertainty=max(differences[-1], float(np.finfo(float).eps)),
        converged=differences[-1] <= max(0.5 * differences[0], ROUNDING),
    )


def _by_step(
    experiment: Experiment,
    integrator: str,
    stride: int,
    *,
    longest: float,
    needed: float,
    progress: Progress,
) -> ConvergedReference:
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
        differences = tuple(float(profile[:stop].max()) for profile in profiles)
        rate, converged = _fall(differences)
        if converged or stop < 2:
            break
    # The tail of a geometric series, at no more than the order that the scheme has.
    power = min(max(rate, LEAST_RATE), INTEGRATORS[integrator].order)
    uncertainty = max(differences[-1] / (2.0**power - 1.0), float(np.finfo(float).eps))
    return ConvergedReference(
        positions=frames[-1],
        stride=stride,
        horizon=(stop - 1) * stride * experiment.save_interval,
        duration=experiment.duration,
        method=f"{integrator} with {counts[0]} to {counts[-1]} steps a frame",
        setting={"integrator": integrator, "steps_per_frame": counts[-1]},
        differences=differences,
        rate=rate,
        uncertainty=uncertainty,
        converged=converged,
    )


def _fall(differences: tuple[float, ...]) -> tuple[float, bool]:
    """Return the rate of the last differences, and whether it is one."""
    # Differences of rounding fall no further, and are as good as none.
    last = [d for d in differences if d > ROUNDING][-3:]
    rates = [math.log2(a / b) for a, b in itertools.pairwise(last)]
    rate = sum(rates) / len(rates) if rates else math.inf
    if differences[-1] <= ROUNDING:
        return rate, True
    return rate, rate >= LEAST_RATE and differences[-1] == min(differences)


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


# --- the second method, and the horizon ---------------------------------------------------------


def _checked(
    found: ConvergedReference, experiment: Experiment, integrator: str, *, longest: float
) -> ConvergedReference:
    """Compare with a second method, extrapolated to vanishing steps by its order."""
    experiment = replace(experiment, duration=found.horizon)
    order = INTEGRATORS[integrator].order
    if not is_smooth(experiment) and can_touch(experiment):
        order = 0  # impacts leave nothing to extrapolate by
    best: tuple[float, float] | None = None
    before = extrapolated = None
    try:
        for _, frames in _refined(experiment, integrator, found.stride, longest=longest):
            earlier, extrapolated = extrapolated, frames
            if before is not None and order:
                extrapolated = frames + (frames - before) / (2.0**order - 1.0)
            before = frames
            if earlier is None:
                continue
            own = float(error_over_time(earlier, extrapolated).max())
            other = float(error_over_time(extrapolated, found.positions).max())
            if best is None or own < best[0]:
                best = own, other
            if own < max(found.uncertainty, 1e-10):
                break
    except OpenPRCError as problem:
        note = f"{integrator} could not check it: {problem.found}"
        return replace(found, check_method=integrator, notes=(*found.notes, note))
    if best is None:
        note = f"{integrator} could not check it: no two of its runs are affordable"
        return replace(found, check_method=integrator, notes=(*found.notes, note))
    own, other = best
    agrees = other <= 10.0 * (own + found.uncertainty)
    note = () if agrees else (f"{integrator} comes to another motion: it differs by {other:.1e}",)
    return replace(
        found,
        check_method=integrator + (" with Richardson's extrapolation" if order else ""),
        check_difference=other,
        check_uncertainty=own,
        converged=found.converged and agrees,
        notes=(*found.notes, *note),
    )


def _first_above(profile: Reals, bound: float) -> int:
    """Return the number of frames before the first one that is wrong by more than `bound`."""
    above = np.flatnonzero(~(profile <= bound))
    return int(above[0]) if len(above) else len(profile)


def _until(profile: Reals, bound: float, experiment: Experiment, stride: int) -> float:
    return (_first_above(profile, bound) - 1) * stride * experiment.save_interval


def _cut_at_horizon(found: ConvergedReference, experiment: Experiment) -> ConvergedReference:
    frames = round(found.horizon / experiment.save_interval) // found.stride + 1
    if frames >= len(found.positions):
        return replace(found, horizon=experiment.duration)
    if frames < 3:
        raise NotConverged(
            f"no reference: solutions part by {found.differences[-1]:.2g} of the motion"
            f" ({found.method}), the first time before the third frame",
            expected="solutions that come together",
            fix="save more frames at the start, or allow longer runs with --longest",
            key="simulation.save_interval",
        )
    bound = HORIZON_ERROR if found.rate is None else COARSE_HORIZON_ERROR
    note = (
        f"the motion is known to {bound:g} only up to t = {found.horizon:g} s of"
        f" {found.duration:g} s, where solutions part: errors are measured up to there"
    )
    uncertainty = min(found.uncertainty, bound)
    return replace(
        found,
        positions=found.positions[:frames],
        uncertainty=uncertainty,
        notes=(*found.notes, note),
    )


__all__ = ["ConvergedReference", "converged_reference", "has_constraints", "has_stops", "is_smooth"]
