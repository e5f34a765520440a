"""What every calibration of one camera has in common: a map between pixels and a plane."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import CalibrationError
from openprc.schema.units import unit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FrameCheck:
    """Whether a calibration fits the images that it is used on.

    Attributes
    ----------
    calibration : Calibration
        The one to use: rescaled, where the recording has the same shape at another resolution.
    notes : tuple of str
        What was done.
    warning : str or None
        Why the result will be wrong, where it will be.
    """

    calibration: Calibration
    notes: tuple[str, ...] = ()
    warning: str | None = None


class Calibration(ABC):
    """A map between pixels and a plane.

    Attributes
    ----------
    kind : str
        Name in a calibration file.
    units : str
        Of `to_physical`, a symbol of `openprc.schema.units`; "1" for pure numbers.
    frame_shape : (int, int) or None
        Height and width of the images that it was made for [px].
    y_up : bool
        Whether y points against the rows of the image.
    notes : tuple of str
        What the user should know.
    """

    kind: ClassVar[str]
    n_dims: ClassVar[int] = 2
    units: str
    frame_shape: tuple[int, int] | None
    y_up: bool
    notes: tuple[str, ...]

    @property
    def axes(self) -> str:
        """Names of the physical axes."""
        return "x,y"

    @abstractmethod
    def to_physical(self, points: ArrayLike) -> Array:
        """Return where pixels lie on the plane.

        Parameters
        ----------
        points : (..., 2) [px]
            NaN = not seen, and stays NaN.

        Returns
        -------
        (..., 2) [units]

        Raises
        ------
        CalibrationError
            When a point has no counterpart on the plane.
        """

    @abstractmethod
    def to_pixels(self, points: ArrayLike) -> Array:
        """Return where points of the plane are seen, (..., 2) [units] -> (..., 2) [px]."""

    @abstractmethod
    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivative of `to_physical`, (..., 2, 2) [units/px], at pixels."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, for a file."""

    def sigma_to_physical(self, points: ArrayLike, sigma: ArrayLike) -> Array:
        """Carry the one-sigma of pixels over to the plane.

        Parameters
        ----------
        points, sigma : (..., 2) [px]
            Errors along x and y are taken to be independent.

        Returns
        -------
        (..., 2) [units]
            The random part. What the calibration itself is uncertain by is common to all
            points and is told by the calibration.
        """
        variance = np.square(np.asarray(sigma, np.float64))[..., np.newaxis]
        spread = np.square(self.jacobian(points)) @ variance
        return np.sqrt(spread[..., 0])

    def check_frame(self, shape: tuple[int, int]) -> FrameCheck:
        """Say whether the calibration fits images of a height and a width [px]."""
        found = frame_size(shape, key="shape")
        if self.frame_shape is None or tuple(self.frame_shape) == found:
            return FrameCheck(self)
        (height, width), (new_height, new_width) = self.frame_shape, found
        # Half a pixel of rounding in either direction is no other shape.
        if abs(new_width * height - new_height * width) <= 0.5 * (height + width):
            rescaled = self.rescaled(found)
            if rescaled is not None:
                note = (
                    f"the calibration was made for {width}x{height} and rescaled to the "
                    f"recording's {new_width}x{new_height}"
                )
                return FrameCheck(rescaled, (note,))
        return FrameCheck(
            self,
            warning=f"the calibration was made for images of {width}x{height}, the recording has "
            f"{new_width}x{new_height}: positions will be wrong. Calibrate with images of the "
            f"recording's size, or give the frame_shape that the calibration belongs to",
        )

    def turned_up(self) -> Calibration:
        """Return the same calibration with y counted upwards."""
        return self if self.y_up else replace(self, y_up=True)  # type: ignore[type-var]

    def rescaled(self, shape: tuple[int, int]) -> Calibration | None:
        """Return the same calibration for another resolution; None where there is none."""
        return None

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.as_dict() == other.as_dict()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(json.dumps(self.as_dict(), sort_keys=True))


def as_points(points: ArrayLike, *, dims: int = 2, key: str = "points") -> Array:
    """Return points as an array (..., dims) of floats.

    Raises
    ------
    CalibrationError
        When it has another shape.
    """
    found = np.asarray(points, np.float64)
    if found.ndim == 0 or found.shape[-1] != dims:
        raise CalibrationError(
            f"the points have the shape {found.shape}",
            expected=f"(..., {dims}): {', '.join('xyz'[:dims])} along the last axis",
            fix="give one row for each point",
            key=key,
        )
    return found


def frame_size(shape: Any, *, key: str = "frame_shape") -> tuple[int, int]:
    """Return (height, width) as two whole numbers above zero; a channel axis is dropped.

    Raises
    ------
    CalibrationError
    """
    try:
        numbers = tuple(int(value) for value in shape)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in (2, 3) or min(numbers) < 1:
        raise CalibrationError(
            f"the size of the images is given as {shape!r}",
            expected="(height, width) in pixels, as image.shape says it",
            fix="pass image.shape of a frame, or source.shape",
            key=key,
        )
    return numbers[0], numbers[1]


def length_unit(symbol: Any, *, key: str = "units") -> str:
    """Return the symbol of a unit of length, or "1".

    Raises
    ------
    UnitError
        When there is no such unit.
    CalibrationError
        When it measures something else.
    """
    found = unit(symbol, key=key)
    if found.dimension != "length" and symbol != "1":
        raise CalibrationError(
            f"{symbol!r} is a unit of {found.dimension}",
            expected="a unit of length: m cm mm um",
            fix="say in what unit the distance was measured",
            key=key,
        )
    return str(symbol)


def finite(value: Any, *, key: str, above: float | None = None) -> float:
    """Return a finite number.

    Raises
    ------
    CalibrationError
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or (above is not None and number <= above):
        raise CalibrationError(
            f"{key} is {value}",
            expected="a finite number" + ("" if above is None else f" above {above:g}"),
            fix="check the value and its unit",
            key=key,
        )
    return number


#: Kind in a calibration file to the function that makes the object from plain values.
Maker = Callable[[dict[str, Any]], Any]
