"""A text file with a header and columns of numbers."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema import UNITS, safety

#: Cells that mean "not measured".
MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan"})
_DELIMITERS = ("\t", ";", ",")
_UNIT = re.compile(r"(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]\Z")
_UNIT_IN_PARENTHESES = re.compile(r"(?P<name>.+?)\s*\((?P<unit>[^()]*)\)\Z")


@dataclass(frozen=True)
class Column:
    """Name and unit of a column; the unit is None where the header has no ``[unit]``."""

    name: str
    unit: str | None

    @classmethod
    def parse(cls, cell: str) -> Column:
        """Read a header cell such as ``x0 [mm]``, or ``x0 (mm)`` if that is a known unit."""
        cell = cell.strip()
        found = _UNIT.match(cell)
        if found is None:
            found = _UNIT_IN_PARENTHESES.match(cell)
            if found is not None and found["unit"] not in UNITS:
                found = None
        return cls(found["name"], found["unit"]) if found else cls(cell, None)


@dataclass(frozen=True)
class Table:
    """Columns and their numbers.

    Parameters
    ----------
    columns : C columns
    values : (T, C)
        NaN where a cell says that nothing was measured.
    lines : (T,)
        Line of the file that each row stands on, counted from 1.
    """

    path: Path
    columns: tuple[Column, ...]
    values: NDArray[np.float64]
    lines: NDArray[np.int64]

    def fail(self, found: str, *, row: int, column: int, expected: str, fix: str) -> NoReturn:
        """Raise an error that names line and column."""
        raise _error(
            found,
            path=self.path,
            line=int(self.lines[row]),
            column=self.columns[column].name,
            expected=expected,
            fix=fix,
        )


@dataclass(frozen=True)
class Head:
    """The header of a file: its columns, the delimiter, and the line of the first numbers."""

    columns: tuple[Column, ...]
    delimiter: str
    first_line: int


def parse_head(lines: Iterator[tuple[int, str]]) -> Head | None:
    """Find the header in numbered lines, or return None.

    The header is the first line that is no comment. Programs that write the header as a
    comment (``numpy.savetxt`` does) are understood too: then numbers follow right after it.
    """
    comment = ""
    for number, line in lines:
        if not line.strip():
            continue
        if line.lstrip().startswith("#"):
            comment = line.lstrip().lstrip("#").strip()
            continue
        delimiter = max(_DELIMITERS, key=line.count)
        if not line.count(delimiter):
            return None
        cells = next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter))
        if not _is_number(cells[0]):
            return Head(tuple(Column.parse(cell) for cell in cells), delimiter, number + 1)
        names = next(csv.reader([comment], delimiter=delimiter), [])
        if len(names) == len(cells) and not _is_number(names[0]):
            return Head(tuple(Column.parse(cell) for cell in names), delimiter, number)
        return None
    return None


def read_table(path: Path) -> Table:
    """Read a whole file into memory.

    Raises
    ------
    UnreadableFile
        Missing, empty, not text, without a header or numbers, or with a cell that is neither
        a number nor a mark for a missing one; the message names line and column.
    """
    path = safety.check_readable(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFile(
            f"byte {error.start} is not UTF-8 text",
            expected="a text file",
            fix="save it as UTF-8 (a spreadsheet calls it 'CSV UTF-8')",
            file=path,
        ) from None
    if "\0" in text:
        raise UnreadableFile(
            "it contains zero bytes, so it is binary",
            expected="a text file",
            fix="export it as CSV",
            file=path,
        )
    lines = text.splitlines()
    head = parse_head(enumerate(lines, start=1))
    if head is None:
        raise UnreadableFile(
            "no header line was found",
            expected="column names such as t,x0,y0 separated by commas, semicolons or tabs",
            fix="add a first line that names the columns",
            file=path,
        )
    _check_names(head, path)
    rows: list[list[float]] = []
    numbers: list[int] = []
    body = lines[head.first_line - 1 :]
    reader = csv.reader(body, delimiter=head.delimiter)
    for cells in reader:
        # A quoted cell may span lines; the reader counts them.
        line = head.first_line - 1 + reader.line_num
        if not cells or not "".join(cells).strip() or cells[0].lstrip().startswith("#"):
            continue
        rows.append(_numbers(cells, head, path, line))
        numbers.append(line)
    if not rows:
        raise UnreadableFile(
            "there is a header but no row of numbers",
            expected="one row for each frame",
            fix="check that the program that wrote it ran to its end",
            file=path,
        )
    return Table(path, head.columns, np.array(rows), np.array(numbers, dtype=np.int64))


def _check_names(head: Head, path: Path) -> None:
    names = [column.name for column in head.columns]
    for position, name in enumerate(names):
        if not name or name in names[:position]:
            raise UnreadableFile(
                f"column {position + 1} is called {name!r}"
                + (", as is an earlier one" if name else ""),
                expected="a name of its own for every column",
                fix="correct the header line",
                file=path,
                key=f"line {head.first_line - 1}",
            )


def _numbers(cells: list[str], head: Head, path: Path, line: int) -> list[float]:
    if len(cells) != len(head.columns):
        raise UnreadableFile(
            f"{len(cells)} cells in a table of {len(head.columns)} columns",
            expected="as many cells as the header has names",
            fix="a last row that was cut off can be deleted",
            file=path,
            key=f"line {line}",
        )
    try:
        values = [math.nan if _is_missing(cell) else float(cell) for cell in cells]
    except ValueError:
        values = [math.inf if not (_is_missing(c) or _is_number(c)) else 0.0 for c in cells]
    for position, value in enumerate(values):
        if math.isinf(value):
            cell = cells[position].strip()
            comma = re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell)
            raise _error(
                f"{cell!r} is not a finite number" + (" (decimal comma)" if comma else ""),
                path=path,
                line=line,
                column=head.columns[position].name,
                expected="a number with a decimal point, or nothing where nothing was measured",
                fix="export with decimal points" if comma else "correct the cell",
            )
    return values


def _is_missing(cell: str) -> bool:
    return cell.strip().lower() in MISSING


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _error(
    found: str, *, path: Path, line: int, column: str, expected: str, fix: str
) -> UnreadableFile:
    return UnreadableFile(
        found, expected=expected, fix=fix, file=path, key=f"line {line}, column {column!r}"
    )
