"""Panels with any number of corners, cut into triangles; and panels turned alike."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: The cost of a panel grows with the cube of its corners.
MOST_CORNERS = 64
#: A triangle whose height is less than this share of its longest side is degenerate.
LEAST_HEIGHT = 1e-7


def triangulate(
    positions: Reals, panels: Sequence[Sequence[int]]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Cut panels into triangles.

    A panel may be concave and may have corners in line; of all ways to cut it, the one whose
    worst triangle is best is taken (by height over longest side), which cuts a quadrilateral
    along its shorter diagonal.

    Returns
    -------
    triangles : (F, 3) [node]
        Oriented as the panels are.
    diagonals : (D, 2) [node]
        Edges that lie inside panels.

    Raises
    ------
    ConfigError
        When a panel has a node twice, more than 64 corners, or cannot be cut.
    """
    triangles: list[tuple[int, int, int]] = []
    diagonals: dict[tuple[int, int], None] = {}
    for number, panel in enumerate(panels):
        corners = list(panel)
        if len(corners) < 3 or len(set(corners)) < len(corners) or len(corners) > MOST_CORNERS:
            raise ConfigError(
                f"panel {number} has the nodes {corners[:8]}{' ...' if len(corners) > 8 else ''}",
                expected=f"3 to {MOST_CORNERS} different nodes around each panel",
                fix="divide the panel, or join the loose line in it to its rim",
                key=f"faces/{number}",
            )
        if len(corners) == 3:
            triangles.append((corners[0], corners[1], corners[2]))
            continue
        cut = _best_cut(_flattened(positions[corners]))
        if cut is None:
            raise ConfigError(
                f"panel {number} with the nodes {corners[:8]} cannot be cut into triangles",
                expected="a panel whose rim does not cross itself",
                fix="give its nodes in the order in which they lie around it",
                key=f"faces/{number}",
            )
        for a, b, c in cut:
            triangles.append((corners[a], corners[b], corners[c]))
            for i, j in ((a, b), (b, c), (a, c)):
                if 1 < abs(i - j) < len(corners) - 1:
                    ends = sorted((corners[i], corners[j]))
                    diagonals[ends[0], ends[1]] = None
    return (
        np.array(triangles, dtype=np.int32).reshape(-1, 3),
        np.array(list(diagonals), dtype=np.int32).reshape(-1, 2),
    )


def _flattened(points: Reals) -> Reals:
    """Return a polygon (C, 3) in the plane of its area vector (Newell's method): (C, 2)."""
    arms = points - points.mean(axis=0)
    area = np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0)
    size = float(np.linalg.norm(area))
    if size == 0.0:
        return np.zeros((len(points), 2))
    normal = area / size
    helper = np.eye(3)[np.abs(normal).argmin()]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return np.stack([arms @ first, arms @ np.cross(normal, first)], axis=1)


def _best_cut(points: Reals) -> list[tuple[int, int, int]] | None:
    """Return the triangles whose worst is best, by dynamic programming over sub-polygons.

    Triangles that are all turned like the polygon cover it once: their areas add up to it.
    """
    n = len(points)
    quality = np.full((n, n), -np.inf)
    apex = np.zeros((n, n), dtype=np.int64)
    for i in range(n - 1):
        quality[i, i + 1] = np.inf
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            between = np.arange(i + 1, j)
            worst = np.minimum(quality[i, between], quality[between, j])
            worst = np.minimum(worst, _shape(points[i], points[between], points[j]))
            # The margin keeps ties apart from rounding: equal panels are cut alike.
            best = int(np.argmax(worst >= worst.max() * (1.0 - 1e-9)))
            apex[i, j], quality[i, j] = between[best], worst[best]
            if quality[i, j] < LEAST_HEIGHT:
                quality[i, j] = -np.inf
    if quality[0, n - 1] < LEAST_HEIGHT:
        return None
    triangles, open_spans = [], [(0, n - 1)]
    while open_spans:
        i, j = open_spans.pop()
        if j - i > 1:
            middle = int(apex[i, j])
            triangles.append((i, middle, j))
            open_spans += [(i, middle), (middle, j)]
    return triangles


def _shape(a: Reals, b: Reals, c: Reals) -> Reals:
    """Return height over longest side of triangles (a, b, c), negative when they turn right."""
    area = (b[:, 0] - a[0]) * (c[1] - a[1]) - (b[:, 1] - a[1]) * (c[0] - a[0])
    sides = [((one - two) ** 2).sum(axis=-1) for one, two in ((a, b), (b, c), (a[None], c[None]))]
    longest = np.maximum(np.maximum(sides[0], sides[1]), sides[2])
    shape: Reals = area / np.where(longest > 0.0, longest, 1.0)
    return shape


def turned_alike(panels: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return panels with neighbours turned to one side, as the first of each piece is turned.

    Raises
    ------
    ConfigError
        When the sheet has one side only, like a Moebius strip.
    """
    rows = [list(panel) for panel in panels]
    at_edge: dict[tuple[int, int], list[tuple[int, bool]]] = defaultdict(list)
    for p, panel in enumerate(rows):
        for i, j in zip(panel, [*panel[1:], panel[0]], strict=True):
            at_edge[min(i, j), max(i, j)].append((p, i < j))
    neighbours: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    for users in at_edge.values():
        if len(users) == 2:
            (p, one), (q, two) = users
            neighbours[p].append((q, one == two))
            neighbours[q].append((p, one == two))
    turned: dict[int, bool] = {}
    for start in range(len(rows)):
        if start in turned:
            continue
        turned[start] = False
        waiting = deque([start])
        while waiting:
            p = waiting.popleft()
            for q, against in neighbours[p]:
                wanted = turned[p] != against
                if q not in turned:
                    turned[q] = wanted
                    waiting.append(q)
                elif turned[q] != wanted:
                    raise ConfigError(
                        f"panels {p} and {q} cannot be turned to one side",
                        expected="a sheet with two sides",
                        fix="cut the sheet open, as a Moebius strip has to be",
                        key="faces",
                    )
    return [row[::-1] if turned[p] else row for p, row in enumerate(rows)]
