"""What the tracker can be told."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from openprc.errors import ConfigError
from openprc.vision.tracking.refinement import RefineSettings


@dataclass(frozen=True, kw_only=True)
class KLTConfig:
    """Settings of the tracker.

    Parameters
    ----------
    win_size : (int, int) [px]
        Window of the pyramidal Lucas-Kanade step, width and height.
    max_level : int or "auto"
        Pyramid levels above the full image. "auto" takes 3, and 5 while points move by more
        than 12 px a frame, as long as the smallest image is twice the window.
    max_iterations : int
        Iterations at each level.
    epsilon : float [px], optional
        A level ends when the step is below this. Left out, 0.01 px, and 0.1 px where the result
        is refined anyway.
    fb_threshold : float [px]
        Largest distance between a point and where it is led by following it forward and back
        (Kalal et al. 2010, DOI 10.1109/ICPR.2010.675).
    refine : "icgn" or "none"
        "icgn" refines every position against a template of the reference frame, so that errors
        do not add up, and gives quality and one-sigma. "none" is plain Lucas-Kanade from frame
        to frame, in which a lost point stays lost.
    refinement : RefineSettings
        Subset size, shape function and acceptance of the refinement.
    max_offset : float [px]
        Farthest that the refinement may end from where it was led.
    max_step : float [px], optional
        Farthest that a point may move between two frames; no limit where left out.
    reacquire : bool
        Look for lost points again in every frame.
    search_radius : int [px]
        How far from its expected position a lost point is looked for.
    neighbours : int
        Points around a point that say how it ought to move.
    consistency : float [px]
        A point that departs from its neighbours by more than this, and by more than three
        of their own deviations, is checked for a match where they lead to.
    key_quality : float
        A new template is cut where the correlation of a point and of its neighbours has lastingly
        gone this part of the way from what it was to where it would be refused,
    key_rotation : float [deg]
        or half of that where the template has turned by more than this,
    key_strain : float
        or has been stretched by more than this.
    backward_memory : float [MB]
        Frames before the reference frame are followed backward from it if they fit in here.
    """

    win_size: tuple[int, int] = (21, 21)
    max_level: int | Literal["auto"] = "auto"
    max_iterations: int = 30
    epsilon: float | None = None
    fb_threshold: float = 0.2
    refine: Literal["icgn", "none"] = "icgn"
    refinement: RefineSettings = field(default_factory=RefineSettings)
    max_offset: float = 3.0
    max_step: float | None = None
    reacquire: bool = True
    search_radius: int = 10
    neighbours: int = 12
    consistency: float = 1.5
    key_quality: float = 0.7
    key_rotation: float = 25.0
    key_strain: float = 0.25
    backward_memory: float = 256.0

    def __post_init__(self) -> None:
        if self.epsilon is None:
            object.__setattr__(self, "epsilon", 0.01 if self.refine == "none" else 0.1)
        size = self.win_size
        if isinstance(size, int):
            size = (size, size)
        size = tuple(size)
        if len(size) != 2 or not all(int(edge) == edge and edge >= 3 for edge in size):
            raise ConfigError(
                f"win_size is {self.win_size!r}",
                expected="two whole numbers of at least 3 px, width and height",
                fix="take (21, 21)",
                key="win_size",
            )
        object.__setattr__(self, "win_size", (int(size[0]), int(size[1])))
        if self.max_level != "auto" and not (
            isinstance(self.max_level, int) and 0 <= self.max_level <= 10
        ):
            raise ConfigError(
                f"max_level is {self.max_level!r}",
                expected='a whole number from 0 to 10, or "auto"',
                fix='take "auto"',
                key="max_level",
            )
        if self.refine not in ("icgn", "none"):
            raise ConfigError(
                f"refine is {self.refine!r}",
                expected='"icgn" or "none"',
                fix='take "icgn"; "none" is plain Lucas-Kanade',
                key="refine",
            )
        least = {"max_iterations": 1, "search_radius": 0, "neighbours": 3}
        positive = ("epsilon", "fb_threshold", "max_offset", "consistency")
        for name in (
            *least,
            *positive,
            "key_quality",
            "key_rotation",
            "key_strain",
            "backward_memory",
        ):
            self._check_number(name, getattr(self, name), least.get(name, 0))
        if self.max_step is not None:
            self._check_number("max_step", self.max_step, 0)

    @staticmethod
    def _check_number(name: str, value: float, least: float) -> None:
        if not (isinstance(value, int | float) and math.isfinite(value) and value >= least):
            raise ConfigError(
                f"{name} is {value!r}",
                expected=f"a number of at least {least}",
                fix="leave it out for the default",
                key=name,
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, for JSON."""
        return asdict(self)
