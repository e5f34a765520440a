"""How sure one can be that a path is a PyElastica recording, without loading it."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from tokenize import TokenError

from openprc.errors import OpenPRCError
from openprc.schema import safety
from openprc_pyelastica import axes, chunks
from openprc_pyelastica.containers import ZIP_MAGIC
from openprc_pyelastica.grouping import Shape, group, split_key, unstack
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
        return 0.0
    return of_names(preview.globals, preview.strings)


def of_shapes(shapes: Mapping[str, Shape]) -> float:
    """Judge an archive by the names and shapes of its arrays."""
    if shapes.keys() >= SNAPSHOT:
        return SURE  # to be refused in words
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


def _is_signed(keys: Mapping[str, Shape] | frozenset[str]) -> bool:
    return any(key == mark or key.endswith((f"_{mark}", f"/{mark}")) or key.startswith(f"{mark}_")
               for key in keys for mark in SIGNATURE)  # fmt: skip
