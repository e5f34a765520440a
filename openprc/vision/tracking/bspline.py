"""Cubic B-spline interpolation of images: coefficients, made where they are needed.

An image between its pixels is s(x, y) = sum c[j, i] B(y - j) B(x - i) with the cubic B-spline
B; the coefficients c are those with which s meets the pixels (Unser 1999,
doi:10.1109/79.799930). They follow from the pixels by the separable filter whose impulse
response is sqrt(3) z^|k| with z = sqrt(3) - 2, the sum of the causal and the anticausal
recursion of the usual implementation. z^13 is below the resolution of float32, so the response
is cut off there. The cut filter needs no start values, runs along vector registers in both
directions, gives the same number for a pixel whatever else is computed, and a missing pixel
(NaN) spoils its surroundings only. Beyond its edges the image is mirrored about the outermost
pixels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.tracking.compiling import inner, kernel

__all__ = ["BORDER", "PreparedImage"]

#: Coefficients kept beyond each edge of the image, so that the outermost pixels have theirs.
BORDER = 2
#: Half length of the cut filter.
REACH = 12
#: Pixels computed at a time: what fits into the fastest cache.
TILE_ROWS, TILE_COLUMNS = 64, 128

_POLE = np.sqrt(3.0) - 2.0
_response = np.sqrt(3.0) * _POLE ** np.arange(REACH + 1)
# The cut response, brought back to a sum of one: constant images stay what they are.
_response /= _response[0] + 2.0 * _response[1:].sum()
_TAPS = tuple(np.float32(value) for value in _response)
#: Derivative, at a pixel, of the spline through the pixels around it: one weight for each.
PIXEL_DERIVATIVE = 0.5 * np.convolve(
    np.concatenate([_response[:0:-1], _response]), np.array([-1.0, 0.0, 1.0])
)
(_T0, _T1, _T2, _T3, _T4, _T5, _T6, _T7, _T8, _T9, _T10, _T11, _T12) = _TAPS


@inner
def _mirrored(index: int, size: int) -> int:
    if size == 1:
        return 0
    period = 2 * (size - 1)
    index = abs(index) % period
    return min(index, period - index)


@kernel
def _fill(image: Any, coefficients: Any, ready: Any, boxes: Any) -> None:
    """Compute the tiles from which positions in `boxes` are interpolated."""
    height, width = image.shape
    rows, columns = coefficients.shape
    patch = np.empty((TILE_ROWS + 2 * REACH, TILE_COLUMNS + 2 * REACH), np.float32)
    half = np.empty((TILE_ROWS, TILE_COLUMNS + 2 * REACH), np.float32)
    for box in range(len(boxes)):
        if boxes[box, 1] < boxes[box, 0] or boxes[box, 3] < boxes[box, 2]:
            continue
        first_column = max(boxes[box, 0], 0) // TILE_COLUMNS
        last_column = min(boxes[box, 1] + 2 * BORDER, columns - 1) // TILE_COLUMNS
        first_row = max(boxes[box, 2], 0) // TILE_ROWS
        last_row = min(boxes[box, 3] + 2 * BORDER, rows - 1) // TILE_ROWS
        for tile_row in range(first_row, last_row + 1):
            for tile_column in range(first_column, last_column + 1):
                if ready[tile_row, tile_column]:
                    continue
                ready[tile_row, tile_column] = True
                top, left = tile_row * TILE_ROWS, tile_column * TILE_COLUMNS
                tall = min(TILE_ROWS, rows - top)
                wide = min(TILE_COLUMNS, columns - left)
                long = wide + 2 * REACH
                for j in range(tall + 2 * REACH):
                    y = _mirrored(top + j - REACH - BORDER, height)
                    x0 = left - REACH - BORDER
                    if x0 >= 0 and x0 + long <= width:
                        for i in range(long):
                            patch[j, i] = image[y, x0 + i]
                    else:
                        for i in range(long):
                            patch[j, i] = image[y, _mirrored(x0 + i, width)]
                for j in range(tall):
                    p = j + REACH
                    for i in range(long):
                        half[j, i] = (
                            _T0 * patch[p, i]
                            + _T1 * (patch[p - 1, i] + patch[p + 1, i])
                            + _T2 * (patch[p - 2, i] + patch[p + 2, i])
                            + _T3 * (patch[p - 3, i] + patch[p + 3, i])
                            + _T4 * (patch[p - 4, i] + patch[p + 4, i])
                            + _T5 * (patch[p - 5, i] + patch[p + 5, i])
                            + _T6 * (patch[p - 6, i] + patch[p + 6, i])
                            + _T7 * (patch[p - 7, i] + patch[p + 7, i])
                            + _T8 * (patch[p - 8, i] + patch[p + 8, i])
                            + _T9 * (patch[p - 9, i] + patch[p + 9, i])
                            + _T10 * (patch[p - 10, i] + patch[p + 10, i])
                            + _T11 * (patch[p - 11, i] + patch[p + 11, i])
                            + _T12 * (patch[p - 12, i] + patch[p + 12, i])
                        )
                for j in range(tall):
                    for i in range(wide):
                        p = i + REACH
                        coefficients[top + j, left + i] = (
                            _T0 * half[j, p]
                            + _T1 * (half[j, p - 1] + half[j, p + 1])
                            + _T2 * (half[j, p - 2] + half[j, p + 2])
                            + _T3 * (half[j, p - 3] + half[j, p + 3])
                            + _T4 * (half[j, p - 4] + half[j, p + 4])
                            + _T5 * (half[j, p - 5] + half[j, p + 5])
                            + _T6 * (half[j, p - 6] + half[j, p + 6])
                            + _T7 * (half[j, p - 7] + half[j, p + 7])
                            + _T8 * (half[j, p - 8] + half[j, p + 8])
                            + _T9 * (half[j, p - 9] + half[j, p + 9])
                            + _T10 * (half[j, p - 10] + half[j, p + 10])
                            + _T11 * (half[j, p - 11] + half[j, p + 11])
                            + _T12 * (half[j, p - 12] + half[j, p + 12])
                        )


def _weights(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    t = fraction[..., None]
    return (
        np.concatenate(
            [
                (1 - t) ** 3,
                3 * t**3 - 6 * t**2 + 4,
                -3 * t**3 + 3 * t**2 + 3 * t + 1,
                t**3,
            ],
            axis=-1,
        )
        / 6.0
    )


def _noise_left(n: int = 64) -> NDArray[np.float64]:
    whole = np.concatenate([_response[:0:-1], _response])
    weights = _weights(np.linspace(0.0, 1.0, n + 1))
    return np.array([(np.convolve(row, whole) ** 2).sum() for row in weights])


#: Share of the variance of white noise that is left by interpolation in one direction, at
#: 64 steps from one pixel to the next.
NOISE_LEFT = _noise_left()


class PreparedImage:
    """An image that can be read between its pixels.

    Parameters
    ----------
    intensity : (H, W) [grey levels]
        uint8, uint16, float32 or float64; NaN where a pixel has no value. It is not copied,
        and must not change while this object is in use.
    """

    def __init__(self, intensity: NDArray[Any]) -> None:
        pixels = np.asarray(intensity)
        if pixels.ndim != 2 or pixels.size == 0:
            raise ConfigError(
                f"an image of shape {pixels.shape}",
                expected="grey levels of shape (height, width)",
                fix="convert the frame to grey levels first",
            )
        if pixels.dtype not in (np.uint8, np.uint16, np.float32, np.float64):
            if pixels.dtype.kind not in "iub":
                raise ConfigError(
                    f"an image of type {pixels.dtype}",
                    expected="real grey levels (uint8, uint16, float32 or float64)",
                    fix="convert the frame to one of these types",
                )
            pixels = pixels.astype(np.float64)
        self.intensity = np.ascontiguousarray(pixels)
        height, width = pixels.shape
        rows, columns = height + 2 * BORDER, width + 2 * BORDER
        self.coefficients = np.empty((rows, columns), np.float32)
        self._ready = np.zeros((-(-rows // TILE_ROWS), -(-columns // TILE_COLUMNS)), np.bool_)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [px]."""
        height, width = self.intensity.shape
        return height, width

    def require(self, boxes: NDArray[np.int64]) -> None:
        """Make boxes ready to be interpolated in, as far as they are not.

        Parameters
        ----------
        boxes : (n, 4) [px]
            First and last column, first and last row of each; a box that ends before it begins
            is empty.
        """
        _fill(self.intensity, self.coefficients, self._ready, boxes)

    def require_all(self) -> None:
        """Compute all coefficients."""
        height, width = self.intensity.shape
        self.require(np.array([[0, width - 1, 0, height - 1]]))

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the interpolated grey levels at points.

        Parameters
        ----------
        points : (n, 2) [px]

        Returns
        -------
        (n,) [grey levels]
            NaN outside of the image.
        """
        points = np.asarray(points, np.float64).reshape(-1, 2)
        height, width = self.shape
        inside = ((points >= 0.0) & (points <= (width - 1, height - 1))).all(axis=1)
        result = np.full(len(points), np.nan)
        whole = np.floor(points[inside])
        corner = whole.astype(np.int64)
        self.require(corner[:, [0, 0, 1, 1]] + np.array([0, 1, 0, 1]))
        weights = _weights(points[inside] - whole)
        around = np.arange(BORDER - 1, BORDER + 3)
        taps = self.coefficients[
            corner[:, 1, None, None] + around[:, None], corner[:, 0, None, None] + around
        ]
        result[inside] = np.einsum("nj,nji,ni->n", weights[:, 1], taps, weights[:, 0])
        return result
