"""Motions whose way back is known: from a place in frame k to the place in frame 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


class Motion(Protocol):
    """Where what is seen in a frame was in frame 0."""

    def back(self, x: Values, y: Values, k: float) -> tuple[Values, Values]:
        """Return the places [px] in frame 0 of what is at (x, y) [px] in frame `k`.

        `k` may lie between two frames.
        """
        ...


@dataclass(frozen=True)
class LinearMotion:
    """x = centre + A(k) (X - centre) + d(k).

    Parameters
    ----------
    matrix : callable
        Frame to A, (2, 2); the identity at 0.
    shift : callable
        Frame to d, (2,) [px]; zero at 0.
    centre : (float, float) [px]
    """

    matrix: Callable[[float], Values]
    shift: Callable[[float], Values]
    centre: tuple[float, float]

    def back(self, x: Values, y: Values, k: float) -> tuple[Values, Values]:
        """Return the places in frame 0; see `Motion`."""
        inverse, shift = np.linalg.inv(self.matrix(k)), self.shift(k)
        dx, dy = x - self.centre[0] - shift[0], y - self.centre[1] - shift[1]
        return (
            self.centre[0] + inverse[0, 0] * dx + inverse[0, 1] * dy,
            self.centre[1] + inverse[1, 0] * dx + inverse[1, 1] * dy,
        )


@dataclass(frozen=True)
class FoldMotion:
    """Two facets that turn out of the plane about a crease, and so look shorter.

    Parameters
    ----------
    right, left : callable
        Frame to the part of the width that is lost right and left of the crease, 0 at 0,
        below 1. Where the two differ the motion has a kink at the crease.
    crease : float
        x of the crease [px].
    """

    right: Callable[[float], float]
    left: Callable[[float], float]
    crease: float

    def back(self, x: Values, y: Values, k: float) -> tuple[Values, Values]:
        """Return the places in frame 0; see `Motion`."""
        away = x - self.crease
        right, left = 1.0 - self.right(k), 1.0 - self.left(k)
        kept = np.where(away > 0.0, right, left)
        return self.crease + away / kept, np.array(y, dtype=np.float64)


@dataclass(frozen=True)
class WaveMotion:
    """X = x - u(x) with u = amplitude(k) sin(2 pi s / length), s along x for u_y and y for u_x.

    Parameters
    ----------
    amplitude : callable
        Frame to the amplitude [px], 0 at 0; below ``length / (2 pi)``.
    length : float [px]
    """

    amplitude: Callable[[float], float]
    length: float

    def back(self, x: Values, y: Values, k: float) -> tuple[Values, Values]:
        """Return the places in frame 0; see `Motion`."""
        size, wave = self.amplitude(k), 2.0 * np.pi / self.length
        return x - size * np.sin(wave * x), y - size * np.sin(wave * y)


@dataclass(frozen=True, eq=False)
class TileMotion:
    """Square tiles, each a window that stands still, behind which a patch shifts as a whole.

    Points keep their tile as long as they stay within it.

    Parameters
    ----------
    shifts : (T, rows, columns, 2) [px]
        Of every frame, zero in frame 0.
    side : float [px]
        Of a tile; the first has its corner at the origin.
    """

    shifts: Values
    side: float

    def back(self, x: Values, y: Values, k: float) -> tuple[Values, Values]:
        """Return the places in frame 0 for a whole `k`; see `Motion`."""
        shift = self.shifts[round(k)]
        row = np.clip(y // self.side, 0, shift.shape[0] - 1).astype(np.intp)
        column = np.clip(x // self.side, 0, shift.shape[1] - 1).astype(np.intp)
        here = shift[row, column]
        return x - here[..., 0], y - here[..., 1]


def forward(motion: Motion, points: Values, k: float) -> Values:
    """Return where points (N, 2) [px] of frame 0 are in frame `k`.

    To 1e-12 px in images of up to 500 px, by Newton's iteration on the way back. Its
    derivative is taken by a step of 1e-4 px; the result is checked, so the derivative only has
    to be good enough to converge.

    Raises
    ------
    ValueError
        The motion cannot be undone: it folds the plane onto itself.
    """
    start = np.array(points, dtype=np.float64)
    if not len(start):
        return start
    x, y = start[:, 0].copy(), start[:, 1].copy()
    step, close = 1e-4, 1e-12 * max(1.0, np.abs(start).max() / 500.0)
    for _ in range(60):
        there = motion.back(x, y, k)
        miss_x, miss_y = there[0] - start[:, 0], there[1] - start[:, 1]
        if max(np.abs(miss_x).max(), np.abs(miss_y).max()) < close:
            return np.column_stack([x, y])
        by_x, by_y = motion.back(x + step, y, k), motion.back(x, y + step, k)
        xx, yx = (by_x[0] - there[0]) / step, (by_x[1] - there[1]) / step
        xy, yy = (by_y[0] - there[0]) / step, (by_y[1] - there[1]) / step
        det = xx * yy - xy * yx
        x -= (yy * miss_x - xy * miss_y) / det
        y -= (xx * miss_y - yx * miss_x) / det
    raise ValueError(
        f"the way back from frame {k:g} was not undone to 1e-12 px in 60 steps: "
        "the motion folds the plane onto itself"
    )


def _identity(_k: float) -> Values:
    return np.eye(2)


def translation(
    shift: Callable[[float], Values], *, centre: tuple[float, float] = (0.0, 0.0)
) -> LinearMotion:
    """Return a motion by ``shift(k)`` (2,) [px]."""
    return LinearMotion(_identity, shift, centre)


def rotation(angle: Callable[[float], float], *, centre: tuple[float, float]) -> LinearMotion:
    """Return a turn by ``angle(k)`` [rad] about `centre`; positive turns x towards y."""

    def matrix(k: float) -> Values:
        c, s = np.cos(angle(k)), np.sin(angle(k))
        return np.array([[c, -s], [s, c]])

    return LinearMotion(matrix, lambda _k: np.zeros(2), centre)


def affine(
    matrix: Callable[[float], Values],
    shift: Callable[[float], Values],
    *,
    centre: tuple[float, float],
) -> LinearMotion:
    """Return x = centre + matrix(k) (X - centre) + shift(k)."""
    return LinearMotion(matrix, shift, centre)


def fold(
    right: Callable[[float], float],
    *,
    crease: float,
    left: Callable[[float], float] | None = None,
) -> FoldMotion:
    """Return a foreshortening on both sides of x = `crease` [px], alike without `left`."""
    return FoldMotion(right, left or right, crease)


def standing_wave(amplitude: Callable[[float], float], *, length: float) -> WaveMotion:
    """Return a standing wave of wave length `length` [px] in both directions."""
    return WaveMotion(amplitude, length)
