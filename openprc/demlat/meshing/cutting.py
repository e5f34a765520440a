"""Cutting a triangulated sheet along edges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.meshing.lattices import extreme_sets
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.surface import is_among, shared_edges, surface_mesh
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def cut_along(
    n_nodes: int, triangles: ArrayLike, cuts: ArrayLike
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Separate the triangles on the two sides of `cuts`.

    A node becomes as many nodes as there are pieces of sheet around it: two inside a slit, one
    at the tip of a slit that ends in the sheet.

    Parameters
    ----------
    n_nodes : int
    triangles : (F, 3) [node]
        Oriented alike.
    cuts : (C, 2) [node]
        Edges of the triangles; one that is no inner edge changes nothing, and neither does a
        slit of a single edge inside the sheet, which has no node between its tips to open at.

    Returns
    -------
    triangles : (F, 3) [node]
        The first piece at a node keeps its number; the others follow after `n_nodes`, in the
        order of the nodes that they come from.
    origin : (N', ) [node]
        The node that each new node comes from.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    _, hinges, owners = shared_edges(rows)
    kept = ~is_among(hinges[:, :2], cuts)
    crease, sides = hinges[kept, :2], owners[kept]
    # Corners of triangles are one node where the triangles share an edge that is not cut.
    ends = [
        np.concatenate([_corner(rows, sides[:, side], crease[:, end]) for end in range(2)])
        for side in range(2)
    ]
    corners = rows.size
    links = coo_array((np.ones(len(ends[0]), dtype=bool), tuple(ends)), shape=(corners, corners))
    _, piece = connected_components(links, directed=False)
    node = rows.ravel()
    order = np.lexsort((piece, node))
    pieces = np.stack([node[order], piece[order]], axis=1)
    new = np.ones(corners, dtype=bool)
    new[1:] = (pieces[1:] != pieces[:-1]).any(axis=1)
    extra = new.copy()
    extra[1:] &= pieces[1:, 0] == pieces[:-1, 0]
    extra[:1] = False
    added = pieces[extra, 0]
    names = np.where(extra, n_nodes + np.cumsum(extra) - 1, pieces[:, 0])
    start = np.maximum.accumulate(np.where(new, np.arange(corners), 0))
    result = np.empty(corners, dtype=np.int32)
    result[order] = names[start]
    origin = np.concatenate([np.arange(n_nodes), added]).astype(np.int32)
    return result.reshape(-1, 3), origin


def _corner(
    rows: NDArray[np.int32], triangle: NDArray[np.int64], node: NDArray[np.int32]
) -> NDArray[np.int64]:
    corner: NDArray[np.int64] = 3 * triangle + (rows[triangle] == node[:, None]).argmax(axis=1)
    return corner


def cut_sheet(
    positions: NDArray[np.float64],
    triangles: NDArray[np.int32],
    facets: NDArray[Any],
    cuts: Sequence[tuple[int, int]],
    senses: Mapping[tuple[int, int], int],
    rest_angles: Mapping[tuple[int, int], float],
) -> Mesh:
    """Return the mesh of a sheet, cut first: edges of copied nodes keep what they were.

    Raises
    ------
    ConfigError
        For a cut that cannot open.
    """
    used, compact = np.unique(triangles, return_inverse=True)
    rows = compact.reshape(-1, 3)
    torn, origin = cut_along(len(used), rows, np.searchsorted(used, _pairs_in(cuts, used)))
    source = used[origin]
    _, hinges, _ = shared_edges(torn)
    crease = hinges[:, :2]
    before = np.sort(source[crease], axis=1)
    shut = np.flatnonzero(is_among(before, cuts))
    if len(shut):
        raise ConfigError(
            f"the cut {before[shut[0]].tolist()} is one edge between two ends inside the sheet",
            expected="a node on the cut, at which it can open",
            fix="divide the cut in two",
            key="edges_assignment",
        )
    names = [(int(i), int(j)) for i, j in crease]
    olds = [(int(i), int(j)) for i, j in before]
    points = positions[source]
    return surface_mesh(
        points,
        torn,
        facets=crease[is_among(before, facets)],
        senses={new: senses.get(old, 0) for new, old in zip(names, olds, strict=True)},
        rest_angles={
            new: rest_angles[old]
            for new, old in zip(names, olds, strict=True)
            if old in rest_angles
        },
        node_sets=extreme_sets(points),
    )


def _pairs_in(pairs: Sequence[tuple[int, int]], used: NDArray[Any]) -> NDArray[np.int64]:
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return rows[np.isin(rows, used).all(axis=1)]
