"""Reading FOLD files with several frames: JSON of bounded size, frames with what they inherit."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, NotATrajectory, SchemaError, UnreadableFile, UnsafeFile
from openprc.schema import safety

Floats = NDArray[np.float64]
#: JSON takes some twenty times its size in memory while it is read.
MAX_BYTES = 256 << 20
MAX_FRAMES = 1_000_000
#: Keys that say which edges and faces there are; they may not change along an animation.
TOPOLOGY = ("edges_vertices", "faces_vertices")
_WANTED = "a FOLD file with coordinates in the key frame or in two or more of file_frames"


@dataclass(frozen=True)
class FoldRun:
    """An animation.

    Attributes
    ----------
    positions : (T, N, D) in the unit of the file, D = 2 where every vertex has two numbers
    shared : keys of the first frame, with what it inherits
    frames : T objects, each with its own keys only
    unit : `frame_unit`, "unit" where none is said
    flat : (N, 2) crease pattern, where the key frame is one and the others are not, or None
    notes : what a reader should know
    """

    positions: Floats
    shared: Mapping[str, Any]
    frames: tuple[Mapping[str, Any], ...]
    unit: str
    flat: Floats | None
    notes: tuple[str, ...]


def parse(path: Path) -> dict[str, Any]:
    """Return the JSON object of a file.

    Raises
    ------
    UnreadableFile
        When it is missing, empty, no text in UTF-8, or no JSON object without NaN and infinity.
    UnsafeFile
        When it is larger than `MAX_BYTES`.
    """
    safety.check_readable(path)
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise UnsafeFile(
            f"{size:,} bytes of JSON",
            expected=f"at most {MAX_BYTES:,} bytes",
            fix="thin the animation out",
            file=path,
        )
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise _unreadable(path, f"byte {error.start} is not UTF-8") from None
    except json.JSONDecodeError as error:
        raise _unreadable(
            path, f"invalid JSON at line {error.lineno}, column {error.colno}: {error.msg}"
        ) from None
    except (RecursionError, ValueError) as error:
        raise _unreadable(path, f"JSON that cannot be read: {error}") from None
    if not isinstance(data, dict):
        raise _unreadable(path, f"a JSON {type(data).__name__}")
    return data


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name}, which JSON does not have")


def _unreadable(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        found, expected="one JSON object", fix="export or copy the file again", file=path
    )


def read(path: Path) -> FoldRun:
    """Read an animation.

    Raises
    ------
    UnreadableFile, UnsafeFile
        See `parse`.
    NotATrajectory
        When the file holds a single state.
    MissingData
        When a frame has no coordinates, or not those of all vertices.
    SchemaError
        When frames inherit in a circle, change the mesh or the unit, or numbers are none.
    """
    data = parse(path)
    frames = _frame_list(data, path)
    resolved = _resolved(data, frames, path)
    own = [data, *frames]
    notes: list[str] = []
    chosen = list(range(len(own)))
    flat: Floats | None = None
    if "vertices_coords" not in data:
        chosen = chosen[1:]
    elif _is_pattern(data) and len(own) > 2 and not any(map(_is_pattern, resolved[1:])):
        chosen = chosen[1:]
        flat = _coordinates(data["vertices_coords"], path, 0)
        notes.append(
            "the key frame is the crease pattern: it is no instant of the run, and the lengths of "
            "its edges are the rest lengths"
        )
    if len(chosen) < 2:
        raise NotATrajectory(
            f"a single state ({len(chosen)} frame with coordinates)",
            expected=_WANTED,
            fix="a body without a motion is read by openprc.demlat.meshing (read_fold), to be "
            "simulated",
            file=path,
            key="file_frames",
        )
    first = resolved[chosen[0]]
    tables = []
    for number in chosen:
        _check_mesh(own[number], first, number, path)
        if "vertices_coords" not in own[number]:
            raise MissingData(
                f"frame {number} has no coordinates of its own",
                expected="vertices_coords in every frame",
                fix="export the animation with coordinates; fold angles alone give no positions",
                file=path,
                key=f"file_frames/{number - 1}/vertices_coords",
            )
        tables.append(_coordinates(own[number]["vertices_coords"], path, number))
        if len(tables[-1]) != len(tables[0]):
            raise MissingData(
                f"frame {number} has {len(tables[-1])} vertices, the first {len(tables[0])}",
                expected="the same vertices in every frame",
                fix="export the animation without remeshing",
                file=path,
                key="vertices_coords",
            )
    dims = {table.shape[1] for table in tables}
    if len(dims) > 1:
        notes.append("vertices of two numbers have z = 0, as others have three")
    positions = np.zeros((len(tables), len(tables[0]), max(dims)))
    for row, table in enumerate(tables):
        positions[row, :, : table.shape[1]] = table
    if flat is not None and len(flat) != len(tables[0]):
        flat = None
        notes[0] = "the key frame has other vertices, and is left out"
    return FoldRun(
        positions=positions,
        shared=first if any(key in first for key in TOPOLOGY) else resolved[0],
        frames=tuple(own[number] for number in chosen),
        unit=_unit([resolved[number] for number in chosen], path),
        flat=flat,
        notes=tuple(notes),
    )


def _frame_list(data: Mapping[str, Any], path: Path) -> list[dict[str, Any]]:
    frames = data.get("file_frames", [])
    if not isinstance(frames, list) or not all(isinstance(item, dict) for item in frames):
        raise _wrong(path, "file_frames", "no list of objects", "one object a frame")
    if len(frames) > MAX_FRAMES:
        raise _wrong(path, "file_frames", f"{len(frames)} frames", f"at most {MAX_FRAMES}")
    return frames


def _wrong(path: Path, key: str, found: str, expected: str) -> SchemaError:
    return SchemaError(
        found, expected=expected, fix="correct the program that wrote it", file=path, key=key
    )


def _resolved(
    data: dict[str, Any], frames: list[dict[str, Any]], path: Path
) -> list[dict[str, Any]]:
    """Return every frame with what it inherits; frame 0 is the file itself."""
    found: dict[int, dict[str, Any]] = {0: data}
    for number in range(1, len(frames) + 1):
        chain = [number]
        seen = {number}
        # Long chains of parents are walked once: what they end at is known by then.
        while chain[-1] not in found and (parent := _parent(chain[-1], frames, path)) is not None:
            if parent in seen:
                raise _wrong(
                    path,
                    f"file_frames/{number - 1}/frame_parent",
                    f"frame {number} inherits from itself",
                    "parents that end at frame 0",
                )
            chain.append(parent)
            seen.add(parent)
        inherited: dict[str, Any] = {}
        for item in reversed(chain):
            if item not in found:
                found[item] = {**inherited, **frames[item - 1]}
            inherited = found[item]
    return [found[number] for number in range(len(frames) + 1)]


def _parent(number: int, frames: list[dict[str, Any]], path: Path) -> int | None:
    """Return the frame that a frame inherits from, None where it inherits nothing."""
    here = frames[number - 1]
    if here.get("frame_inherit", False) is not True:
        return None
    parent = here.get("frame_parent", 0)
    if type(parent) is not int or not 0 <= parent <= len(frames):
        raise _wrong(
            path,
            f"file_frames/{number - 1}/frame_parent",
            f"the parent {parent!r}",
            f"a frame from 0 to {len(frames)}",
        )
    return parent


def _is_pattern(frame: Mapping[str, Any]) -> bool:
    classes = frame.get("frame_classes", [])
    return isinstance(classes, list) and "creasePattern" in classes


def _check_mesh(
    frame: Mapping[str, Any], first: Mapping[str, Any], number: int, path: Path
) -> None:
    for key in TOPOLOGY:
        if key in frame and frame[key] is not first.get(key) and frame[key] != first.get(key):
            raise _wrong(
                path,
                f"file_frames/{number - 1}/{key}",
                f"the mesh of frame {number} is another one",
                "the same edges and faces in every frame",
            )


def _coordinates(rows: Any, path: Path, number: int) -> Floats:
    """Return (N, 2) or (N, 3); a vertex of two numbers among others of three has z = 0."""
    key = "vertices_coords" if number == 0 else f"file_frames/{number - 1}/vertices_coords"
    if not isinstance(rows, list) or not rows:
        raise _wrong(path, key, "no list of coordinates", "[x, y] or [x, y, z] for every vertex")
    for vertex, row in enumerate(rows):
        if not isinstance(row, list) or len(row) not in (2, 3) or not all(map(_is_number, row)):
            raise _wrong(
                path, f"{key}/{vertex}", f"found {str(row)[:60]}", "two or three finite numbers"
            )
    table = np.zeros((len(rows), max(map(len, rows))))
    if len(set(map(len, rows))) == 1:
        table[:] = rows
    else:
        for vertex, row in enumerate(rows):
            table[vertex, : len(row)] = row
    return table


def _is_number(value: Any) -> bool:
    try:
        return (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and (abs(float(value)) < math.inf)
        )
    except OverflowError:
        return False


def _unit(frames: list[dict[str, Any]], path: Path) -> str:
    """Return the one unit that frames name; those that name none share it."""
    units: set[str] = {frame["frame_unit"] for frame in frames if _says_unit(frame)} or {"unit"}
    if len(units) > 1:
        names = ", ".join(sorted(units))
        raise _wrong(path, "frame_unit", f"several units: {names}", "one")
    return units.pop()


def _says_unit(frame: Mapping[str, Any]) -> bool:
    return isinstance(frame.get("frame_unit"), str)
