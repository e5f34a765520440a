"""A random lattice: points at a least distance, joined by their Delaunay triangulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import count, length
from openprc.demlat.meshing.surface import shared_edges, surface_mesh
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Least distance, in units of the root of the area per node, unless another one is given.
#: Random placement jams near 0.83 (coverage 0.547 of discs of that diameter).
DEFAULT_DISTANCE = 0.6
#: Triangles at the rim that are flatter than this (height over longest side) are left out.
LEAST_HEIGHT = 0.15
ROUNDS = 2000


def delaunay_lattice(
    n_nodes: int,
    rng: np.random.Generator,
    *,
    width: float,
    height: float,
    min_distance: float | None = None,
    bending: bool = False,
) -> Mesh:
    """Return a random lattice in a rectangle of the plane z = 0.

    Slivers at the rim, which the convex hull always has, are left out. Nodes are numbered in
    bands from the bottom to the top, from left to right in each. The sets "left", "right",
    "bottom" and "top" reach half a typical spacing, ``sqrt(width * height / n_nodes)``, inwards.

    Parameters
    ----------
    n_nodes : int
        At least 3.
    rng : numpy.random.Generator
    width, height : float [m]
        Nodes lie in [0, width] x [0, height].
    min_distance : float [m], optional
        No two nodes are closer; 0.6 times ``sqrt(width * height / n_nodes)`` unless given.
    bending : bool
        Hinges of the kind "facet" between the triangles.

    Raises
    ------
    ConfigError
        When that many nodes do not fit at that distance.
    """
    from scipy.spatial import Delaunay

    n = count(n_nodes, "n_nodes", least=3)
    size = np.array([length(width, "width"), length(height, "height")])
    typical = math.sqrt(float(size.prod()) / n)
    gap = (
        DEFAULT_DISTANCE * typical
        if min_distance is None
        else length(min_distance, "min_distance", zero=True)
    )
    points = _spread(n, rng, size, gap)
    band = np.floor(points[:, 1] / typical)
    points = points[np.lexsort((points[:, 0], band))]
    triangles = _without_slivers(points, Delaunay(points).simplices)
    positions = np.concatenate([points, np.zeros((n, 1))], axis=1)
    rims, hinges, _ = shared_edges(triangles)
    bars = np.concatenate([rims, hinges[:, :2]])
    sheet: dict[str, Any] = {}
    if bending:
        made = surface_mesh(positions, triangles, facets=bars)
        sheet = {"hinges": made.hinges, "hinge_kinds": made.hinge_kinds}
    return Mesh(
        positions=positions,
        bars=bars,
        bar_kinds=np.full(len(bars), "edge"),
        faces=triangles,
        node_sets={**_sides(points, 0.5 * typical), "boundary": rims.ravel()},
        **sheet,
    )


def _sides(points: Reals, depth: float) -> dict[str, NDArray[np.int64]]:
    """Return the nodes less than `depth` [m] from the outermost one on each side."""
    low, high = points.min(axis=0), points.max(axis=0)
    near = {
        "left": points[:, 0] - low[0],
        "right": high[0] - points[:, 0],
        "bottom": points[:, 1] - low[1],
        "top": high[1] - points[:, 1],
    }
    return {side: np.flatnonzero(distance < depth) for side, distance in near.items()}


def _spread(n: int, rng: np.random.Generator, size: Reals, gap: float) -> Reals:
    from scipy.spatial import cKDTree

    points = np.zeros((0, 2))
    for _ in range(ROUNDS):
        fresh = rng.uniform(0.0, size, (n, 2))
        if gap > 0.0 and len(points):
            far, _ = cKDTree(points).query(fresh)
            fresh = fresh[far >= gap]
        if gap > 0.0 and len(fresh) > 1:
            clash = cKDTree(fresh).query_pairs(gap, output_type="ndarray")
            # Of two that clash the later one goes, even where the earlier one goes as well.
            lost = np.zeros(len(fresh), dtype=bool)
            lost[clash.max(axis=1, initial=0) if len(clash) else []] = True
            fresh = fresh[~lost]
        points = np.concatenate([points, fresh])
        if len(points) >= n:
            return points[:n]
    raise ConfigError(
        f"only {len(points)} of {n} nodes fit {gap:g} m apart in {size[0]:g} m x {size[1]:g} m",
        expected="a distance below about 0.75 sqrt(width * height / n_nodes)",
        fix="give a smaller min_distance or fewer nodes",
        key="min_distance",
    )


def _without_slivers(points: Reals, simplices: NDArray[Any]) -> NDArray[np.int32]:
    rows = np.array(simplices, dtype=np.int32)
    a, b, c = (points[rows[:, corner]] for corner in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    rows[area < 0] = rows[area < 0][:, ::-1]
    longest = np.max([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1),
                      np.linalg.norm(a - c, axis=1)], axis=0)  # fmt: skip
    flat = np.abs(area) < LEAST_HEIGHT * longest**2
    while flat.any():
        rims, _, owners = shared_edges(rows)
        inner = np.bincount(owners.ravel(), minlength=len(rows))
        uses = np.bincount(rows.ravel(), minlength=len(points))
        # With all three nodes at the rim it may hold two parts together.
        ties = (inner == 2) & np.isin(rows, rims).all(axis=1)
        gone = np.flatnonzero(flat & (inner < 3) & ~ties)
        left = uses - np.bincount(rows[gone].ravel(), minlength=len(points))
        if (left == 0).any():
            # One by one, as long as no node loses its last triangle.
            gone = gone[(uses[rows[gone]] > 1).all(axis=1)][:1]
        if len(gone) == 0:
            break
        rows, flat = np.delete(rows, gone, axis=0), np.delete(flat, gone)
    return rows
