"""From panels to bars and hinges: what every folded or cut sheet is made with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.meshing.mesh import Mesh, dihedral_angles
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    Nodes = NDArray[np.int32]

#: A fold that is bent by less [rad] has no sense.
FLAT_SLACK = 1e-9


def split_quads(
    positions: NDArray[np.float64], quads: ArrayLike, *, short: bool = True
) -> tuple[Nodes, Nodes]:
    """Cut quadrilaterals into two triangles each.

    Parameters
    ----------
    positions : (N, 3) [m]
    quads : (Q, 4) [node]
        Around each panel.
    short : bool
        Along the shorter diagonal, as a panel bends most easily (Filipov, Liu, Tachi,
        Schenk & Paulino 2017, doi:10.1016/j.ijsolstr.2017.05.028); where both are equal, and
        for all panels when False, from the first corner to the third.

    Returns
    -------
    triangles : (2 Q, 3) [node]
    diagonals : (Q, 2) [node]
    """
    rows = np.array(quads, dtype=np.int32).reshape(-1, 4)
    if short:
        a, b, c, d = (positions[rows[:, corner]] for corner in range(4))
        one, two = np.linalg.norm(c - a, axis=1), np.linalg.norm(d - b, axis=1)
        # The margin keeps panels that differ by rounding only alike, and runs of hinges whole.
        turn = two < one * (1.0 - 1e-9)
        rows[turn] = np.roll(rows[turn], -1, axis=1)
    triangles = np.concatenate([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]])
    return triangles, rows[:, [0, 2]]


def shared_edges(triangles: ArrayLike) -> tuple[Nodes, Nodes, NDArray[np.int64]]:
    """Find the edges of oriented triangles.

    Returns
    -------
    rims : (R, 2) [node]
        Edges of one triangle only.
    hinges : (K, 4) [node]
        ``[j, k, i, l]`` for edges of two: (j, k, i) and (k, j, l) are the two triangles as
        they are oriented, and ``j < k``.
    owners : (K, 2)
        Which triangle has i, which has l.

    Raises
    ------
    ConfigError
        When three triangles meet at an edge, or neighbours turn to different sides.
    """
    rows = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    directed = np.concatenate([rows[:, [0, 1]], rows[:, [1, 2]], rows[:, [2, 0]]])
    apex = np.concatenate([rows[:, 2], rows[:, 0], rows[:, 1]])
    owner = np.tile(np.arange(len(rows)), 3)
    low, high = directed.min(axis=1), directed.max(axis=1)
    order = np.lexsort((directed[:, 0] != low, high, low))
    key = np.stack([low, high], axis=1)[order]
    new = np.ones(len(key), dtype=bool)
    new[1:] = (key[1:] != key[:-1]).any(axis=1)
    first = np.flatnonzero(new)
    size = np.diff(np.append(first, len(key)))
    if (size > 2).any():
        raise ConfigError(
            f"{size.max()} triangles meet at the edge {key[first[size.argmax()]].tolist()}",
            expected="one or two, so that a hinge has two wings",
            fix="split the body where sheets meet, and tie their nodes by bars",
            key="faces",
        )
    pair = first[size == 2]
    left, right = order[pair], order[pair + 1]
    same = (directed[left] == directed[right]).all(axis=1)
    if same.any():
        raise ConfigError(
            f"the two triangles at edge {key[pair[same][0]].tolist()} turn to different sides",
            expected="faces listed counter-clockwise seen from one side of the sheet",
            fix="reverse the order of nodes in one of the faces",
            key="faces",
        )
    hinges = np.stack([low[left], high[left], apex[left], apex[right]], axis=1)
    return key[first[size == 1]], hinges, np.stack([owner[left], owner[right]], axis=1)


def surface_mesh(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    facets: ArrayLike = (),
    senses: Mapping[tuple[int, int], int] | None = None,
    rest_angles: Mapping[tuple[int, int], float] | None = None,
    node_sets: Mapping[str, Any] | None = None,
) -> Mesh:
    """Return the mesh of a triangulated sheet: a bar on every edge, a hinge on every inner one.

    Parameters
    ----------
    positions : (N, 3) [m]
    triangles : (F, 3) [node]
        Counter-clockwise seen from one side of the sheet.
    facets : (D, 2) [node]
        Edges inside panels; inner edges that are not among them are folds.
    senses : mapping of (low node, high node) to {-1, 0, 1}, optional
        Mountains and valleys; by default as the sheet is folded in `positions`.
    rest_angles : mapping of (low node, high node) to float [rad], optional
        Hinges that are not in it rest as they are in `positions`.
    node_sets : mapping, optional
        "boundary" is added: the nodes of edges that belong to one triangle.

    Raises
    ------
    ConfigError
        When three triangles meet at an edge, or neighbours turn to different sides.
    """
    points = np.array(positions, dtype="f8").reshape(-1, 3)
    rows = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    rims, hinges, _ = shared_edges(rows)
    creases = hinges[:, :2]
    kinds = np.where(is_among(creases, facets), "facet", "fold")
    angles = dihedral_angles(points, hinges)
    if senses is None:
        signs = senses_of(angles, kinds)
    else:
        signs = edge_values(creases, senses, 0).astype(np.int8)
    if rest_angles is not None:
        given = edge_values(creases, rest_angles, np.nan)
        angles = np.where(np.isnan(given), angles, given)
    return Mesh(
        positions=points,
        bars=np.concatenate([rims, creases]),
        bar_kinds=np.concatenate([np.full(len(rims), "boundary"), kinds]),
        hinges=hinges,
        hinge_kinds=kinds,
        senses=signs,
        rest_angles=angles,
        faces=rows,
        node_sets={"boundary": rims.ravel(), **(node_sets or {})},
    )


def senses_of(angles: NDArray[np.float64], kinds: NDArray[np.str_]) -> NDArray[np.int8]:
    """Return 1 for valleys, -1 for mountains, 0 for facets and what is flat: (K,)."""
    bend = np.pi - angles
    signs = np.where(np.abs(bend) > FLAT_SLACK, np.sign(bend), 0.0)
    return np.where(kinds == "fold", signs, 0.0).astype(np.int8)


def is_among(pairs: NDArray[np.int32], chosen: ArrayLike) -> NDArray[np.bool_]:
    """Tell which of `pairs` (E, 2) are among `chosen` (D, 2), in either direction: (E,)."""
    wanted = np.asarray(chosen, dtype=np.int64).reshape(-1, 2)
    base = 1 + int(max(pairs.max(initial=0), wanted.max(initial=0)))

    def code(rows: NDArray[Any]) -> NDArray[np.int64]:
        ends: NDArray[np.int64] = np.sort(rows.astype(np.int64), axis=1)
        return ends[:, 0] * base + ends[:, 1]

    return np.isin(code(pairs), code(wanted))


def edge_values(
    pairs: NDArray[np.int32], values: Mapping[tuple[int, int], Any], default: float
) -> NDArray[np.float64]:
    """Return what `values` has for each of `pairs` (E, 2), lower node first: (E,)."""
    ends = np.sort(pairs, axis=1).tolist()
    return np.array([values.get((i, j), default) for i, j in ends], dtype="f8")
