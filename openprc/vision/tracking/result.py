"""The tracks of all points through all frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.status import Status
from openprc.vision.tracking.track_steps import FrameTracks

if TYPE_CHECKING:
    from openprc.vision.source.time_axis import TimeAxis

_SEEN = (Status.TRACKED, Status.REFERENCE)
_PER_POINT = ("positions", "status", "quality", "sigma", "template", "deformation")


@dataclass(kw_only=True)
class TrackingResult:
    """Where the points are, how well that is known, and why some are missing.

    Attributes
    ----------
    positions : (T, N, 2) [px]
        (0, 0) is the centre of the upper left pixel, x right, y down; NaN = not found.
    status : (T, N)
        Codes of `openprc.vision.Status`.
    timestamps : (T,) [s]
        From the first frame.
    quality : (T, N)
        Zero-normalised cross-correlation with the template, NaN where not known.
    sigma : (T, N, 2) [px]
        One-sigma from noise and gradient, NaN where not known.
    template : (T, N)
        How many times the point's template had been renewed.
    deformation : (T, N, 2, 2)
        Deformation gradient since the reference frame, NaN where not known.
    time_axis : TimeAxis, optional
        Where the times come from, and which frames are missing.
    reference_frame : int
        The frame in which the points were placed.
    feature_ids : (N,)
        Rows of the feature map that the points were.
    noise : float [grey levels]
        One-sigma of the image noise as estimated, NaN where not known.
    config : KLTConfig, optional
    frame_shape : (int, int), optional
        Height and width of the images [px].
    notes : tuple of str
        What the user should know.
    """

    positions: NDArray[np.float64]
    status: NDArray[np.uint8]
    timestamps: NDArray[np.float64]
    quality: NDArray[np.float32] = field(default=None)  # type: ignore[assignment]
    sigma: NDArray[np.float32] = field(default=None)  # type: ignore[assignment]
    template: NDArray[np.int32] = field(default=None)  # type: ignore[assignment]
    deformation: NDArray[np.float32] = field(default=None)  # type: ignore[assignment]
    time_axis: TimeAxis | None = None
    reference_frame: int = 0
    feature_ids: NDArray[np.intp] = field(default=None)  # type: ignore[assignment]
    noise: float = np.nan
    config: KLTConfig | None = None
    frame_shape: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = self.positions.shape
        if len(shape) != 3 or shape[2] != 2:
            raise ConfigError(
                f"positions have the shape {shape}",
                expected="(T, N, 2): frames, points, x and y",
                fix="give the positions of a tracking run",
                key="positions",
            )
        n_frames, n_points = shape[:2]
        if self.quality is None:
            self.quality = np.full((n_frames, n_points), np.nan, np.float32)
        if self.sigma is None:
            self.sigma = np.full((n_frames, n_points, 2), np.nan, np.float32)
        if self.template is None:
            self.template = np.zeros((n_frames, n_points), np.int32)
        if self.deformation is None:
            self.deformation = np.full((n_frames, n_points, 2, 2), np.nan, np.float32)
        if self.feature_ids is None:
            self.feature_ids = np.arange(n_points)
        expected = {
            "status": (n_frames, n_points),
            "timestamps": (n_frames,),
            "quality": (n_frames, n_points),
            "sigma": (n_frames, n_points, 2),
            "template": (n_frames, n_points),
            "deformation": (n_frames, n_points, 2, 2),
            "feature_ids": (n_points,),
        }
        for name, wanted in expected.items():
            found = np.shape(getattr(self, name))
            if found != wanted:
                raise ConfigError(
                    f"{name} has the shape {found}",
                    expected=f"{wanted}, as positions have {shape}",
                    fix="give arrays of one and the same run",
                    key=name,
                )

    @classmethod
    def from_steps(
        cls, steps: Sequence[FrameTracks], *, timestamps: NDArray[np.float64], **attributes: Any
    ) -> TrackingResult:
        """Stack the frames of a run; `attributes` are those of the class."""
        arrays = {name: np.stack([getattr(step, name) for step in steps]) for name in _PER_POINT}
        return cls(timestamps=timestamps, **arrays, **attributes)

    @property
    def n_frames(self) -> int:
        """Number of frames, T."""
        return int(self.positions.shape[0])

    @property
    def n_features(self) -> int:
        """Number of points, N."""
        return int(self.positions.shape[1])

    @property
    def fps(self) -> float:
        """Mean frame rate [Hz] over the whole run, NaN for a single frame."""
        if self.n_frames < 2:
            return float("nan")
        return float((self.n_frames - 1) / (self.timestamps[-1] - self.timestamps[0]))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where a point was found, (T, N)."""
        return np.isin(self.status, _SEEN)

    def track_ratios(self) -> NDArray[np.float64]:
        """Return the fraction of frames in which each point was found, (N,)."""
        ratios: NDArray[np.float64] = self.seen.mean(axis=0)
        return ratios

    def alive(self) -> NDArray[np.float64]:
        """Return the fraction of points found in each frame, (T,)."""
        ratios: NDArray[np.float64] = self.seen.mean(axis=1)
        return ratios

    def template_updates(self) -> NDArray[np.int32]:
        """Return the largest number of renewals behind any position of each point, (N,)."""
        most: NDArray[np.int32] = np.where(self.seen, self.template, 0).max(axis=0)
        return most

    def filter(self, mask: NDArray[np.bool_]) -> TrackingResult:
        """Return the points where `mask` (N,) is true."""
        mask = np.asarray(mask)
        if mask.dtype != np.bool_ or mask.shape != (self.n_features,):
            raise ConfigError(
                f"the mask is {mask.dtype} of shape {mask.shape}",
                expected=f"bool of shape ({self.n_features},), one value for each point",
                fix="compare something with a bound, as in result.track_ratios() >= 0.6",
                key="mask",
            )
        chosen = {name: getattr(self, name)[:, mask] for name in _PER_POINT}
        return replace(self, feature_ids=self.feature_ids[mask], **chosen)

    def summary(self) -> dict[str, Any]:
        """Return the figures that tell whether the run can be trusted, as plain values."""
        seen = self.seen
        counted = max(1, self.status.size)
        last = self.status[-1] if self.n_frames else np.zeros(0, np.uint8)
        return {
            "frames": self.n_frames,
            "points": self.n_features,
            "duration_s": float(self.timestamps[-1] - self.timestamps[0]) if self.n_frames else 0.0,
            "found_fraction": float(seen.mean()) if seen.size else 0.0,
            "found_fraction_last_frame": float(np.isin(last, _SEEN).mean()) if last.size else 0.0,
            "fraction_by_status": {
                code.name.lower(): float((self.status == code).sum() / counted) for code in Status
            },
            "points_never_lost": int(seen.all(axis=0).sum()),
            "median_quality": _median(self.quality[seen]),
            "median_sigma_px": _median(self.sigma[seen].max(axis=-1)),
            "template_updates": int(self.template_updates().sum()),
            "noise_grey_levels": None if np.isnan(self.noise) else float(self.noise),
            "reference_frame": self.reference_frame,
            "notes": list(self.notes),
        }


def _median(values: NDArray[np.floating[Any]]) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None
