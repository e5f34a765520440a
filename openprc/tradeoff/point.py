"""`Point`: one setting, what it cost, and how wrong it was."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Status = Literal["ok", "diverged", "refused", "failed"]


@dataclass(frozen=True, kw_only=True)
class Point:
    """The outcome of one setting of one scene.

    Parameters
    ----------
    group : str
        Which axis was varied: "integrator", "constraints", "precision", "storage", "backend",
        "model", "readout", "estimator".
    label : str
        What plots and tables call the family that the setting belongs to, such as "rk4".
    setting : mapping of str to str, int, float, bool or None
        Everything that was varied, enough to run it again.
    status : {"ok", "diverged", "refused", "failed"}
    note : str
        Why, unless it is ok.
    trajectory_error : float or None [1]
        Largest over frames of the rms position error over the rms displacement of the reference.
    scores : mapping of str to float
        Figures of tasks, such as ``narma2_nrmse``, ``memory_capacity``, ``ipc``.
    score_errors : mapping of str to float
        What they deviate from the figures of the reference by.
    cpu_seconds : float or None [s]
        Median of one thread, compiling left out.
    evaluations : int or None
        Of all forces.
    file_size : int or None [B]
    """

    group: str
    label: str
    setting: Mapping[str, Any]
    status: Status = "ok"
    note: str = ""
    trajectory_error: float | None = None
    scores: Mapping[str, float] = field(default_factory=dict)
    score_errors: Mapping[str, float] = field(default_factory=dict)
    cpu_seconds: float | None = None
    evaluations: int | None = None
    file_size: int | None = None

    def __post_init__(self) -> None:
        # An error that is no number would pass every comparison.
        values = (self.trajectory_error, *self.scores.values(), *self.score_errors.values())
        if self.status == "ok" and any(v is not None and not math.isfinite(v) for v in values):
            raise ValueError(f"the point {dict(self.setting)} is ok, and not all of it is finite")

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self) | {
            "setting": dict(self.setting),
            "scores": dict(self.scores),
            "score_errors": dict(self.score_errors),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Point:
        """Return the point that `as_dict` described."""
        return cls(**data)
