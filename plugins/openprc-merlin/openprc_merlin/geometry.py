"""Bar lengths, dihedral angles and their gradients, for blocks of frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Numbers of one coordinate of a piece, 128 KiB, and its frames.
_CACHED = 1 << 14
_FRAMES = 512


def bar_lengths(positions: Floats, bars: Ints) -> Floats:
    """Return the distance between the ends of every bar.

    Parameters
    ----------
    positions : (B, N, 3)
    bars : (M, 2)

    Returns
    -------
    (B, M), in the unit of `positions`
    """
    lengths = np.empty((len(positions), len(bars)))
    for rows, some, track in _pieces(positions, len(bars)):
        axis = track[:, bars[some, 1]]
        axis -= track[:, bars[some, 0]]
        lengths[rows, some] = np.sqrt(_dot(axis, axis)).T
    return lengths


def dihedral_angles(positions: Floats, hinges: Ints) -> Floats:
    """Return the angle of every hinge in [0, 2 pi), pi when flat.

    With the row [j k i l], crease j-k and wings i and l, m = r_ij x r_kj and
    n = r_kj x r_kl, the angle is atan2(|r_kj| n.r_ij, m.n) modulo 2 pi: the angle of
    Liu & Paulino (2017), doi:10.1098/rspa.2017.0348, without the inverse cosine that loses
    eight digits near flat. NaN where a wing lies on the line of the crease.

    Parameters
    ----------
    positions : (B, N, 3)
    hinges : (H, 4)

    Returns
    -------
    (B, H) [rad]
    """
    angles = np.empty((len(positions), len(hinges)))
    for rows, some, track in _pieces(positions, len(hinges)):
        x_j, x_k, r_ij, x_l = (track[:, hinges[some, column]] for column in range(4))
        r_ij -= x_j
        r_kj = x_k - x_j
        r_kl = np.subtract(x_k, x_l, out=x_l)
        m, n = _cross(r_ij, r_kj), _cross(r_kj, r_kl)
        square = _dot(r_kj, r_kj)
        sine = _dot(n, r_ij)
        sine *= np.sqrt(square)
        angle = np.arctan2(sine, _dot(m, n))
        np.add(angle, 2 * np.pi, out=angle, where=angle < 0)
        # A tiny negative number rounds up to 2 pi itself.
        angle[angle >= 2 * np.pi] = 0.0
        floor = (np.finfo(np.float64).eps * square) ** 2
        angle[(_dot(m, m) <= floor) | (_dot(n, n) <= floor)] = np.nan
        angles[rows, some] = angle.T
    return angles


def _pieces(positions: Floats, count: int) -> Iterator[tuple[slice, slice, Floats]]:
    """Yield frames, elements and coordinates, so few that what is computed stays in the cache.

    Coordinates are (D, N, B): long runs of numbers, whose products need no inner loops.
    """
    frames = max(8, min(_FRAMES, (1 << 20) // max(1, positions.shape[1])))
    step = max(1, _CACHED // min(frames, max(1, len(positions))))
    for begin in range(0, len(positions), frames):
        rows = slice(begin, begin + frames)
        track = np.ascontiguousarray(positions[rows].transpose(2, 1, 0))
        for first in range(0, count, step):
            yield rows, slice(first, first + step), track


def _dot(a: Floats, b: Floats) -> Floats:
    """Return (E, B) scalar products of (D, E, B) vectors."""
    total: Floats = a[0] * b[0]
    for axis in range(1, len(a)):
        total += a[axis] * b[axis]
    return total


def _cross(a: Floats, b: Floats) -> Floats:
    """Return (3, E, B) vector products of (3, E, B) vectors."""
    product = np.empty_like(a)
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[y], b[z], out=product[x])
        product[x] -= a[z] * b[y]
    return product


def dihedral_gradients(positions: Floats, hinges: Ints) -> Floats:
    """Return d(angle)/d(position) of the four nodes, in the order j k i l.

    Blondel & Karplus (1996), doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T,
    in the notation of `dihedral_angles`.

    Parameters
    ----------
    positions : (B, N, 3)
    hinges : (H, 4)

    Returns
    -------
    (B, H, 4, 3) [rad per unit of length]
    """
    r_ij, r_kj, r_kl, m, n = _frame(positions, hinges)
    square = np.einsum("bhx,bhx->bh", r_kj, r_kj)[..., None]
    length = np.sqrt(square)
    g_i = length / np.einsum("bhx,bhx->bh", m, m)[..., None] * m
    g_l = -length / np.einsum("bhx,bhx->bh", n, n)[..., None] * n
    a = np.einsum("bhx,bhx->bh", r_ij, r_kj)[..., None] / square
    b = np.einsum("bhx,bhx->bh", r_kl, r_kj)[..., None] / square
    g_j = (a - 1) * g_i - b * g_l
    g_k = (b - 1) * g_l - a * g_i
    return np.stack([g_j, g_k, g_i, g_l], axis=2)


def _frame(positions: Floats, hinges: Ints) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    x_j, x_k, x_i, x_l = (positions[:, hinges[:, column]] for column in range(4))
    r_ij, r_kj, r_kl = x_i - x_j, x_k - x_j, x_k - x_l
    return r_ij, r_kj, r_kl, np.cross(r_ij, r_kj), np.cross(r_kj, r_kl)


class Unwrapper:
    """Carries angles over the cut at 0 and 2 pi, from block to block of frames.

    Counts the crossings: a hinge that passes through 0 or 2 pi is a panel that passed
    through its neighbour, which the model does not forbid.
    """

    def __init__(self) -> None:
        """Start without a previous frame."""
        self._last: Floats | None = None
        self._turns: Floats | None = None
        self.crossings = 0

    def __call__(self, angles: Floats) -> Floats:
        """Return (B, H) angles [rad] without jumps of more than pi between frames."""
        last = angles[:1] if self._last is None else self._last
        steps = np.diff(angles, axis=0, prepend=last)
        if self._turns is None or not self._turns.any():
            # Most runs never come near the cut: nothing has to be taken away then.
            with np.errstate(invalid="ignore"):
                still = not (np.abs(steps, out=steps) > np.pi).any()
            if still:
                self._last = angles[-1:].copy()
                self._turns = np.zeros_like(self._last)
                return angles
            steps = np.diff(angles, axis=0, prepend=last)
        start = np.zeros_like(angles[:1]) if self._turns is None else self._turns
        jumps = np.round(steps / (2 * np.pi))
        jumps[~np.isfinite(jumps)] = 0.0
        turns = start + np.cumsum(jumps, axis=0)
        self.crossings += int(np.count_nonzero(jumps))
        self._last, self._turns = angles[-1:].copy(), turns[-1:].copy()
        return angles - 2 * np.pi * turns


def orient(faces: Ints) -> Ints:
    """Turn triangles so that neighbours run along their common edge in opposite directions.

    Every connected part keeps the sense of its first triangle. Where a surface has two sides
    only in places (a Moebius strip) or more than two triangles meet, the first way wins.

    Parameters
    ----------
    faces : (F, 3)

    Returns
    -------
    (F, 3)
    """
    rows = faces.tolist()
    at_edge: dict[tuple[int, int], list[int]] = {}
    for number, row in enumerate(rows):
        for a, b in sides(row):
            at_edge.setdefault((min(a, b), max(a, b)), []).append(number)
    done = [False] * len(rows)
    for seed in range(len(rows)):
        if done[seed]:
            continue
        done[seed] = True
        pending = [seed]
        while pending:
            row = rows[pending.pop()]
            for a, b in sides(row):
                for other in at_edge[min(a, b), max(a, b)]:
                    if done[other]:
                        continue
                    if (a, b) in sides(rows[other]):
                        rows[other] = rows[other][::-1]
                    done[other] = True
                    pending.append(other)
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def sides(row: list[int]) -> tuple[tuple[int, int], ...]:
    """Return the three edges of a triangle in the sense of its winding."""
    return ((row[0], row[1]), (row[1], row[2]), (row[2], row[0]))


def triangles_to_hinges(faces: Ints) -> Ints:
    """Return a hinge for every edge that two triangles share.

    Rows are [j k i l] with j < k; i belongs to the triangle that runs from j to k, so that
    in a consistently wound surface the angles of all hinges have one sense. A triangle that
    is listed twice, as some programs list both sides of a sheet, counts once.

    Parameters
    ----------
    faces : (F, 3)

    Returns
    -------
    (H, 4)
    """
    wings: dict[tuple[int, int], list[tuple[bool, int]]] = {}
    single = {tuple(sorted(face)): face for face in reversed(faces.tolist())}
    for face in reversed(single.values()):
        for (a, b), c in zip(sides(face), (face[2], face[0], face[1]), strict=True):
            wings.setdefault((min(a, b), max(a, b)), []).append((a < b, c))
    rows = []
    for (j, k), both in sorted(wings.items()):
        if len(both) == 2:
            first, second = sorted(both, key=lambda side: not side[0])
            rows.append((j, k, first[1], second[1]))
    return np.array(rows, dtype=np.int64).reshape(-1, 4)


def fan(polygon: list[int]) -> list[tuple[int, int, int]]:
    """Split a polygon into triangles from its first corner."""
    return [(polygon[0], polygon[n], polygon[n + 1]) for n in range(1, len(polygon) - 1)]
