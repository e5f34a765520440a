"""Bars, hinges and faces of a FOLD file, in 0-based indices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import SchemaError
from openprc_merlin import geometry
from openprc_merlin.topology import BEND, BOUNDARY, FOLD

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_ASSIGNMENTS = frozenset("BMVFUCJ")


@dataclass(frozen=True)
class FoldMesh:
    """What connects the vertices.

    Attributes
    ----------
    edges : (E, 2)
    assignments : E letters of B, M, V, F, U, C, J; U where the file does not say
    faces : (F, 3) triangles
    hinges : (H, 4) crease, then wings: edges between two triangles that are no cut
    edge_code : (E,) boundary, fold or bend
    hinge_code : (H,) fold or bend
    notes : what a reader should know
    """

    edges: Ints
    assignments: tuple[str, ...]
    faces: Ints
    hinges: Ints
    edge_code: Ints
    hinge_code: Ints
    notes: tuple[str, ...]


def build(frame: Mapping[str, Any], *, shape: Floats, file: Path) -> FoldMesh:
    """Collect edges, triangles and hinges of a frame.

    Parameters
    ----------
    frame : the keys of the frame, with what it inherits
    shape : (N, 2) or (N, 3) coordinates, by which polygons are cut
    file : what errors name

    Raises
    ------
    SchemaError
        When a vertex is not there, or a list does not fit.
    """
    edges = _edges(frame, len(shape), file)
    letters = _letters(frame, len(edges), file)
    faces, notes = _faces(frame, shape, file)
    letter_at = {tuple(sorted(e)): a for e, a in zip(edges.tolist(), letters, strict=True)}
    hinges = geometry.triangles_to_hinges(geometry.orient(faces))
    if shape.shape[1] == 2:
        # Dihedral angles of a body that stays in its plane say nothing.
        hinges = hinges[:0]
    sides = letter_at if len(edges) else dict.fromkeys(_sides(frame), "U")
    creases = [sides.get(tuple(sorted(row[:2])), "C") for row in hinges.tolist()]
    hinges = hinges[np.array([letter != "C" for letter in creases], dtype=bool)]
    codes = [
        BEND if letter_at.get(tuple(sorted(row[:2]))) == "J" else FOLD for row in hinges.tolist()
    ]
    code_at = {tuple(sorted(r[:2])): c for r, c in zip(hinges.tolist(), codes, strict=True)}
    return FoldMesh(
        edges=edges,
        assignments=letters,
        faces=faces,
        hinges=hinges,
        edge_code=np.array(
            [code_at.get(tuple(sorted(edge)), BOUNDARY) for edge in edges.tolist()], dtype=np.int64
        ),
        hinge_code=np.array(codes, dtype=np.int64),
        notes=tuple(notes),
    )


def wrong(file: Path, key: str, found: str, expected: str) -> SchemaError:
    """Return the error of a key whose value does not fit."""
    return SchemaError(
        found, expected=expected, fix="correct the program that wrote it", file=file, key=key
    )


def vertices(row: Any, n_nodes: int, *, key: str, file: Path) -> list[int]:
    """Return a list of different vertices.

    Raises
    ------
    SchemaError
        When it is none.
    """
    fits = isinstance(row, list) and all(type(v) is int and 0 <= v < n_nodes for v in row)
    if not fits or len(set(row)) != len(row):
        raise wrong(
            file, key, f"found {str(row)[:60]}", f"different vertices from 0 to {n_nodes - 1}"
        )
    return list(row)


def _rows(frame: Mapping[str, Any], name: str, n_nodes: int, file: Path) -> list[list[int]]:
    rows = frame.get(name, [])
    if not isinstance(rows, list):
        raise wrong(file, name, "no list", "lists of vertices")
    return [vertices(row, n_nodes, key=f"{name}/{n}", file=file) for n, row in enumerate(rows)]


def _edges(frame: Mapping[str, Any], n_nodes: int, file: Path) -> Ints:
    rows = _rows(frame, "edges_vertices", n_nodes, file)
    uneven = next((n for n, row in enumerate(rows) if len(row) != 2), None)
    if uneven is not None:
        raise wrong(
            file, f"edges_vertices/{uneven}", f"{len(rows[uneven])} vertices", "two vertices"
        )
    return np.array(rows, dtype=np.int64).reshape(-1, 2)


def _letters(frame: Mapping[str, Any], count: int, file: Path) -> tuple[str, ...]:
    letters = frame.get("edges_assignment", ["U"] * count)
    if not isinstance(letters, list) or len(letters) != count:
        raise wrong(file, "edges_assignment", "a list that does not fit", f"{count} letters")
    told = ["U" if letter is None else letter for letter in letters]
    for n, letter in enumerate(told):
        if not isinstance(letter, str) or letter.upper() not in _ASSIGNMENTS:
            raise wrong(
                file, f"edges_assignment/{n}", f"found {letter!r}", "one of B, M, V, F, U, C, J"
            )
    return tuple(letter.upper() for letter in told)


def _faces(frame: Mapping[str, Any], shape: Floats, file: Path) -> tuple[Ints, list[str]]:
    """Return triangles; polygons are cut from a corner that sees all the others."""
    polygons = _rows(frame, "faces_vertices", len(shape), file)
    points = np.zeros((len(shape), 3))
    points[:, : shape.shape[1]] = shape
    rows: list[tuple[int, int, int]] = []
    cut = 0
    left_out = 0
    for number, polygon in enumerate(polygons):
        if len(polygon) < 3:
            raise wrong(file, f"faces_vertices/{number}", f"{len(polygon)} vertices", "3 or more")
        triangles = _cut(points, polygon)
        cut += len(triangles) > 1
        left_out += not triangles
        rows += triangles
    notes = []
    if cut:
        notes.append(
            f"{cut} faces of more than three corners were cut into triangles; hinges lie on the "
            "edges of the file only, so these faces do not bend"
        )
    if left_out:
        notes.append(
            f"{left_out} faces that no corner sees all of were left out, with their hinges"
        )
    return np.array(rows, dtype=np.int64).reshape(-1, 3), notes


def _sides(frame: Mapping[str, Any]) -> set[tuple[int, int]]:
    """Return the sides of all polygons, which are the edges of a file that lists none."""
    return {
        (min(pair), max(pair))
        for polygon in frame.get("faces_vertices", [])
        for pair in zip(polygon, polygon[1:] + polygon[:1], strict=True)
    }


def _cut(points: Floats, polygon: list[int]) -> list[tuple[int, int, int]]:
    if len(polygon) == 3:
        return geometry.fan(polygon)
    for start in range(len(polygon)):
        triangles = geometry.fan(polygon[start:] + polygon[:start])
        a, b, c = (points[[row[n] for row in triangles]] for n in range(3))
        normals = np.cross(b - a, c - a)
        # The sum is the normal of the polygon, wherever it is cut from (Newell).
        if (normals @ normals.sum(axis=0) > 0).all():
            return triangles
    return []
