"""Meshes from FOLD files (version 1.2, https://github.com/edemaine/fold)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.meshing.cutting import cut_sheet
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.mesh_text import finite, metres_per_unit, named, read_text
from openprc.demlat.meshing.parameters import between
from openprc.demlat.meshing.planar_graph import panels_of, signed_area
from openprc.demlat.meshing.polygons import triangulate
from openprc.demlat.meshing.surface import shared_edges
from openprc.errors import ConfigError, OpenPRCError, UnreadableFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Metres per `frame_unit`.
UNITS: Mapping[str, float] = MappingProxyType(
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 25.4e-3, "pt": 25.4e-3 / 72}
)
ASSIGNMENTS = "BMVFUCJ"
SENSES = MappingProxyType({"M": -1, "V": 1})
MAX_FRAMES = 10_000


def read_fold(
    path: str | Path, *, frame: int = 0, scale: float | None = None, fold_angle: float = 0.0
) -> Mesh:
    """Return the sheet in one frame of a FOLD file.

    Every edge becomes a bar and every inner edge a hinge: folds (M, V, U), facets (F, J and
    the edges that cut panels into triangles); cuts (C) separate the sheet. A crease pattern
    without faces gets them from its edges. Rest angles are `edges_foldAngle` where the file
    has it, ``pi -+ fold_angle`` at mountains and valleys where it has not, and else as the
    sheet lies in the file.

    Parameters
    ----------
    path : path-like
    frame : int
        0 is the file itself, 1 the first of ``file_frames``, and so on.
    scale : float [m], optional
        Length of one unit, when `frame_unit` does not say it.
    fold_angle : float [rad]
        For mountains and valleys without `edges_foldAngle`; 0 leaves them flat.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When the file cannot be read, or is no JSON object.
    ConfigError
        When the content is wrong; the message names the key.
    """
    file, text = read_text(path)
    data = _frame(_parsed(text, file), frame, file)
    rest = between(fold_angle, "fold_angle", low=0.0, high=math.pi, closed=True)
    positions = _coordinates(data, file) * _unit(data, scale, file)
    edges, kinds, angles = _edges(data, len(positions), file)
    try:
        panels = _panels(data, positions, edges, file)
        triangles, diagonals = triangulate(positions, panels)
        _check_edges(triangles, edges, kinds)
        senses = {edge: SENSES.get(kind, 0) for edge, kind in zip(edges, kinds, strict=True)}
        wanted = {
            edge: math.pi - math.radians(angle)
            for edge, angle in zip(edges, angles, strict=True)
            if angle is not None
        }
        for edge, sense in senses.items():
            if sense and rest > 0.0:
                wanted.setdefault(edge, math.pi - sense * rest)
        soft = [edge for edge, kind in zip(edges, kinds, strict=True) if kind in "FJ"]
        facets = np.concatenate([diagonals, np.array(soft, dtype="i4").reshape(-1, 2)])
        cuts = [edge for edge, kind in zip(edges, kinds, strict=True) if kind == "C"]
        return cut_sheet(positions, triangles, facets, cuts, senses, wanted)
    except OpenPRCError as error:
        raise named(error, file) from None


def _parsed(text: str, file: Path) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise UnreadableFile(
            f"invalid JSON at line {error.lineno}, column {error.colno}: {error.msg}",
            expected="one JSON object",
            file=file,
        ) from None
    except (RecursionError, ValueError) as error:
        raise UnreadableFile(
            f"JSON that cannot be read: {error}", expected="one JSON object", file=file
        ) from None
    if not isinstance(data, dict):
        raise UnreadableFile(
            f"a JSON {type(data).__name__}",
            expected="a JSON object with vertices_coords",
            file=file,
        )
    return data


def _frame(data: dict[str, Any], number: int, file: Path) -> dict[str, Any]:
    frames = data.get("file_frames", [])
    if not isinstance(frames, list) or not all(isinstance(item, dict) for item in frames):
        raise ConfigError("no list of frames", expected="objects", file=file, key="file_frames")
    if len(frames) > MAX_FRAMES:
        raise ConfigError(
            f"{len(frames)} frames", expected=f"at most {MAX_FRAMES}", file=file, key="file_frames"
        )
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number <= len(frames):
        raise ConfigError(
            f"frame {number!r}", expected=f"a frame from 0 to {len(frames)}", file=file, key="frame"
        )
    found: dict[str, Any] = {}
    seen: set[int] = set()
    while True:
        if number in seen:
            raise ConfigError(
                f"frame {number} inherits from itself",
                expected="parents that end at frame 0",
                file=file,
                key="frame_parent",
            )
        seen.add(number)
        here = data if number == 0 else frames[number - 1]
        found = {**here, **found}
        if number == 0 or here.get("frame_inherit", False) is not True:
            return found
        parent = here.get("frame_parent", 0)
        if type(parent) is not int or not 0 <= parent <= len(frames):
            raise ConfigError(
                f"the parent {parent!r} of frame {number}",
                expected=f"a frame from 0 to {len(frames)}",
                file=file,
                key="frame_parent",
            )
        number = parent


def _unit(data: dict[str, Any], scale: float | None, file: Path) -> float:
    name = data.get("frame_unit", "unit")
    known = UNITS.get(name) if isinstance(name, str) else None
    if known is not None and scale is not None:
        raise ConfigError(
            f"scale={scale!r}, and the file says that a unit is 1 {name}",
            expected="one of them",
            fix="leave scale out",
            file=file,
            key="frame_unit",
        )
    if known is None and scale is None:
        raise ConfigError(
            f"lengths in {name!r}",
            expected="one of " + ", ".join(UNITS),
            fix="say how many metres one unit is: scale=",
            file=file,
            key="frame_unit",
        )
    return metres_per_unit(scale, file=file) if known is None else known


def _coordinates(data: dict[str, Any], file: Path) -> NDArray[np.float64]:
    rows = data.get("vertices_coords")
    if not isinstance(rows, list) or not rows:
        raise ConfigError(
            "no coordinates",
            expected="a list of [x, y] or [x, y, z]",
            fix="give the frame that has them; abstract complexes have no shape",
            file=file,
            key="vertices_coords",
        )
    points = np.zeros((len(rows), 3))
    for n, row in enumerate(rows):
        key = f"vertices_coords/{n}"
        if not isinstance(row, list) or len(row) not in (2, 3):
            raise ConfigError(f"found {row!r}", expected="[x, y] or [x, y, z]", file=file, key=key)
        points[n, : len(row)] = [finite(value, file=file, key=key) for value in row]
    return points


def _nodes(row: Any, n_nodes: int, file: Path, key: str, least: int) -> list[int]:
    fits = isinstance(row, list) and len(row) >= least
    if not fits or not all(type(node) is int and 0 <= node < n_nodes for node in row):
        raise ConfigError(
            f"found {row!r}",
            expected=f"{least} or more vertices from 0 to {n_nodes - 1}",
            file=file,
            key=key,
        )
    return list(row)


def _column(data: dict[str, Any], key: str, count: int, file: Path) -> list[Any]:
    column = data.get(key, [None] * count)
    if not isinstance(column, list) or len(column) != count:
        raise ConfigError(
            "a list that does not fit", expected=f"{count}, one an edge", file=file, key=key
        )
    return column


def _edges(
    data: dict[str, Any], n_nodes: int, file: Path
) -> tuple[list[tuple[int, int]], list[str], list[float | None]]:
    rows = data.get("edges_vertices", [])
    if not isinstance(rows, list):
        raise ConfigError("no list", expected="[u, v] pairs", file=file, key="edges_vertices")
    edges: list[tuple[int, int]] = []
    for e, row in enumerate(rows):
        key = f"edges_vertices/{e}"
        nodes = _nodes(row, n_nodes, file, key, 2)
        if len(nodes) != 2 or nodes[0] == nodes[1]:
            raise ConfigError(
                f"found {row!r}", expected="two different vertices", file=file, key=key
            )
        edges.append((min(nodes), max(nodes)))
    if len(set(edges)) < len(edges):
        raise ConfigError("an edge twice", expected="every edge once", file=file,
                          key="edges_vertices")  # fmt: skip
    kinds = [
        "U" if kind is None else str(kind).upper()
        for kind in _column(data, "edges_assignment", len(edges), file)
    ]
    unknown = next((kind for kind in kinds if len(kind) != 1 or kind not in ASSIGNMENTS), None)
    if unknown is not None:
        raise ConfigError(
            f"the assignment {unknown!r}",
            expected="one of " + ", ".join(ASSIGNMENTS),
            file=file,
            key="edges_assignment",
        )
    angles: list[float | None] = []
    for e, value in enumerate(_column(data, "edges_foldAngle", len(edges), file)):
        key = f"edges_foldAngle/{e}"
        angle = None if value is None else finite(value, file=file, key=key)
        if angle is not None and abs(angle) > 180.0:
            raise ConfigError(
                f"found {value!r}", expected="degrees from -180 to 180", file=file, key=key
            )
        angles.append(angle)
    return edges, kinds, angles


def _panels(
    data: dict[str, Any],
    positions: NDArray[np.float64],
    edges: list[tuple[int, int]],
    file: Path,
) -> list[list[int]]:
    rows = data.get("faces_vertices")
    plane = not np.ptp(positions[:, 2])
    if rows is None:
        if not plane or not edges:
            raise ConfigError(
                "no faces",
                expected="faces_vertices, or the edges of a crease pattern in the plane",
                file=file,
                key="faces_vertices",
            )
        return panels_of(positions[:, :2], np.array(edges))
    if not isinstance(rows, list) or not rows:
        raise ConfigError("no list", expected="lists of vertices", file=file, key="faces_vertices")
    panels = [
        _nodes(row, len(positions), file, f"faces_vertices/{f}", 3) for f, row in enumerate(rows)
    ]
    directed = [pair for panel in panels for pair in pairwise([*panel, panel[0]])]
    if plane and len(set(directed)) < len(directed):
        # A crease pattern, seen from above, has one side whatever the file says; a sheet that
        # is folded flat is turned consistently, or it is no sheet.
        return [panel[::-1] if signed_area(positions, panel) < 0 else panel for panel in panels]
    return panels


def _check_edges(
    triangles: NDArray[np.int32], edges: list[tuple[int, int]], kinds: list[str]
) -> None:
    rows = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    there = set(map(tuple, rows.tolist()))
    stray = next((edge for edge in edges if edge not in there), None)
    if stray is not None:
        raise ConfigError(
            f"the edge {list(stray)} is an edge of no face",
            expected="edges between neighbouring corners of faces",
            key="edges_vertices",
        )
    inner = shared_edges(triangles)[1][:, :2]
    rims = {edge for edge, kind in zip(edges, kinds, strict=True) if kind == "B"}
    wrong = sorted(rims & set(map(tuple, inner.tolist())))
    if wrong:
        raise ConfigError(
            f"the boundary edge {list(wrong[0])} lies between two faces",
            expected="one face at a boundary edge (B); C for a cut",
            key="edges_assignment",
        )
