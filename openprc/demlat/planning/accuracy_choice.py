"""What was chosen for an accuracy, and why."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.demlat.planning.accuracy_search import Candidate


@dataclass(frozen=True, kw_only=True)
class AccuracyChoice:
    """What was chosen, and why.

    Attributes
    ----------
    accuracy : float [1]
        What was asked for.
    integrator : str
    dt : float [s]
        Of an adaptive scheme the first step.
    tolerance : float or None [1]
        Of an adaptive scheme.
    error : float [1]
        Estimated for the whole run.
    promised : bool
        Whether the estimate is below `accuracy`, and nothing speaks against it.
    pilot_duration, duration : float [s]
    pilot_evaluations, evaluations : int
        Of all forces, by the pilot and, expected, by the run.
    pilot_share : float
        Cost of the pilot over that of the run.
    candidates : tuple of Candidate
        Every scheme that was tried, the chosen one first.
    remarks : tuple of str
        What speaks against the estimate.
    at_limit : bool
        Whether a larger step, which the accuracy would allow, is not stable.
    """

    accuracy: float
    integrator: str
    dt: float
    tolerance: float | None
    error: float
    promised: bool
    pilot_duration: float
    duration: float
    pilot_evaluations: int
    evaluations: int
    pilot_share: float
    candidates: tuple[Candidate, ...]
    remarks: tuple[str, ...]
    at_limit: bool = False

    @property
    def setting(self) -> str:
        """The choice in a few words."""
        if self.tolerance is not None:
            return f"{self.integrator} to a tolerance of {self.tolerance:.3g}"
        return f"{self.integrator} with steps of {self.dt:.4g} s"

    @property
    def note(self) -> str:
        """What stands in the file of the run."""
        whole = self.pilot_duration >= self.duration * (1.0 - 1e-9)
        length = "the whole run" if whole else f"the first {self.pilot_duration:.3g} s"
        text = (
            f"accuracy {self.accuracy:g}: {self.setting} was chosen, for an estimated error of"
            f" {self.error:.1e} of the rms displacement, by a pilot of {length}"
            f" ({self.pilot_evaluations:,} evaluations of the forces; the run takes about"
            f" {self.evaluations:,})"
        )
        if self.tolerance is None and self.at_limit:
            text += "; the step is the largest that is stable, or a frame"
        others = [self._other(candidate) for candidate in self.candidates[1:]]
        if others:
            text += "; " + ", ".join(others)
        return text

    def _other(self, other: Candidate) -> str:
        best = self.candidates[0].cost
        if other.verdict == "diverged":
            return f"{other.name} diverged"
        if other.verdict == "left":
            return f"{other.name} was left at {other.error:.1e}"
        if other.verdict == "stalled":
            return f"{other.name} got no nearer than {other.error:.1e}"
        least = "at least " if other.verdict == "dearer" else ""
        return f"{other.name} would cost {least}{other.cost / best:.2g} times as much"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        data = asdict(self)
        for candidate in data["candidates"]:
            if not math.isfinite(candidate["error"]):
                candidate["error"] = None
        return data | {"note": self.note}

    def rows(self) -> list[tuple[str, str]]:
        """Return what a table shows: name and text."""
        rows = [
            ("accuracy", f"{self.accuracy:g}: {self.setting}"),
            ("estimated error", f"{self.error:.1e} of the rms displacement"),
            (
                "pilot",
                f"{self.pilot_duration:.3g} s, {self.pilot_evaluations:,} evaluations,"
                f" {self.pilot_share:.2g} of the cost of the run",
            ),
        ]
        return rows + [("instead", self._other(other)) for other in self.candidates[1:]]
