"""Plane lattices: square, triangular and hexagonal.

Nodes are numbered row by row, from left to right and from the bottom to the top.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import check_size, count, length
from openprc.demlat.meshing.surface import surface_mesh
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Nodes = NDArray[np.int64]

Diagonals = Literal["none", "one", "both"]
DIAGONALS: tuple[Diagonals, ...] = get_args(Diagonals)


def square_lattice(
    columns: int,
    rows: int,
    *,
    spacing: float,
    diagonals: Diagonals = "both",
    bending: bool = False,
) -> Mesh:
    """Return a square lattice in the plane z = 0.

    Parameters
    ----------
    columns, rows : int
        Nodes along x and y.
    spacing : float [m]
    diagonals : {"none", "one", "both"}
        Of each square. Without diagonals the lattice is a mechanism: it shears freely.
    bending : bool
        Hinges of the kind "facet" between the triangles; with "one" diagonal only.

    Examples
    --------
    >>> from openprc.demlat.meshing import square_lattice
    >>> mesh = square_lattice(10, 10, spacing=0.1)
    >>> mesh.n_nodes, len(mesh.bars)
    (100, 342)
    """
    number = grid(columns, rows)
    step = length(spacing, "spacing")
    if diagonals not in DIAGONALS:
        raise ConfigError(
            f"diagonals {diagonals!r}", expected="one of " + ", ".join(DIAGONALS), key="diagonals"
        )
    if bending and diagonals != "one":
        raise ConfigError(
            f"bending with {diagonals!r} diagonals",
            expected='diagonals="one", so that every square is two triangles',
            key="bending",
        )
    positions = grid_positions(columns, rows) * step
    a, b, c, d = quads_of(number).T
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    edges = [number[:, :-1], number[:, 1:]], [number[:-1], number[1:]]
    sides = pairs(*edges[0]), pairs(*edges[1])
    crossing = []
    if diagonals != "none":
        crossing.append(np.stack([a, c], axis=1))
    if diagonals == "both":
        crossing.append(np.stack([b, d], axis=1))
    return _plane(
        positions,
        sides,
        crossing,
        faces if diagonals == "one" else None,
        grid_sets(number),
        bending,
    )


def triangular_lattice(columns: int, rows: int, *, spacing: float, bending: bool = False) -> Mesh:
    """Return a lattice of equilateral triangles in the plane z = 0.

    Parameters
    ----------
    columns, rows : int
        Nodes along x, and rows of nodes; every second row is shifted by half a spacing.
    spacing : float [m]
        Length of all bars.
    bending : bool
        Hinges of the kind "facet" between the triangles.
    """
    number = grid(columns, rows)
    step = length(spacing, "spacing")
    positions = grid_positions(columns, rows)
    positions[:, 0] += 0.5 * (positions[:, 1] % 2)
    positions *= step * np.array([1.0, math.sqrt(3.0) / 2.0, 0.0])
    a, b, c, d = quads_of(number).T
    even = np.repeat(np.arange(rows - 1) % 2 == 0, columns - 1)
    # The diagonal that is as long as the sides leans the other way in every second row.
    first = np.where(even[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    second = np.where(even[:, None], np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    crossing = np.where(even[:, None], np.stack([b, d], 1), np.stack([a, c], 1))
    sides = pairs(number[:, :-1], number[:, 1:]), pairs(number[:-1], number[1:])
    faces = np.concatenate([first, second])
    edges = (*sides, crossing)
    return _plane(positions, edges, [], faces, grid_sets(number), bending)


def hexagonal_lattice(columns: int, rows: int, *, side: float) -> Mesh:
    """Return a honeycomb in the plane z = 0.

    With axial springs alone a honeycomb is a mechanism with many ways to move.

    Parameters
    ----------
    columns, rows : int
        Hexagons along x, and rows of hexagons; every second row is shifted by half a cell.
    side : float [m]
        Length of all bars.
    """
    columns, rows = count(columns, "columns"), count(rows, "rows")
    step = length(side, "side")
    # Zigzag chains from left to right, tied at every second node to the chain above.
    across = 2 * columns + 2
    check_size(across * (rows + 1), "columns")
    chain, place = np.indices((rows + 1, across))
    # In each chain even places first: so the nodes along each direction are consecutive.
    number = across * chain + place // 2 + (place % 2) * (columns + 1)
    raised = (chain + place) % 2 == 1
    positions = np.zeros((number.size, 3))
    positions[number, 0] = place * (math.sqrt(3.0) / 2.0) * step
    positions[number, 1] = (1.5 * chain + 0.5 * raised) * step
    along = pairs(number[:, :-1], number[:, 1:])
    up = pairs(number[:-1], number[1:])[raised[:-1].ravel()]
    bars = np.concatenate([along, up])
    # Only the first and the last chain have an end that belongs to no hexagon.
    kept = np.bincount(bars.ravel(), minlength=number.size) > 1
    bars = bars[kept[bars].all(axis=1)]
    renamed = np.cumsum(kept) - 1
    positions = positions[kept]
    return Mesh(
        positions=positions,
        bars=renamed[bars],
        bar_kinds=np.full(len(bars), "edge"),
        node_sets=extreme_sets(positions),
    )


def _plane(
    positions: NDArray[np.float64],
    sides: tuple[Nodes, ...],
    crossing: list[Nodes],
    faces: Nodes | None,
    sets: dict[str, Nodes],
    bending: bool,
) -> Mesh:
    bars = np.concatenate([*sides, *crossing])
    kinds = np.full(len(bars), "edge", dtype="U16")
    kinds[sum(map(len, sides)) :] = "diagonal"
    hinges: dict[str, Any] = {}
    if bending and faces is not None and len(faces):
        sheet = surface_mesh(positions, faces, facets=bars)
        hinges = {"hinges": sheet.hinges, "hinge_kinds": sheet.hinge_kinds}
    return Mesh(
        positions=positions,
        bars=bars,
        bar_kinds=kinds,
        faces=np.zeros((0, 3), "i4") if faces is None else faces,
        node_sets=sets,
        **hinges,
    )


def grid(columns: int, rows: int) -> Nodes:
    """Return node numbers of a grid: (rows, columns)."""
    columns, rows = count(columns, "columns"), count(rows, "rows")
    check_size(columns * rows, "columns")
    return np.arange(columns * rows).reshape(rows, columns)


def grid_positions(columns: int, rows: int) -> NDArray[np.float64]:
    """Return (column, row, 0) of every node: (N, 3) [1]."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.stack([column, row, np.zeros(len(row))], axis=1).astype("f8")


def pairs(one: Nodes, two: Nodes) -> Nodes:
    """Return the pairs of two equal tables of nodes: (E, 2)."""
    return np.stack([one.ravel(), two.ravel()], axis=1)


def quads_of(number: Nodes) -> Nodes:
    """Return the corners of every cell of a grid, counter-clockwise from the lower left."""
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.stack([corner.ravel() for corner in corners], axis=1)


def grid_sets(number: Nodes) -> dict[str, Nodes]:
    """Return the first and last columns and rows of a grid, by name."""
    sides = {
        "left": number[:, 0],
        "right": number[:, -1],
        "bottom": number[0],
        "top": number[-1],
    }
    return {**sides, "boundary": np.concatenate(list(sides.values()))}


def extreme_sets(positions: NDArray[np.float64]) -> dict[str, Nodes]:
    """Return the nodes of least and largest x and y, to a billionth of the size."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    slack = 1e-9 * float((high - low).max())
    return {
        "left": np.flatnonzero(positions[:, 0] <= low[0] + slack),
        "right": np.flatnonzero(positions[:, 0] >= high[0] - slack),
        "bottom": np.flatnonzero(positions[:, 1] <= low[1] + slack),
        "top": np.flatnonzero(positions[:, 1] >= high[1] - slack),
    }
