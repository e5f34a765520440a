"""The waterbomb tessellation."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from openprc.demlat.meshing.lattices import extreme_sets
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import check_size, count, length
from openprc.demlat.meshing.surface import surface_mesh

VALLEY, MOUNTAIN = 1, -1


def waterbomb(columns: int, rows: int, *, cell: float) -> Mesh:
    """Return a flat waterbomb sheet with its mountains and valleys.

    Every square cell has valleys along both diagonals and a mountain along the middle; the
    sides of cells are mountains, and every second row is shifted by half a cell (with half
    cells at its ends). `Mesh.folded` gives the folds a rest angle, so that the sheet folds
    when it is simulated; `k_cone` with k = 4 is the single waterbomb base.

    Parameters
    ----------
    columns, rows : int
        Cells along x and y.
    cell : float [m]
        Side of a cell.
    """
    across, up = count(columns, "columns"), count(rows, "rows")
    half = 0.5 * length(cell, "cell")
    check_size((3 * across + 2) * (up + 1), "columns")
    points: list[tuple[float, float]] = []

    def put(places: Iterable[int], y: float) -> dict[int, int]:
        # Even places first: so the nodes along each direction of folds are consecutive.
        order = sorted(places, key=lambda place: (place % 2, place))
        first = len(points)
        points.extend((half * place, y) for place in order)
        return {place: first + n for n, place in enumerate(order)}

    triangles: list[tuple[int, int, int]] = []
    diagonals: set[tuple[int, int]] = set()
    low = put(range(2 * across + 1), 0.0)
    for row in range(up):
        # Centres lie at odd places, in shifted rows at even ones, at both ends too.
        centres = put(range(1 - row % 2, 2 * across + 1, 2), half * (2 * row + 1))
        high = put(range(2 * across + 1), half * (2 * row + 2))
        for place, centre in centres.items():
            around = [
                *((low.get(place + side), side) for side in (-1, 0, 1)),
                *((high.get(place + side), side) for side in (1, 0, -1)),
            ]
            ring = [*around, around[0]]
            for (node, _), (following, _) in pairwise(ring):
                if node is not None and following is not None:
                    triangles.append((centre, node, following))
            diagonals |= {
                (min(centre, node), max(centre, node))
                for node, side in around
                if node is not None and side
            }
        low = high
    positions = np.zeros((len(points), 3))
    positions[:, :2] = points
    rows_of = np.sort(np.array(triangles)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    senses = {(i, j): VALLEY if (i, j) in diagonals else MOUNTAIN for i, j in rows_of.tolist()}
    return surface_mesh(positions, triangles, senses=senses, node_sets=extreme_sets(positions))
