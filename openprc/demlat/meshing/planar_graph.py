"""From line segments in a plane to nodes, edges and panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError, UnsafeFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]
    Nodes = NDArray[np.int64]

#: Every pair of segments is looked at.
MOST_SEGMENTS = 8000
BLOCK = 256


def split_crossings(segments: Reals, *, tolerance: float) -> tuple[Reals, Nodes, Nodes]:
    """Join ends that meet, and divide segments where others cross or touch them.

    Parameters
    ----------
    segments : (S, 2, 2)
    tolerance : float [unit of the segments]
        Points that are nearer than this are one.

    Returns
    -------
    points : (P, 2)
    edges : (E, 2) [point]
        Each pair once.
    parents : (E,)
        The first segment that each edge is part of.

    Raises
    ------
    UnsafeFile
        When there are too many segments.
    """
    count = len(segments)
    if count > MOST_SEGMENTS:
        raise UnsafeFile(f"{count} line segments", expected=f"at most {MOST_SEGMENTS}")
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    cuts: list[tuple[Nodes, Reals]] = [(np.arange(count), np.zeros(count))]
    cuts.append((np.arange(count), np.ones(count)))
    for low in range(0, count, BLOCK):
        cuts.append(_crossings(start, along, length, slice(low, low + BLOCK), tolerance))
        cuts.append(_touching(start, along, length, slice(low, low + BLOCK), tolerance))
    owner = np.concatenate([cut[0] for cut in cuts])
    place = np.concatenate([cut[1] for cut in cuts])
    points, name = _merged(start[owner] + place[:, None] * along[owner], tolerance)
    order = np.lexsort((place, owner))
    owner, name = owner[order], name[order]
    joined = (owner[1:] == owner[:-1]) & (name[1:] != name[:-1])
    edges = np.sort(np.stack([name[:-1], name[1:]], axis=1)[joined], axis=1)
    edges, first = np.unique(edges, axis=0, return_index=True)
    return points, edges, owner[:-1][joined][first]


def _crossings(
    start: Reals, along: Reals, length: Reals, rows: slice, tolerance: float
) -> tuple[Nodes, Reals]:
    """Return where segments `rows` are crossed by others: (segment, share of its length)."""
    between = start[None] - start[rows, None]
    denominator = _cross(along[rows, None], along[None])
    parallel = np.abs(denominator) <= 1e-12 * length[rows, None] * length[None]
    safe = np.where(parallel, 1.0, denominator)
    mine = _cross(between, along[None]) / safe
    other = _cross(between, along[rows, None]) / safe
    slack, other_slack = tolerance / length[rows, None], tolerance / length[None]
    hit = ~parallel & (mine > -slack) & (mine < 1 + slack)
    hit &= (other > -other_slack) & (other < 1 + other_slack)
    i, j = np.nonzero(hit)
    return i + rows.start, np.clip(mine[i, j], 0.0, 1.0)


def _touching(
    start: Reals, along: Reals, length: Reals, rows: slice, tolerance: float
) -> tuple[Nodes, Reals]:
    """Return where segments `rows` have the end of another one, also of a parallel one."""
    ends = np.concatenate([start, start + along])
    arm = ends[None] - start[rows, None]
    share = (arm * along[rows, None]).sum(axis=2) / length[rows, None] ** 2
    off = np.abs(_cross(along[rows, None], arm)) / length[rows, None]
    i, j = np.nonzero((share > 0) & (share < 1) & (off < tolerance))
    return i + rows.start, share[i, j]


def _cross(one: Reals, two: Reals) -> Reals:
    product: Reals = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return product


def _merged(points: Reals, tolerance: float) -> tuple[Reals, Nodes]:
    """Return points without doubles, row by row from the bottom, and which became which."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    ones = np.ones(len(near), dtype=bool)
    links = coo_array((ones, (near[:, 0], near[:, 1])), shape=(len(points), len(points)))
    count, name = connected_components(links, directed=False)
    first = np.full(count, len(points))
    np.minimum.at(first, name, np.arange(len(points)))
    kept = points[first]
    band = np.round(kept[:, 1] / tolerance)
    order = np.lexsort((kept[:, 0], band))
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    return kept[order], rank[name]


def panels_of(points: Reals, edges: Nodes) -> list[list[int]]:
    """Return the panels that edges enclose, counter-clockwise; the outside is none.

    At every node, the edge that follows in clockwise order is the next one of the panel.

    Raises
    ------
    ConfigError
        When a line ends inside a panel, or the lines are not connected.
    """
    degree = np.bincount(edges.ravel(), minlength=len(points))
    loose = np.flatnonzero(degree == 1)
    if len(loose):
        x, y = points[loose[0]]
        raise ConfigError(
            f"a line ends at ({x:g}, {y:g}), where no other line is",
            expected="lines that enclose panels",
            fix="join the end to other lines; inside a panel, by a line of the facet kind",
            key="edges",
        )
    directed = np.concatenate([edges, edges[:, ::-1]])
    arm = points[directed[:, 1]] - points[directed[:, 0]]
    angle = np.arctan2(arm[:, 1], arm[:, 0])
    order = np.lexsort((angle, directed[:, 0]))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    begin = np.concatenate([[0], np.cumsum(np.bincount(directed[:, 0], minlength=len(points)))])
    twin = np.concatenate([np.arange(len(edges)) + len(edges), np.arange(len(edges))])
    at = directed[twin, 0]
    # From the twin, which leaves the end of the edge, one place back around that node.
    slot = place[twin] - 1
    slot = np.where(slot < begin[at], begin[at + 1] - 1, slot)
    following = order[slot]
    seen = np.zeros(len(directed), dtype=bool)
    panels: list[list[int]] = []
    outsides = 0
    for edge in range(len(directed)):
        if seen[edge]:
            continue
        loop = []
        here = edge
        while not seen[here]:
            seen[here] = True
            loop.append(int(directed[here, 0]))
            here = int(following[here])
        corners = points[loop]
        area = _cross(corners, np.roll(corners, -1, axis=0)).sum()
        if area > 0:
            panels.append(loop)
        else:
            outsides += 1
    if outsides > 1:
        raise ConfigError(
            f"{outsides} groups of lines that are not connected",
            expected="one sheet, all of whose lines are connected",
            fix="join them by lines of the facet kind, or give them in files of their own",
            key="edges",
        )
    return panels


def signed_area(points: Reals, panel: Sequence[int]) -> float:
    """Return the area of a panel in the x-y plane, positive when counter-clockwise."""
    corners = points[list(panel), :2]
    return 0.5 * float(_cross(corners, np.roll(corners, -1, axis=0)).sum())
