"""`Choices`: what is studied of a scene, and for how long."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from openprc.demlat.integrators import INTEGRATORS
from openprc.tradeoff.refinement import ROUNDING
from openprc.tradeoff.scene_kinds import has_constraints
from openprc.tradeoff.settings import GROUPS, OFFERED, check_names

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Errors below this are of no use to anyone, and cost the most to measure.
GOOD_ENOUGH = 3e-9
#: With a target, ladders end this far below it.
BELOW_TARGET = 0.1
#: The reference is known to this share of a target.
OF_TARGET = 1e-3


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What is studied, and for how long.

    Parameters
    ----------
    groups : tuple of str
        Some of `openprc.tradeoff.settings.GROUPS`.
    integrators : tuple of str, optional
        By default all, but those for constraints where there are none.
    target : float, optional [1]
        Error that is wanted: ladders end below it, and are refined around it.
    metric : str
        What it is an error of: "trajectory", or a figure of `openprc.compare.task_scores`.
    longest : float [s]
        CPU time that one run may take.
    budget : float, optional [s]
        Wall-clock time for all measurements.
    rounds : int
        Timings that a CPU time is the median of.
    folder : Path, optional
        Where points and reference are kept, so that an interrupted study is continued.

    Raises
    ------
    ConfigError
        When a group or an integrator is not there.
    """

    groups: tuple[str, ...] = ("integrator", "constraints", "precision", "storage")
    integrators: tuple[str, ...] | None = None
    target: float | None = None
    metric: str = "trajectory"
    longest: float = 5.0
    budget: float | None = None
    rounds: int = 3
    folder: Path | None = None

    def __post_init__(self) -> None:
        check_names(self.groups, GROUPS, what="group")
        check_names(self.integrators or (), OFFERED, what="integrator")

    @property
    def enough(self) -> float:
        """Error at which ladders end."""
        if self.target is None or self.metric != "trajectory":
            return GOOD_ENOUGH
        return max(BELOW_TARGET * self.target, GOOD_ENOUGH)

    @property
    def needed(self) -> float:
        """How well the reference has to be known."""
        if self.target is None or self.metric != "trajectory":
            return ROUNDING
        return max(OF_TARGET * self.target, ROUNDING)

    def schemes(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the integrators that are tried on a scene."""
        if self.integrators is not None:
            return self.integrators
        bound = has_constraints(experiment)
        return tuple(n for n in OFFERED if bound or INTEGRATORS[n].rigid == "no")
