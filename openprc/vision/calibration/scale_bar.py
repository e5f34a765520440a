"""A known length in the image: two points and the distance between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from openprc.errors import CalibrationError
from openprc.vision.calibration.mapping import (
    Array,
    Calibration,
    as_points,
    finite,
    frame_size,
    length_unit,
)


@dataclass(frozen=True, eq=False)
class ScaleBar(Calibration):
    """One scale for the whole image, from two points a known distance apart.

    Right where the motion is in a plane parallel to the sensor, at the depth of the bar, and the
    lens does not distort. `PlanarTarget` takes a tilt into account.

    Parameters
    ----------
    p0, p1 : (2,) [px]
        Ends of the bar.
    length : float [units]
        Distance between them.
    units : str
        Unit of length.
    sigma_px : float [px]
        One-sigma of each coordinate of either end: half a pixel for a click.
    sigma_length : float [units]
        One-sigma of the length itself.
    origin : (2,) [px]
        Pixel where the physical coordinates are zero.
    y_up : bool
        Count y upwards.
    frame_shape : (int, int), optional
        Height and width of the images [px], to notice a recording of another size.

    Raises
    ------
    CalibrationError
        When the ends coincide, or a number makes no sense.

    Examples
    --------
    >>> bar = ScaleBar((100.0, 50.0), (300.0, 50.0), 40.0, "mm")
    >>> bar.scale, bar.to_physical([10.0, 20.0])
    (0.2, array([2., 4.]))
    """

    p0: tuple[float, float]
    p1: tuple[float, float]
    length: float
    units: str = "mm"
    sigma_px: float = field(default=0.5, kw_only=True)
    sigma_length: float = field(default=0.0, kw_only=True)
    origin: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)
    y_up: bool = field(default=False, kw_only=True)
    frame_shape: tuple[int, int] | None = field(default=None, kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    kind: ClassVar[str] = "scale-bar"

    def __post_init__(self) -> None:
        put = object.__setattr__
        for key in ("p0", "p1", "origin"):
            x, y = as_points(getattr(self, key), key=key).reshape(-1, 2)[0]
            put(self, key, (finite(x, key=key), finite(y, key=key)))
        put(self, "length", finite(self.length, key="length", above=0.0))
        for key in ("sigma_px", "sigma_length"):
            value = finite(getattr(self, key), key=key)
            if value < 0.0:
                raise CalibrationError(
                    f"{key} is {value:g}",
                    expected="a one-sigma of 0 or more",
                    fix="give how far the value may be off",
                    key=key,
                )
            put(self, key, value)
        put(self, "units", length_unit(self.units))
        put(self, "y_up", bool(self.y_up))
        put(self, "notes", tuple(self.notes))
        if self.frame_shape is not None:
            put(self, "frame_shape", frame_size(self.frame_shape))
        if self.length_px < 1.0:
            raise CalibrationError(
                f"the ends of the scale bar are {self.length_px:.3g} px apart",
                expected="two points far apart: the longer the bar, the better the scale",
                fix="mark two points of known distance across the image",
                key="p1",
            )

    @property
    def length_px(self) -> float:
        """Distance of the ends in the image [px]."""
        return math.dist(self.p0, self.p1)

    @property
    def scale(self) -> float:
        """Length of a pixel [units/px]."""
        return self.length / self.length_px

    @property
    def relative_sigma(self) -> float:
        """One-sigma of the scale over the scale; common to all lengths measured with it.

        The variance of the distance of two points is twice that of a coordinate.
        """
        ends = math.sqrt(2.0) * self.sigma_px / self.length_px
        return math.hypot(ends, self.sigma_length / self.length)

    @property
    def _slopes(self) -> Array:
        return self.scale * np.array([1.0, -1.0 if self.y_up else 1.0])

    def to_physical(self, points: ArrayLike) -> Array:
        """Return positions from the origin, (..., 2) [px] -> (..., 2) [units]."""
        return (as_points(points) - self.origin) * self._slopes

    def to_pixels(self, points: ArrayLike) -> Array:
        """Return pixels, (..., 2) [units] -> (..., 2) [px]."""
        return as_points(points) / self._slopes + self.origin

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_physical`, (..., 2, 2) [units/px]."""
        shape = as_points(points).shape[:-1]
        return np.broadcast_to(np.diag(self._slopes), (*shape, 2, 2)).copy()

    def rescaled(self, shape: tuple[int, int]) -> ScaleBar | None:
        """Return the same bar in images of another resolution."""
        if self.frame_shape is None:
            return None
        new = frame_size(shape)
        factor = new[1] / self.frame_shape[1]

        def moved(point: tuple[float, float]) -> tuple[float, float]:
            # The corner of the image, not the centre of its first pixel, stays where it is.
            return ((point[0] + 0.5) * factor - 0.5, (point[1] + 0.5) * factor - 0.5)

        return ScaleBar(
            moved(self.p0),
            moved(self.p1),
            self.length,
            self.units,
            sigma_px=self.sigma_px * factor,
            sigma_length=self.sigma_length,
            origin=moved(self.origin),
            y_up=self.y_up,
            frame_shape=new,
            notes=self.notes,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "kind": self.kind,
            "units": self.units,
            "p0": list(self.p0),
            "p1": list(self.p1),
            "length": self.length,
            "sigma_px": self.sigma_px,
            "sigma_length": self.sigma_length,
            "origin": list(self.origin),
            "y_up": self.y_up,
            "frame_shape": None if self.frame_shape is None else list(self.frame_shape),
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> ScaleBar:
        """Make it from `as_dict`."""
        return cls(**{key: value for key, value in values.items() if key != "kind"})
