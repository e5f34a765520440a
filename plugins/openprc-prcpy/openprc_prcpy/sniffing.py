"""How sure one can be that a folder is a PRCpy experiment, from three of its files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc_prcpy.file_names import natural_key, numbered_groups, parse_name
from openprc_prcpy.table import parse_head, split_cells

_SUFFIXES = (".txt", ".csv", ".dat", ".tsv")
_FEWEST = 3
_MOST_NAMES = 20_000
_BYTES = 1 << 16
_ROWS = 200
#: Tables of places in space belong to other readers.
_PLACES = ({"x", "y"}, {"x0", "y0"}, {"node"}, {"qx"}, {"vx"}, {"pos_x"}, {"x", "z"})


def score(path: Path) -> float:
    """Return 0.8, 0.7, 0.3 or 0.0.

    0.7 needs numbered text files of one header, in which one column is the same in every file
    and varies (the sweep axis, or time) and another one differs from file to file; 0.8
    besides that the names carry a value with a unit. 0.3 is for numbered text files of any
    content.
    """
    try:
        names = _names(path)
        groups = numbered_groups(names)
        if not groups:
            return 0.0
        prefix, members = max(groups.items(), key=lambda item: (len(item[1]), item[0]))
        if len(members) < _FEWEST:
            return 0.0
        members.sort(key=natural_key)
        probes = [members[0], members[len(members) // 2], members[-1]]
        tables = [_head(path / name) for name in probes]
    except OSError:
        return 0.0
    if not _alike(tables):
        return 0.3
    parsed = [parse_name(name, prefix) for name in probes]
    return 0.8 if all(item.unit for item in parsed) else 0.7


def _names(folder: Path) -> list[str]:
    found: list[str] = []
    if not folder.is_dir():
        return found
    with os.scandir(folder) as entries:
        for count, entry in enumerate(entries):
            if count >= _MOST_NAMES:
                break
            name = entry.name
            if name.lower().endswith(_SUFFIXES) and not name.startswith(".") and entry.is_file():
                found.append(name)
    return found


def _head(path: Path) -> tuple[tuple[str, ...], NDArray[np.float64]] | None:
    """Return the header and the first rows (R, C) of a table, None for anything else."""
    with path.open("rb") as stream:
        raw = stream.read(_BYTES)
    if b"\0" in raw:
        return None
    lines = raw.decode("utf-8-sig", errors="replace").splitlines()
    if len(raw) == _BYTES:
        lines.pop()  # cut off somewhere
    head = parse_head(lines, None)
    if head is None or len(head.names) < 2:
        return None
    rows = [line for line in lines[head.first_line : head.first_line + _ROWS] if line.strip()]
    cells = [split_cells(line, head.delimiter) for line in rows]
    try:
        values = np.array(cells, dtype=np.float64)
    except ValueError:
        return None
    if values.ndim != 2 or len(values) < 2 or values.shape[1] != len(head.names):
        return None
    return head.names, values


def _alike(tables: list[tuple[tuple[str, ...], NDArray[np.float64]] | None]) -> bool:
    first = tables[0]
    if first is None:
        return False
    names, values = first
    lower = {name.lower() for name in names}
    if any(places <= lower for places in _PLACES):
        return False
    shared = np.ptp(values, axis=0) > 0
    # Recordings of devices may carry the number of the device where others have their axis.
    still, numbered = ~shared, np.zeros(len(names), dtype=bool)
    differs = np.zeros(len(names), dtype=bool)
    for table in tables[1:]:
        if table is None or table[0] != names or table[1].shape != values.shape:
            return False
        same = (table[1] == values).all(axis=0)
        shared &= same
        moves = np.ptp(table[1], axis=0) > 0
        still &= ~moves
        numbered |= ~same & ~moves
        differs |= ~same & moves
    return bool((shared.any() or (still & numbered).any()) and differs.any())
