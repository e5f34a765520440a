"""Meshes from Wavefront OBJ files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from openprc.demlat.meshing.lattices import extreme_sets
from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.mesh_text import finite, metres_per_unit, named, read_text
from openprc.demlat.meshing.polygons import triangulate, turned_alike
from openprc.demlat.meshing.surface import surface_mesh
from openprc.errors import ConfigError, OpenPRCError


def read_obj(path: str | Path, *, scale: float, facet_bend: float | None = None) -> Mesh:
    """Return the sheet in a Wavefront OBJ file.

    Vertices (``v``) and faces (``f``, with negative numbers too) are read, everything else is
    left alone, files that it names included. Faces with more than three corners are cut into
    triangles; edges inside them are facets, other inner edges are folds. Vertices of no face
    are left out. Faces are turned alike, as the first one of each piece is turned.

    Parameters
    ----------
    path : path-like
    scale : float [m]
        Length of one unit of the file, which does not say it itself.
    facet_bend : float [rad], optional
        Folds that are bent by less are facets as well.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When the file cannot be read.
    ConfigError
        When a line is wrong, or the faces make no sheet.
    """
    file, text = read_text(path)
    unit = metres_per_unit(scale, file=file)
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for line, row in enumerate(text.replace("\\\n", " ").splitlines(), start=1):
        words = row.partition("#")[0].split()
        key = f"line {line}"
        if words[:1] == ["v"]:
            if len(words) < 4:
                raise ConfigError(
                    f"a vertex with {len(words) - 1} numbers",
                    expected="v x y z",
                    file=file,
                    key=key,
                )
            points.append([finite(word, file=file, key=key) for word in words[1:4]])
        elif words[:1] == ["f"]:
            faces.append([_vertex(word, len(points), file, key) for word in words[1:]])
    if not faces:
        raise ConfigError(
            f"{len(points)} vertices and no faces",
            expected="faces (lines that begin with f)",
            fix="export the mesh with its faces",
            file=file,
        )
    used, compact = np.unique(np.concatenate(faces), return_inverse=True)
    if used[-1] >= len(points):
        raise ConfigError(
            f"a face with vertex {used[-1] + 1}",
            expected=f"vertices from 1 to {len(points)}",
            file=file,
        )
    positions = unit * np.array(points)[used]
    ends = np.cumsum([len(face) for face in faces])[:-1]
    try:
        panels = turned_alike([part.tolist() for part in np.split(compact, ends)])
        triangles, diagonals = triangulate(positions, panels)
        mesh = surface_mesh(
            positions, triangles, facets=diagonals, node_sets=extreme_sets(positions)
        )
    except OpenPRCError as error:
        raise named(error, file) from None
    if facet_bend is None:
        return mesh
    soft = np.abs(mesh.angles - np.pi) < facet_bend
    facets = np.concatenate([diagonals, mesh.hinges[soft, :2]])
    return surface_mesh(positions, triangles, facets=facets, node_sets=extreme_sets(positions))


def _vertex(word: str, n_points: int, file: Path, key: str) -> int:
    text = word.partition("/")[0]
    try:
        number = int(text)
    except ValueError:
        number = 0
    index = number - 1 if number > 0 else n_points + number
    if number == 0 or index < 0:
        raise ConfigError(
            f"the corner {word!r}",
            expected=f"a vertex from 1 to {n_points}, or from -{n_points} to -1",
            file=file,
            key=key,
        )
    return index
