"""Sequences of Wavefront OBJ files, one an increment, as MERLIN2's ``Write2OBJ`` makes them.

MERLIN2 adds bars as comment lines ``#e a b 1`` (bend) and ``#e a b 0`` (fold or boundary).
Other programs' sequences are read as well, as points and faces.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, SchemaError, UnreadableFile
from openprc.schema import safety
from openprc_merlin import geometry
from openprc_merlin.run import Run, Units, codes
from openprc_merlin.topology import BEND, BOUNDARY, FOLD

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
HEADER = "# This is an output from MERLIN2"
_NUMBER = re.compile(r"(\d+)(?!.*\d)")


@dataclass(frozen=True)
class Frame:
    """One OBJ file.

    Attributes
    ----------
    vertices : (N, 3)
    faces : tuple of corner tuples, 0-based
    edges : (M, 2) int, 0-based, of the ``#e`` lines; bends : (M,) bool
    """

    path: Path
    vertices: Floats
    faces: tuple[tuple[int, ...], ...]
    edges: Ints
    bends: NDArray[np.bool_]


def read_frame(path: Path) -> Frame:
    """Read vertices, faces and MERLIN2's edge comments.

    Raises
    ------
    UnreadableFile
        When a line cannot be understood, or there is no vertex.
    """
    safety.check_readable(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise _wrong(path, "this is not text") from error
    vertices: list[list[float]] = []
    faces: list[tuple[int, ...]] = []
    edges: list[tuple[int, int]] = []
    bends: list[bool] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        try:
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
            elif words[0] == "f":
                face = tuple(_corner(word, len(vertices)) for word in words[1:])
                if len(face) < 3 or len(set(face)) < len(face):
                    raise _wrong(path, f"line {number}: a face needs three different corners")
                faces.append(face)
            elif words[0] == "#e" and len(words) == 4:
                edges.append((int(words[1]) - 1, int(words[2]) - 1))
                bends.append(words[3] == "1")
        except ValueError as error:
            raise _wrong(path, f"line {number} is {line.strip()[:60]!r}") from error
        if vertices and len(vertices[-1]) != 3:
            raise _wrong(path, f"line {number} has {len(vertices[-1])} coordinates")
    used = [corner for face in faces for corner in face] + [n for edge in edges for n in edge]
    if not vertices or any(not 0 <= corner < len(vertices) for corner in used):
        raise _wrong(path, f"{len(vertices)} vertices, and faces or edges that name others")
    return Frame(
        path,
        np.array(vertices, dtype=np.float64),
        tuple(faces),
        np.array(edges, dtype=np.int64).reshape(-1, 2),
        np.array(bends, dtype=bool),
    )


def _corner(word: str, n_vertices: int) -> int:
    """Read ``7``, ``7/1/2`` or the relative ``-1`` as a 0-based index."""
    index = int(word.split("/")[0])
    return n_vertices + index if index < 0 else index - 1


def _wrong(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected="OBJ text: v x y z, f a b c",
        fix="export the sequence again",
        file=path,
    )


def members(path: Path) -> list[Path]:
    """Return the files of the sequence in order, for a folder or for one of its files.

    A sequence shares the text around the last number of the name: frame_0000.obj,
    frame_0020.obj. Files are ordered by that number.

    Raises
    ------
    ConfigError
        When a folder holds several sequences.
    MissingData
        When there are fewer than two files.
    """
    folder = path if path.is_dir() else path.parent
    groups: dict[tuple[str, str], list[tuple[int, Path]]] = {}
    for file in sorted(folder.glob("*")):
        if file.suffix.lower() != ".obj" or not file.is_file():
            continue
        found = _NUMBER.search(file.stem)
        if found:
            family = (file.stem[: found.start()], file.stem[found.end() :])
            groups.setdefault(family, []).append((int(found.group()), file))
    if path.is_dir():
        sequences = [group for group in groups.values() if len(group) > 1]
        if len(sequences) > 1:
            raise ConfigError(
                f"{len(sequences)} sequences: "
                + ", ".join(min(group)[1].name for group in sequences),
                expected="one",
                fix="name one file of the sequence instead of the folder",
                file=path,
            )
        chosen = sequences[0] if sequences else []
    else:
        chosen = next((g for g in groups.values() if path in [f for _, f in g]), [])
    if len(chosen) < 2:
        raise MissingData(
            f"{len(chosen)} numbered OBJ files",
            expected="at least two files whose names differ in a number, such as frame_0000.obj",
            fix="export one file an increment",
            file=path,
        )
    numbers = [number for number, _ in chosen]
    if len(set(numbers)) != len(numbers):
        raise ConfigError(
            "two files have the same number",
            expected="one file a number",
            fix="rename or remove one of them",
            file=path,
        )
    return [file for _, file in sorted(chosen)]


def number_of(file: Path) -> int:
    """Return the number in the name of a file of a sequence."""
    found = _NUMBER.search(file.stem)
    return int(found.group()) if found else 0


def is_sequence(path: Path) -> float:
    """Say how sure it is that `path` is a sequence: 1 from MERLIN2, 0.7 another, 0 none.

    Looks into the first and the last file only, and only counts their vertices.
    """
    try:
        files = members(path)
    except (ConfigError, MissingData):
        return 0.0
    first, last = (b"\n" + file.read_bytes() for file in (files[0], files[-1]))
    n_vertices = first.count(b"\nv ")
    if not n_vertices or n_vertices != last.count(b"\nv "):
        return 0.0
    return 1.0 if first[1:].startswith(HEADER.encode()) else 0.7


def _corners(frame: Frame) -> list[tuple[int, ...]]:
    """Return the corners of every face without regard to where it starts and its winding."""
    return [tuple(sorted(face)) for face in frame.faces]


def _triangles(frame: Frame) -> Ints:
    rows = [triangle for face in frame.faces for triangle in geometry.fan(list(face))]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def as_variables(frame: Frame) -> dict[str, Any]:
    """Return a frame as MERLIN variables, with 1-based indices."""
    truss: dict[str, Any] = {"Node": frame.vertices}
    if len(frame.edges):
        truss["Bars"] = (frame.edges + 1).astype(np.float64)
    triangles = _triangles(frame)
    if len(triangles):
        truss["Trigl"] = (triangles + 1).astype(np.float64)
    return {"truss": truss}


def load(path: Path, *, units: Units, rest: Mapping[str, Any] | None) -> tuple[Run, list[str]]:
    """Read a sequence.

    Parameters
    ----------
    path : Path
        The folder, or one file of the sequence.
    units : Units
    rest : mapping, optional
        Rest coordinates as `reference.load` returns them. OBJ files do not tell which of them,
        if any, is the unloaded shape.

    Raises
    ------
    SchemaError
        When the files do not hold one and the same mesh.
    """
    frames = [read_frame(file) for file in members(path)]
    first = frames[0]
    turned = False
    for frame in frames[1:]:
        turned |= frame.faces != first.faces
        # Write2OBJ turns each triangle to face upward, so the winding differs between frames.
        same = _corners(frame) == _corners(first) and np.array_equal(frame.edges, first.edges)
        if len(frame.vertices) != len(first.vertices) or not same:
            raise SchemaError(
                f"{len(frame.vertices)} vertices and {len(frame.faces)} faces, "
                f"unlike {first.path.name} with {len(first.vertices)} and {len(first.faces)}",
                expected="the same mesh in every file of the sequence",
                fix="keep one run in a folder",
                file=frame.path,
            )
    positions = np.stack([frame.vertices for frame in frames])
    notes = [f"increments are the numbers in the names of {len(frames)} files"]
    nodes = _rest_nodes(rest, len(first.vertices), path)
    if nodes is None:
        notes.append(
            "OBJ files hold no rest shape, so there are no strains; "
            "give it with reference=FILE (the undeformed frame, if there is one)"
        )
    faces = _triangles(first)
    if turned:
        faces = geometry.orient(faces)
        notes.append(
            "the winding of triangles differs between the files; they were turned alike, "
            "starting from the first triangle of the first file"
        )
    hinges = geometry.triangles_to_hinges(geometry.orient(faces)) if len(first.edges) else None
    bars = first.edges if len(first.edges) else None
    bar_static: dict[str, Any] = {}
    hinge_static: dict[str, Any] = {}
    if bars is not None and hinges is not None:
        inner = {tuple(pair) for pair in np.sort(hinges[:, :2], axis=1).tolist()}
        pairs = [tuple(pair) for pair in np.sort(bars, axis=1).tolist()]
        bent = {pair for pair, bend in zip(pairs, first.bends, strict=True) if bend}
        code = {True: BEND, False: FOLD}
        bar_static["kind_code"] = codes(
            [code[pair in bent] if pair in inner else BOUNDARY for pair in pairs]
        )
        hinge_static["kind_code"] = codes([code[tuple(row[:2]) in bent] for row in hinges.tolist()])
    run = Run(
        positions=positions,
        increments=np.array([number_of(frame.path) for frame in frames], dtype=np.int64),
        units=units,
        rest=nodes,
        bars=bars,
        bar_rest=None
        if nodes is None or bars is None
        else geometry.bar_lengths(nodes[None], bars)[0],
        bar_static=bar_static,
        hinges=hinges if hinges is not None and len(hinges) else None,
        hinge_static=hinge_static,
        faces=faces if len(faces) else None,
    )
    return run, notes


def _rest_nodes(rest: Mapping[str, Any] | None, n_nodes: int, path: Path) -> Floats | None:
    if rest is None:
        return None
    truss = rest.get("truss")
    nodes = truss["Node"] if isinstance(truss, dict) and "Node" in truss else rest["Node"]
    if nodes.shape != (n_nodes, 3):
        raise SchemaError(
            f"the reference has {len(nodes)} nodes, the sequence {n_nodes}",
            expected="the rest coordinates of the same mesh",
            fix="name the right file",
            file=path,
            key="reference",
        )
    return np.asarray(nodes, dtype=np.float64)
