"""A shallow arched sheet with two mirrored stable states."""

from __future__ import annotations

import math

import numpy as np

from openprc.demlat.meshing.lattices import grid, grid_sets, quads_of
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import between, count, length
from openprc.demlat.meshing.surface import split_quads, surface_mesh


def bistable_slab(columns: int, rows: int, *, span: float, width: float, rise: float) -> Mesh:
    """Return a sheet that is longer than the span between its ends, buckled upwards.

    The bars have their rest lengths on a circular arc of the given rise, and the hinges rest
    flat: the shape mirrored at z = 0 has exactly the same energy, and to get there the bars
    are compressed. With both ends ("left" and "right") fixed and bars much stiffer than
    hinges both shapes are stable.

    Parameters
    ----------
    columns, rows : int
        Nodes along x (at least 3) and y (at least 2).
    span : float [m]
        Between the ends, along x.
    width : float [m]
        Along y.
    rise : float [m]
        Of the middle above the ends; less than half the span.
    """
    nx, ny = count(columns, "columns", least=3), count(rows, "rows", least=2)
    chord, across = length(span, "span"), length(width, "width")
    top = between(rise, "rise", low=0.0, high=0.5 * chord, unit="m")
    half = 2.0 * math.atan(2.0 * top / chord)
    radius = 0.5 * chord / math.sin(half)
    turn = np.linspace(-half, half, nx)
    number = grid(nx, ny)
    positions = np.zeros((ny, nx, 3))
    positions[..., 0] = radius * np.sin(turn) + 0.5 * chord
    positions[..., 1] = np.linspace(0.0, across, ny)[:, None]
    positions[..., 2] = radius * (np.cos(turn) - math.cos(half))
    points = positions.reshape(-1, 3)
    triangles, _ = split_quads(points, quads_of(number), short=False)
    bars = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    mesh = surface_mesh(points, triangles, facets=bars, node_sets=grid_sets(number))
    return mesh.folded(0.0, facets_flat=True)
