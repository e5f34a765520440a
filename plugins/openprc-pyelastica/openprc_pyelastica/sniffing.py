"""How sure one can be that a path is a PyElastica recording, without loading it."""

from __future__ import annotations

import pickletools
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from tokenize import TokenError

from openprc.errors import OpenPRCError
from openprc.schema import safety
from openprc_pyelastica import axes, chunks
from openprc_pyelastica.containers import ZIP_MAGIC
from openprc_pyelastica.grouping import (
    Shape,
    coordinates,
    flat_time,
    group,
    split_key,
    unstack,
)
from openprc_pyelastica.quantities import SIGNATURE, SNAPSHOT

#: A part set of `ExportCallBack`, and objects of the simulator that have to be refused in words.
SURE = 0.9
#: Nothing here is certain: PyElastica has no format, only habits.
LIKELY = 0.85
FITS = 0.7
USUAL_NAMES = 0.6
PLAIN = 0.55
GENERIC = 0.4
HINT = 0.2

#: Keys that users of PyBullet take for positions as well.
EITHER = ("position",)
#: How much of a pickle is looked at for shapes.
PEEK_BYTES = 1 << 16


def score(path: Path) -> float:
    """Return the confidence for `path`, a file or a folder; never raises."""
    try:
        if path.is_dir():
            sets = chunks.in_folder(path)
            best = max((_score_file(parts.paths[0]) for parts in sets), default=0.0)
            return SURE if best >= FITS else 0.0
        return _score_file(path)
    except (
        OpenPRCError, OSError, ValueError, EOFError, MemoryError, TokenError, zlib.error,
        struct.error,
    ):  # fmt: skip
        return 0.0


def _score_file(path: Path) -> float:
    with path.open("rb") as stream:
        magic = stream.read(4)
    if magic == ZIP_MAGIC:
        headers = safety.npz_headers(path)
        return of_shapes({key: shape for key, (shape, _) in headers.items()})
    preview = safety.preview_pickle(path)
    if preview is None:
        return PLAIN if _was_cut_off(path) else 0.0
    sureness = of_names(preview.globals, preview.strings)
    if sureness not in (USUAL_NAMES, GENERIC):
        return sureness
    # Other programs use the same words; components first is PyElastica's own habit.
    layout = pickled_layout(path)
    if sureness == GENERIC:
        return PLAIN if layout == "3n" else GENERIC
    return FITS if layout == "3n" else PLAIN if layout == "n3" else sureness


def _was_cut_off(path: Path) -> bool:
    """Tell whether this is the beginning of a recording: to be refused in words."""
    with path.open("rb") as stream:
        head = stream.read(PEEK_BYTES)
    return head[:1] == b"\x80" and b"position" in head and b"time" in head


def of_shapes(shapes: Mapping[str, Shape]) -> float:
    """Judge an archive by the names and shapes of its arrays."""
    if shapes.keys() >= SNAPSHOT:
        return SURE  # to be refused in words
    shapes = {
        key: (max(shape),) if flat_time(shape) and split_key(key)[1] == "time" else shape
        for key, shape in shapes.items()
    }
    for key, (x, y, z) in coordinates(shapes).items():
        rest = {name: shape for name, shape in shapes.items() if name not in (x, y, z)}
        shapes = {**rest, key: (shapes[x][0], 3, shapes[x][1])}
    stacked = unstack(shapes)
    if stacked:
        shapes = {new: shapes[key][:1] + shapes[key][2:] for new, (key, _) in stacked.items()} | {
            key: shape for key, shape in shapes.items() if split_key(key)[1] == "time"
        }
    found = group(shapes)
    if not found.rods:
        return 0.0
    slots = next(iter(found.rods.values()))
    position = shapes[slots["position"]]
    signed = _is_signed(shapes)
    time = slots.get("time") or found.shared.get("time")
    if time is None:
        return USUAL_NAMES if signed and 3 in position[1:] else HINT
    if abs(shapes[time][0] - position[0]) > 1 if shapes[time] else True:
        return HINT
    if len(position) == 2:
        return GENERIC
    layout = axes.from_shape(position)
    if 3 not in position[1:]:
        return HINT
    if signed:
        return LIKELY if layout == "3n" else FITS
    if layout == "3n":
        key = slots["position"]
        return FITS if len(key) > 1 else PLAIN
    if layout is None and "step" not in shapes and slots["position"] in EITHER:
        return PLAIN  # three nodes: as good a guess as PyBullet's, so that the user is asked
    return GENERIC


def of_names(names: frozenset[str], strings: frozenset[str]) -> float:
    """Judge a pickle by the classes and the strings that it mentions."""
    if any(name.split(".")[0] == "elastica" for name in names):
        return SURE  # to be refused in words
    quantities = {split_key(text)[1] for text in strings}
    if "position" not in quantities:
        return 0.0
    signed = _is_signed(strings)
    if "time" not in quantities:
        return PLAIN if signed else HINT
    if signed:
        return LIKELY
    if "collections.defaultdict" in names:
        return FITS
    return USUAL_NAMES if {"time", "position"} <= strings else GENERIC


def pickled_layout(path: Path) -> axes.Layout | None:
    """Tell from the first arrays of a pickle which axis holds the components.

    The shapes are read off as tuples of numbers; nothing is loaded.
    """
    with path.open("rb") as stream:
        head = stream.read(PEEK_BYTES)
    numbers: list[int] = []
    # Two numbers may also be a table (T, 3), such as a centre of mass: three speak first.
    votes: dict[str, set[axes.Layout]] = {"TUPLE3": set(), "TUPLE2": set()}
    try:
        for opcode, argument, _ in pickletools.genops(head):
            if opcode.name.startswith("BININT"):
                numbers.append(int(argument))
            elif opcode.name in votes:
                shape = (1, *numbers[-2:])
                layout = axes.from_shape(shape) if len(shape) == 3 and min(shape) > 0 else None
                votes[opcode.name] |= {layout} if layout else set()
                numbers = []
            else:
                numbers = []
    except ValueError:
        pass  # the first bytes of a longer pickle end anywhere
    found = votes["TUPLE3"] or votes["TUPLE2"]
    return found.pop() if len(found) == 1 else None


def _is_signed(keys: Mapping[str, Shape] | frozenset[str]) -> bool:
    return any(key == mark or key.endswith((f"_{mark}", f"/{mark}")) or key.startswith(f"{mark}_")
               for key in keys for mark in SIGNATURE)  # fmt: skip
