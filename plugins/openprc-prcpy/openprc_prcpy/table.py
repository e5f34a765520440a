"""One text file of an experiment: a header and columns of numbers."""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc.schema import UNITS, safety

_DELIMITERS = ("\t", ";", ",")
_SPELLED = {"\t": "tab", " ": "space", ",": "','", ";": "';'"}
_UNIT = re.compile(r"(?P<name>.+?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*\Z")


@dataclass(frozen=True)
class Head:
    """Column names, what separates them, and the line at which the numbers begin."""

    names: tuple[str, ...]
    delimiter: str
    first_line: int


def column_unit(name: str) -> str | None:
    """Return the unit of a header such as ``Voltage (mV)``, None without one of the list."""
    found = _UNIT.match(name)
    return found["unit"] if found and found["unit"] in UNITS else None


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without quotes and blanks around them."""
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a cell of more than 128 kB: no table
        return []


def parse_head(lines: Sequence[str], delimiter: str | None) -> Head | None:
    """Find the header, the first line that is neither empty nor a comment; None without one.

    A `delimiter` that is not given is the one that divides the header and the line after it
    into equally many cells.
    """
    for place, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        after = next((text for text in lines[place + 1 :] if text.strip()), "")
        used = delimiter or _sniff_delimiter(line, after)
        names = split_cells(line, used)
        if any(_is_number(name) for name in names) or not any(names):
            return None
        return Head(tuple(names), used, place + 1)
    return None


def _sniff_delimiter(header: str, row: str) -> str:
    for delimiter in _DELIMITERS:
        if delimiter in header and header.count(delimiter) == row.count(delimiter):
            return delimiter
    best = max(_DELIMITERS, key=header.count)
    return best if best in header else " "


def choose_columns(
    head: Head, *, xs: str | None, readouts: str | None, path: Path
) -> tuple[str, str]:
    """Return the names of the sweep axis and of what was measured.

    Raises
    ------
    MissingData
        A name is not in the header, or stands there twice.
    ConfigError
        They are not named, and the table has more than two columns.
    """
    for key, name in (("Xs", xs), ("Readouts", readouts)):
        if name is None:
            continue
        if head.names.count(name) == 1:
            continue
        near = difflib.get_close_matches(name, head.names, n=1)
        twice = name in head.names
        raise MissingData(
            f"there are two columns {name!r}" if twice else f"there is no column {name!r}",
            expected="one of " + ", ".join(head.names),
            fix=f"did you mean {near[0]!r}?"
            if near and not twice
            else f"correct {key}, or the "
            f"delimiter (here {_SPELLED.get(head.delimiter, repr(head.delimiter))})",
            file=path,
            key=key,
        )
    if xs is None or readouts is None:
        others = [name for name in head.names if name not in (xs, readouts)]
        if len(others) != (xs is None) + (readouts is None):
            raise ConfigError(
                f"the columns are {', '.join(head.names)}",
                expected="the names of the sweep axis (Xs) and of what was measured (Readouts)",
                fix="give both; they are only guessed where a file has two columns",
                file=path,
                key="Xs" if xs is None else "Readouts",
            )
        if xs is None:
            xs = others.pop(0)
        if readouts is None:
            readouts = others.pop(0)
    if xs == readouts:
        raise ConfigError(
            f"Xs and Readouts are both {xs!r}",
            expected="two columns",
            fix="correct one of them",
            file=path,
            key="Readouts",
        )
    return xs, readouts


@dataclass(frozen=True)
class Sweep:
    """One file: ``xs`` (S,), the axis, and ``values`` (S,), what was measured."""

    path: Path
    xs_name: str
    readouts_name: str
    delimiter: str
    xs: NDArray[np.float64]
    values: NDArray[np.float64]


def read_sweep(path: Path, *, xs: str | None, readouts: str | None, delimiter: str | None) -> Sweep:
    """Read two columns of a file.

    Raises
    ------
    UnreadableFile
        The file is no table, or a cell of the columns is no finite number; line and column are
        named.
    MissingData, ConfigError
        As `choose_columns`.
    """
    lines = _lines(safety.check_readable(path))
    head = parse_head(lines, delimiter)
    if head is None:
        raise UnreadableFile(
            "no header line was found",
            expected="column names such as Frequency,Spectra above the numbers",
            fix="add a first line that names the columns",
            file=path,
        )
    names = choose_columns(head, xs=xs, readouts=readouts, path=path)
    places = [head.names.index(name) for name in names]
    body = lines[head.first_line :]
    if not any(line.strip() for line in body):
        raise UnreadableFile(
            "there is a header but no row of numbers",
            expected="one row for each sample",
            fix="check that the measurement ran to its end",
            file=path,
        )
    try:
        table = np.loadtxt(
            body,
            delimiter=None if head.delimiter == " " else head.delimiter,
            usecols=places,
            comments=None,
            quotechar='"',
            ndmin=2,
        )
    except ValueError:
        table = None
    if table is None or not np.isfinite(table).all():
        raise _bad_cell(body, head, places, path)
    return Sweep(path, *names, head.delimiter, table[:, 0].copy(), table[:, 1].copy())


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFile(
            f"byte {error.start} is not UTF-8 text",
            expected="a text file",
            fix="save it as UTF-8, or move it out of the folder if it is no scan",
            file=path,
        ) from None
    if "\0" in text:
        raise UnreadableFile(
            "it contains zero bytes, so it is binary",
            expected="a text file",
            fix="move it out of the folder if it is no scan",
            file=path,
        )
    return text.splitlines()


def _bad_cell(body: Sequence[str], head: Head, places: Sequence[int], path: Path) -> UnreadableFile:
    """Return the error of the first cell that is no finite number."""
    for number, line in enumerate(body, start=head.first_line + 1):
        if not line.strip():
            continue
        cells = split_cells(line, head.delimiter)
        for place in places:
            cell = cells[place] if place < len(cells) else None
            if cell is not None and _is_number(cell) and np.isfinite(float(cell)):
                continue
            comma = cell is not None and re.fullmatch(r"[+-]?\d+,\d+([eE][+-]?\d+)?", cell)
            return UnreadableFile(
                "the row ends before this column" if cell is None
                else f"{cell!r} is not a finite number" + (" (decimal comma)" if comma else ""),
                expected="a number in every row; a measurement with gaps is no state",
                fix="export with decimal points" if comma
                else "repeat the scan, or leave it out and say gaps=close",
                file=path,
                key=f"line {number}, column {head.names[place]!r}",
            )  # fmt: skip
    return UnreadableFile(
        "the numbers could not be read",
        expected=f"cells separated by {_SPELLED.get(head.delimiter, repr(head.delimiter))}",
        fix="check the file, or give the delimiter",
        file=path,
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell
