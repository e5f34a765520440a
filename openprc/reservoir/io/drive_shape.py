"""The symbols behind a drive that is given at every frame: how far apart they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

#: Of the knots, this share has to stand on the grid, each within one frame.
_ON_GRID = 0.95
_FEWEST_KNOTS = 5
#: Frames between symbols that can be told from one symbol a frame.
_CLOSEST = 2
#: Differences below this part of the largest value are rounding errors.
_ROUND_OFF = 1e-12

Kind = Literal["held", "joined by straight lines", "joined by cubics"]

#: Order of the differences that vanish between knots, and frames around a knot that they touch.
_ORDERS: tuple[tuple[Kind, int], ...] = (
    ("held", 1),
    ("joined by straight lines", 2),
    ("joined by cubics", 4),
)


@dataclass(frozen=True)
class SymbolSpacing:
    """Symbols recognised in a drive.

    ``frames`` from symbol to symbol, not always a whole number; ``kind`` says what happens in
    between; ``first`` is the frame at which the first recognised symbol begins.
    """

    kind: Kind
    frames: float
    first: int


def symbol_spacing(u: NDArray[np.float64]) -> SymbolSpacing | None:
    """Recognise symbols that were held, or joined by straight lines or cubics.

    Between two knots the differences of order 1, 2 and 4 vanish. The knots have to stand on a
    grid; equal symbols in a row leave gaps in it. Measured signals, which carry noise, are not
    recognised.

    Parameters
    ----------
    u : (T,) or (T, C)
    """
    values = u[:, None] if u.ndim == 1 else u
    values = values[:, np.ptp(values, axis=0) > 0] if len(values) else values
    if not values.size:
        return None
    size = np.ptp(values, axis=0)
    for kind, order in _ORDERS:
        if len(values) <= order:
            return None
        differences = np.abs(np.diff(values, n=order, axis=0)) / size
        touched = (differences > _ROUND_OFF * 2**order).any(axis=1)
        grid = _grid(np.flatnonzero(touched), width=order)
        if grid is not None:
            spacing, first = grid
            return SymbolSpacing(kind, spacing, first + (1 if order == 1 else order // 2))
    return None


def _grid(touched: NDArray[np.intp], *, width: int) -> tuple[float, int] | None:
    """Return spacing and first knot, when knots that each touch up to `width` frames do so."""
    if not touched.size:
        return None
    starts = np.flatnonzero(np.diff(touched, prepend=touched[0] - 2) > 1)
    ends = np.append(starts[1:], len(touched)) - 1
    if len(starts) < _FEWEST_KNOTS or (touched[ends] - touched[starts] >= width).any():
        return None
    knots = 0.5 * (touched[starts] + touched[ends])
    gaps = np.diff(knots)
    if gaps.min() < _CLOSEST:
        return None
    # The smallest gap is right to a frame or so; a line through the knots counted by it is better.
    spacing = float(gaps.min())
    for _ in range(3):
        places = np.concatenate([[0.0], np.cumsum(np.rint(gaps / spacing))])
        slope = np.polyfit(places, knots, 1)
        spacing = float(slope[0])
    off = np.abs(knots - np.polyval(slope, places))
    if np.mean(off <= 1.0) < _ON_GRID:
        return None
    return round(spacing, 6), int(touched[0])
