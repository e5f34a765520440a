"""Cells to bars and faces."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc_meshio.frames import Array

Ints = NDArray[np.int64]

#: Edges of the corners of a shape, in the numbering that VTK, meshio and XDMF share.
EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
                   (0, 4), (1, 5), (2, 6), (3, 7)),
}  # fmt: skip
_NAME = re.compile(r"([a-z]+)(\d*)\Z")


@dataclass
class Elements:
    """Elements of one kind, and which cell each of them comes from.

    Attributes
    ----------
    nodes : (E, k)
    cells : list of (shape, rows)
        In the order of the elements: row of the cells of a shape that each one comes from.
    """

    nodes: Ints
    cells: list[tuple[str, Ints]] = field(default_factory=list)

    def values(self, fields: Mapping[str, Array]) -> Array:
        """Return a field of the cells as one of the elements; NaN where it has no value."""
        tail = next((fields[s].shape[1:] for s, _ in self.cells if s in fields), ())
        parts = [
            fields[shape][rows].astype(np.float64)
            if shape in fields
            else np.full((len(rows), *tail), np.nan)
            for shape, rows in self.cells
        ]
        rest = len(self.nodes) - sum(len(part) for part in parts)
        return np.concatenate([*parts, np.full((rest, *tail), np.nan)])


@dataclass
class Topology:
    """Bars and faces of a mesh, and what was done to get them."""

    bars: Elements
    faces: Elements
    notes: list[str]


def build(tables: Mapping[str, Ints], *, n_nodes: int, edges: bool, path: Path) -> Topology:
    """Turn cells into bars and faces.

    Lines become bars, triangles faces; quadrilaterals and polygons are split from their first
    corner. Of shapes with nodes between the corners the corners count. What is left becomes
    bars along its edges when `edges` is set, each edge once.

    Raises
    ------
    UnreadableFile
        When a cell names a node that is not there.
    """
    notes: list[str] = []
    bars: list[tuple[str, Ints, Ints]] = []
    faces: list[tuple[str, Ints, Ints]] = []
    ring: list[Ints] = []
    left: list[str] = []
    for shape, table in tables.items():
        if table.size and (table.min() < 0 or table.max() >= n_nodes):
            wrong = int(table.min() if table.min() < 0 else table.max())
            raise UnreadableFile(
                f"a {shape} names node {wrong}",
                expected=f"nodes 0 to {n_nodes - 1}",
                fix="export the mesh again",
                file=path,
            )
        base, corners = _corners(shape, table)
        rows = np.arange(len(table))
        if base == "line":
            bars += [(shape, pair, rows) for pair in _pairs(corners)]
        elif base in ("triangle", "quad", "polygon") and corners.shape[1] >= 3:
            faces += [
                (shape, corners[:, [0, k, k + 1]], rows) for k in range(1, corners.shape[1] - 1)
            ]
        elif base != "vertex" and not (edges and base in EDGES):
            left.append(f"{len(table)} {shape}")
        if edges and base != "line":
            ring += list(_edges(base, corners))
        if corners.shape[1] < table.shape[1] and len(table):
            notes.append(f"{len(table)} {shape}: the corners count, nodes between them stay nodes")
        if base in ("quad", "polygon") and corners.shape[1] > 3 and len(table):
            notes.append(f"{len(table)} {shape} were split into triangles from their first corner")
    if left:
        notes.append(
            f"cells that are neither lines nor faces were left out: {', '.join(left)}; "
            "edges=true makes bars of their edges"
        )
    found = _join(bars, 2, notes, "bars")
    if ring:
        found.nodes = _with_edges(found.nodes, np.concatenate(ring), notes)
    return Topology(found, _join(faces, 3, notes, "faces"), notes)


def _corners(shape: str, table: Ints) -> tuple[str, Ints]:
    """Return the shape without its order, and the nodes at its corners."""
    match = _NAME.match(shape)
    base = match[1] if match else shape
    if base in ("polyline", "polygon", "vertex"):
        return ("line" if base == "polyline" else base), table
    count = {"line": 2, "triangle": 3, "quad": 4}.get(base)
    if base in EDGES and count is None:
        count = 1 + max(max(pair) for pair in EDGES[base])
    return base, table if count is None else table[:, :count]


def _pairs(corners: Ints) -> Iterator[Ints]:
    for k in range(corners.shape[1] - 1):
        yield corners[:, k : k + 2]


def _edges(base: str, corners: Ints) -> Iterator[Ints]:
    if base == "polygon":
        yield from _pairs(np.column_stack([corners, corners[:, :1]]))
    for pair in EDGES.get(base, ()):
        yield corners[:, list(pair)]


def _join(parts: list[tuple[str, Ints, Ints]], width: int, notes: list[str], kind: str) -> Elements:
    joined = Elements(np.empty((0, width), dtype=np.int64))
    tables = []
    degenerate = 0
    for shape, nodes, rows in parts:
        ordered = np.sort(nodes, axis=1)
        good = (np.diff(ordered, axis=1) != 0).all(axis=1)
        degenerate += int(np.count_nonzero(~good))
        tables.append(nodes[good])
        joined.cells.append((shape, rows[good]))
    if tables:
        joined.nodes = np.concatenate(tables)
    if degenerate:
        notes.append(f"{degenerate} {kind} with the same node twice were left out")
    return joined


def _with_edges(bars: Ints, ring: Ints, notes: list[str]) -> Ints:
    """Return the bars, and behind them the edges that are no bar yet, each once."""
    ring = np.sort(ring, axis=1)
    ring = np.unique(ring[ring[:, 0] != ring[:, 1]], axis=0)
    known = {tuple(pair) for pair in np.sort(bars, axis=1).tolist()}
    new = np.array([pair for pair in ring.tolist() if tuple(pair) not in known], dtype=np.int64)
    notes.append(f"{len(new)} edges of cells were made bars, as asked")
    return np.concatenate([bars, new.reshape(-1, 2)])
