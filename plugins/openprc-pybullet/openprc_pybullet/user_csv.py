"""CSV files of poses: ``t,x,y,z,qx,qy,qz,qw``, one body or several.

Several bodies stand side by side (``cube_x,cube_y,...`` or ``x0,y0,...``) or below each other
with a column ``body``.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, NotATrajectory, SchemaError, UnreadableFile
from openprc_pybullet.user_run import TIME_KEYS, TIME_KEYS_MS

_BODY_KEYS = (
    "body", "body_id", "bodyid", "bodyuniqueid", "object", "objectid", "object_id", "id",
    "objectuniqueid", "uniqueid", "unique_id", "uid",
)  # fmt: skip
_CELL = re.compile(
    r"(?P<prefix>.*?[ _.:/\-]|.*?\d|)(?P<kind>p|pos|q|ori|orn|quat|v|vel|)_?(?P<axis>[xyzw])"
    r"[ _.\-]?(?P<number>\d*)",
    re.IGNORECASE,
)
_KINDS = {"": "p", "p": "p", "pos": "p", "q": "q", "ori": "q", "orn": "q", "quat": "q"}
_KINDS |= {"v": "v", "vel": "v"}


@dataclass(frozen=True, slots=True)
class CsvHeader:
    """Column names of a CSV file, how it is split, and the line of its first row."""

    names: tuple[str, ...]
    delimiter: str
    remark: str
    first_line: int

    @property
    def time(self) -> str | None:
        """The time column, if one has a usual name."""
        lower = {name.lower(): name for name in self.names}
        return next((lower[key] for key in (*TIME_KEYS, *TIME_KEYS_MS) if key in lower), None)

    @property
    def body(self) -> str | None:
        """The column that names the body of each row, if there is one."""
        lower = {name.lower(): name for name in self.names}
        return next((lower[key] for key in _BODY_KEYS if key in lower), None)

    def groups(self, kind: str) -> dict[str, list[str]]:
        """Return, for each body, its columns of a kind: p (xyz), q (xyzw) or v (xyz).

        Only complete sets count.
        """
        axes = "xyzw" if kind == "q" else "xyz"
        found: dict[str, dict[str, str]] = {}
        for name in self.names:
            if name in (self.time, self.body):
                continue
            cell = _CELL.fullmatch(name)
            if cell and _KINDS[cell["kind"].lower()] == kind:
                label = cell["prefix"].rstrip(" _.:/-") + cell["number"]
                found.setdefault(label, {})[cell["axis"].lower()] = name
        return {
            label: [columns[axis] for axis in axes]
            for label, columns in found.items()
            if set(columns) == set(axes)
        }


def peek_header(path: Path) -> CsvHeader | None:
    """Return the header of a CSV file, or None when the first line is not one."""
    with path.open("rb") as stream:
        head = stream.read(1 << 16)
    if b"\0" in head or not head:
        return None
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    lines = text.splitlines()
    names: tuple[str, ...] = ()
    for number, line in enumerate(lines):
        commented = line.lstrip().startswith("#")
        plain = line.lstrip().lstrip("#").strip()
        remark = re.search(r"\(([^)]*)\)\s*\Z", plain)
        plain = re.sub(r"\s*\([^)]*\)\s*\Z", "", plain)
        delimiter = next((mark for mark in ",;\t" if mark in plain), None)
        if delimiter is None:
            if commented or not plain:
                continue
            return None
        names = tuple(name.strip().strip('"') for name in plain.split(delimiter))
        if any(re.fullmatch(r"[-+0-9.eE]+", name) or not name for name in names):
            return None
        return CsvHeader(names, delimiter, remark[1] if remark else "", number + 1)
    return None


@dataclass(frozen=True, slots=True)
class CsvPoses:
    """Named arrays from a CSV file, node labels, and half the last digit of the time."""

    arrays: dict[str, NDArray[np.generic]]
    labels: tuple[str, ...] | None
    half_digit: float | None


def read_poses(path: Path, *, time_key: str | None, without_time: bool) -> CsvPoses:
    """Read a CSV file of poses.

    Parameters
    ----------
    time_key : str, optional
        Name of the time column when it is not a usual one.
    without_time : bool
        Rows are frames of a clock that the caller knows.

    Raises
    ------
    UnreadableFile
        When there is no header, or a row is short or holds something that is no number.
    NotATrajectory
        When the rows are bodies and not instants, or there are no columns x, y, z.
    MissingData
        When there is no time.
    """
    header = peek_header(path)
    if header is None:
        raise UnreadableFile(
            "the first line does not name columns",
            expected="a header such as t,x,y,z,qx,qy,qz,qw",
            fix="write one",
            file=path,
        )
    time = time_key if time_key in header.names else header.time
    if time is None and (not without_time or "row" in header.remark.lower()):
        if "body" in header.remark.lower():
            raise NotATrajectory(
                f"the rows are bodies, not instants ({header.remark}), and no column tells the "
                "time: one snapshot",
                expected="poses over time",
                fix="save the poses of every step, with the time in a column t",
                file=path,
            )
        raise MissingData(
            f"no column tells the time; the columns are {', '.join(header.names)}",
            expected="a column t or time, or dt for rows that are frames",
            fix="say time_key=COLUMN, or dt=SECONDS if every row is a frame",
            file=path,
        )
    groups = header.groups("p")
    if not groups:
        raise NotATrajectory(
            f"no columns x, y, z; the columns are {', '.join(header.names)}",
            expected="t,x,y,z and more, for every body",
            fix="rename the columns, or use the importer for general tables",
            file=path,
        )
    table, digits = _numbers(path, header, time)
    half = None if digits is None else 0.5000001 * 10.0**-digits
    if header.body is not None and len(groups) == 1 and "" in groups:
        return _stacked(header, table, time, half, path)
    return _side_by_side(header, table, time, half)


def _numbers(
    path: Path, header: CsvHeader, time: str | None
) -> tuple[dict[str, NDArray[np.float64]], int | None]:
    """Return the columns, and with how many decimals the time is printed."""
    text = path.read_text(encoding="utf-8-sig")
    body = io.StringIO(text)
    for _ in range(header.first_line):
        body.readline()
    rows: list[list[float]] = []
    digits = 0
    place = None if time is None else header.names.index(time)
    for number, cells in enumerate(csv.reader(body, delimiter=header.delimiter)):
        line = header.first_line + number + 1
        if not cells or cells[0].lstrip().startswith("#"):
            continue
        if len(cells) != len(header.names):
            raise UnreadableFile(
                f"line {line} has {len(cells)} cells, the header has {len(header.names)}",
                expected="one cell a column",
                fix="the file may be cut off; copy or write it again",
                file=path,
                key=f"line {line}",
            )
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError as error:
            raise UnreadableFile(
                str(error),
                expected="numbers only",
                fix="write numbers with a decimal point, and bodies as numbers",
                file=path,
                key=f"line {line}",
            ) from error
        if place is not None:
            digits = max(digits, _decimals(cells[place]))
    if not rows:
        raise UnreadableFile(
            "there are no rows below the header",
            expected="one row a frame",
            fix="write the file again",
            file=path,
        )
    table = np.asarray(rows, dtype=np.float64)
    columns = {name: table[:, i] for i, name in enumerate(header.names)}
    # Sixteen digits and more are the full number, not a rounded one.
    return columns, digits if place is not None and 0 < digits < 12 else None


def _decimals(cell: str) -> int:
    if "e" in cell.lower():
        return 99
    return len(cell.strip().partition(".")[2])


def _side_by_side(
    header: CsvHeader, table: dict[str, NDArray[np.float64]], time: str | None, half: float | None
) -> CsvPoses:
    arrays: dict[str, NDArray[np.generic]] = {}
    used: set[str] = set()
    if time is not None:
        arrays[time] = table[time]
        used.add(time)
    groups = header.groups("p")
    arrays["positions"] = np.stack([_take(table, names) for names in groups.values()], axis=1)
    used |= {name for names in groups.values() for name in names}
    speeds = header.groups("v")
    if set(speeds) == set(groups):
        arrays["velocities"] = np.stack([_take(table, speeds[label]) for label in groups], axis=1)
        used |= {name for names in speeds.values() for name in names}
    for label, names in header.groups("q").items():
        arrays[f"{label}.orientation" if label else "orientation"] = _take(table, names)
        used |= set(names)
    arrays |= {name: table[name] for name in header.names if name not in used}
    labels = tuple(groups) if all(groups) else None
    return CsvPoses(arrays, labels, half)


def _stacked(
    header: CsvHeader,
    table: dict[str, NDArray[np.float64]],
    time: str | None,
    half: float | None,
    path: Path,
) -> CsvPoses:
    if time is None:
        raise MissingData(
            "several bodies stand below each other and no column tells the time",
            expected="a column t or time",
            fix="write the time into every row",
            file=path,
        )
    bodies = np.unique(table[header.body or ""])
    times = np.unique(table[time])
    order = np.lexsort((table[header.body or ""], table[time]))
    shape = (times.size, bodies.size)
    complete = order.size == times.size * bodies.size and np.array_equal(
        table[header.body or ""][order].reshape(shape), np.tile(bodies, (times.size, 1))
    )
    if not complete:
        raise SchemaError(
            f"{order.size} rows for {times.size} instants and {bodies.size} bodies",
            expected="one row for each body at each instant",
            fix="write every body at every instant",
            file=path,
            key=header.body,
        )
    arrays: dict[str, NDArray[np.generic]] = {time: times}
    for key, kind in (("positions", "p"), ("velocities", "v")):
        names = header.groups(kind).get("")
        if names:
            arrays[key] = _take(table, names)[order].reshape(*shape, 3)
    names = header.groups("q").get("", [])
    for column, body in enumerate(bodies):
        if names:
            values = _take(table, names)[order].reshape(*shape, 4)
            arrays[f"body{body:g}.orientation"] = values[:, column]
    return CsvPoses(arrays, tuple(f"body{body:g}" for body in bodies), half)


def _take(table: dict[str, NDArray[np.float64]], names: list[str]) -> NDArray[np.float64]:
    return np.stack([table[name] for name in names], axis=1)
