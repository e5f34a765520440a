"""Pixels as fractions of the image, for when nothing is known about the camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from openprc.vision.calibration.mapping import Array, Calibration, as_points, frame_size


@dataclass(frozen=True, eq=False)
class NormalizedCalibration(Calibration):
    """Fractions of the image's width and height: x / W and y / H.

    Parameters
    ----------
    frame_shape : (int, int)
        Height and width of the images [px].
    isotropic : bool
        Divide x and y by the same number, the longer side. Otherwise a length means something
        else along x than along y, unless the images are square.
    y_up : bool
        Count y from the lower edge upwards.

    Examples
    --------
    >>> NormalizedCalibration((480, 640)).to_physical([320.0, 240.0])
    array([0.5, 0.5])
    >>> NormalizedCalibration((480, 640), isotropic=True).to_physical([320.0, 240.0])
    array([0.5  , 0.375])
    """

    frame_shape: tuple[int, int]
    isotropic: bool = False
    y_up: bool = field(default=False, kw_only=True)

    kind: ClassVar[str] = "normalized"
    units: ClassVar[str] = "1"  # type: ignore[misc]

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame_shape", frame_size(self.frame_shape))

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What is different along x and y."""
        height, width = self.frame_shape
        if self.isotropic or height == width:
            return ()
        return (
            f"x is divided by {width} and y by {height}: distances, path lengths, angles and "
            "magnitudes are distorted; isotropic=True divides both by the longer side",
        )

    @property
    def _divisors(self) -> Array:
        height, width = self.frame_shape
        return np.array([max(height, width)] * 2 if self.isotropic else [width, height], np.float64)

    def _flip(self, points: Array) -> Array:
        if self.y_up:
            points[..., 1] = self.frame_shape[0] - points[..., 1]
        return points

    def to_physical(self, points: ArrayLike) -> Array:
        """Return fractions of the image, (..., 2) [px] -> (..., 2) [1]; NaN stays NaN."""
        return self._flip(as_points(points).copy()) / self._divisors

    def to_pixels(self, points: ArrayLike) -> Array:
        """Return pixels, (..., 2) [1] -> (..., 2) [px]."""
        return self._flip(as_points(points) * self._divisors)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_physical`, (..., 2, 2) [1/px]."""
        slope = np.diag([1.0, -1.0 if self.y_up else 1.0] / self._divisors)
        return np.broadcast_to(slope, (*as_points(points).shape[:-1], 2, 2)).copy()

    def rescaled(self, shape: tuple[int, int]) -> NormalizedCalibration:
        """Return the same for images of another size."""
        return NormalizedCalibration(shape, isotropic=self.isotropic, y_up=self.y_up)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "kind": self.kind,
            "units": self.units,
            "frame_shape": list(self.frame_shape),
            "isotropic": self.isotropic,
            "y_up": self.y_up,
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> NormalizedCalibration:
        """Make it from `as_dict`."""
        return cls(
            tuple(values["frame_shape"]),
            isotropic=bool(values.get("isotropic", False)),
            y_up=bool(values.get("y_up", False)),
        )


def auto_calibration(source: Any, *, isotropic: bool = False) -> NormalizedCalibration:
    """Return the calibration that needs nothing: fractions of the image.

    Parameters
    ----------
    source : VideoSource, image or (height, width)
        What has the size of the images.
    isotropic : bool
        Divide x and y by the same number.
    """
    return NormalizedCalibration(getattr(source, "shape", source), isotropic=isotropic)
