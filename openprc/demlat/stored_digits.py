"""How many digits of a motion survive in float32: what is stored is a place, not a motion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Digits of a motion below which a reader is told.
ENOUGH = 4.0


class SpreadSum:
    """Means and standard deviations of columns, from blocks of frames.

    Parameters
    ----------
    origin : (F,)
        A frame: sums are about it, so that small motion about a large offset keeps its digits.
    """

    def __init__(self, origin: Reals) -> None:
        self.origin = origin.copy()
        self.n = 0
        self._total = np.zeros_like(self.origin)
        self._squares = np.zeros_like(self.origin)

    def add(self, values: Reals) -> None:
        """Add frames, (B, F)."""
        moved = values - self.origin
        self.n += len(values)
        self._total += moved.sum(axis=0)
        self._squares += np.einsum("ij,ij->j", moved, moved)

    @property
    def mean(self) -> Reals:
        """Means, (F,)."""
        return self.origin + self._total / self.n

    @property
    def spread(self) -> Reals:
        """Standard deviations, (F,)."""
        variance: Reals = self._squares / self.n - (self._total / self.n) ** 2
        return np.sqrt(np.maximum(variance, 0.0))


def rounding_deviation(values: Reals) -> Reals:
    """Return the standard deviation of the error of rounding values to float32.

    A unit in the last place of v is ``2^(floor(log2 |v|) - 23)``; the error is uniform within
    half of it, so that its standard deviation is that over sqrt(12).
    """
    return np.spacing(np.abs(values).astype(np.float32)).astype(np.float64) / math.sqrt(12.0)


def digits_remark(what: str, spread: SpreadSum, *, remedy: str) -> str | None:
    """Return what is to be said of a series in float32, or None where enough is kept.

    Parameters
    ----------
    what : str
        Such as "positions".
    spread : SpreadSum [m]
    remedy : str
        What can be done, beside storing float64.
    """
    if spread.n < 2:
        return None
    moves = spread.spread > 1e-12 * np.abs(spread.mean).max(initial=0.0)
    if not moves.any():
        return None
    motion, place = spread.spread[moves], np.abs(spread.mean[moves])
    noise = rounding_deviation(place)
    # Half of what moves is better off than the median.
    digits = float(np.median(np.log10(motion / noise)))
    if digits >= ENOUGH:
        return None
    return (
        f"float32 keeps {max(digits, 0.0):.1f} digits of the motion of the {what}: they move by"
        f" {np.median(motion):.2g} m about {np.median(place):.2g} m (medians), where rounding"
        f" alone is {np.median(noise):.2g} m; expected: at least {ENOUGH:g} digits, or a readout"
        f" takes rounding for motion; to do: store float64 (export.precision){remedy}"
    )
