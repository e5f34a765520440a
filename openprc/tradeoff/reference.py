"""The motion that errors are measured against, and how well it is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import NotConverged
from openprc.hooks.running import silent
from openprc.tradeoff import refinement
from openprc.tradeoff.outcome import error_over_time
from openprc.tradeoff.refinement import ROUNDING, Refined
from openprc.tradeoff.scene_kinds import has_constraints, has_stops, is_smooth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.hooks.protocols import Progress
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

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
        Power of the step by which differences fall; None where a tolerance was lowered, or
        differences are rounding from the start.
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
        if self.converged:
            return 10.0 * self.uncertainty
        # What does not converge, or is contradicted, is wrong by all that was seen.
        return 10.0 * max(self.uncertainty, self.differences[-1], self.check_difference or 0.0)

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
    limits = {"longest": longest, "needed": needed, "progress": progress}
    if is_smooth(experiment):
        first = refinement.by_tolerance(experiment, stride, **limits)
        second = "rk4"
    elif has_stops(experiment):
        first, second = refinement.by_step(experiment, "rk4-projection", stride, **limits), ""
    elif has_constraints(experiment):
        first, second = refinement.by_step(experiment, "rk4-dae", stride, **limits), "rattle"
    else:
        first, second = refinement.by_step(experiment, "rk4", stride, **limits), "verlet"
    found = _from_first(first, experiment, stride)
    if second:
        progress(0.7, f"reference: checking with {second}")
        check = refinement.second_opinion(
            found.positions,
            replace(experiment, duration=found.horizon),
            second,
            stride=stride,
            uncertainty=found.uncertainty,
            longest=longest,
        )
        found = replace(
            found,
            check_method=check.method,
            check_difference=check.difference,
            check_uncertainty=check.uncertainty,
            converged=found.converged and check.agrees,
            notes=(*found.notes, *([check.note] if check.note else [])),
        )
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


def _from_first(first: Refined, experiment: Experiment, stride: int) -> ConvergedReference:
    n_frames = len(first.positions)
    whole = n_frames > (experiment.n_frames - 1) // stride
    if not whole and n_frames < 3:
        raise NotConverged(
            f"no reference: solutions part before the third frame ({first.method})",
            expected="solutions that come together",
            fix="save more frames at the start, or allow longer runs with --longest",
            key="simulation.save_interval",
        )
    notes = () if whole else (
        f"solutions part after t = {first.horizon:g} s of {experiment.duration:g} s: errors are"
        f" measured up to there, where the motion is known to {first.uncertainty:.1e}",
    )  # fmt: skip
    return ConvergedReference(
        positions=first.positions,
        stride=stride,
        horizon=experiment.duration if whole else first.horizon,
        duration=experiment.duration,
        method=first.method,
        setting=first.setting,
        differences=first.differences,
        rate=first.rate,
        uncertainty=first.uncertainty,
        converged=first.converged,
        notes=notes,
    )


__all__ = ["ROUNDING", "ConvergedReference", "converged_reference"]
