"""The container of ``startStateLogging``: two header lines, then packed binary records.

Line 1 names the columns, line 2 gives one letter for each (``I`` u32, ``i`` i32, ``f`` f32,
``B`` u8). Every record is the mark ``AA BB`` and the fields, little endian, without padding.
The mark also occurs inside the fields, so records are found by their length and never by
looking for the mark. PyBullet writes a bare mark, without fields, for a body whose values do
not fill the columns; and a process that was stopped leaves the last record unfinished.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema import safety

MARK = b"\xaa\xbb"
_MARK_VALUE = int.from_bytes(MARK, "little")
_LETTERS = {"I": "<u4", "i": "<i4", "f": "<f4", "B": "u1"}
#: Longer first lines are not headers: 40 joints with torques need about 600 characters.
MAX_HEADER = 1 << 16

Family = Literal["robot", "contacts", "minitaur", "vr", "unknown"]

#: Columns that tell PyBullet's loggers apart.
_ROBOT = (
    "stepCount", "timeStamp", "objectId", "posX", "posY", "posZ", "oriX", "oriY", "oriZ", "oriW",
    "velX", "velY", "velZ", "omegaX", "omegaY", "omegaZ", "qNum",
)  # fmt: skip
_CONTACTS = (
    "stepCount", "timeStamp", "bodyUniqueIdA", "bodyUniqueIdB",
    "contactNormalOnBX", "contactNormalOnBY", "contactNormalOnBZ", "normalForce",
)  # fmt: skip
_MINITAUR = ("t", "r", "p", "y", *(f"q{i}" for i in range(8)), *(f"u{i}" for i in range(8)))


@dataclass(frozen=True, slots=True)
class LogHeader:
    """The two header lines: column names, their letters, and where the records begin."""

    names: tuple[str, ...]
    letters: str
    offset: int

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Packed record; the mark in front of the fields is called ``@mark``."""
        fields = zip(self.names, self.letters, strict=True)
        return np.dtype([("@mark", "<u2"), *((name, _LETTERS[code]) for name, code in fields)])

    @property
    def family(self) -> Family:
        """Which of PyBullet's loggers wrote it, judged by the column names alone."""
        present = set(self.names)
        if present.issuperset(_ROBOT):
            return "robot"
        if present.issuperset(_CONTACTS):
            return "contacts"
        if present.issuperset(_MINITAUR):
            return "minitaur"
        if present.issuperset(("stepCount", "timeStamp", "controllerId")):
            return "vr"
        return "unknown"

    @property
    def counts_first(self) -> bool:
        """Whether the first column is an integer counter, which settles doubtful marks."""
        return self.letters[0] in "Ii" and self.names[0] in ("stepCount", "t")


@dataclass(frozen=True, slots=True)
class StateLog:
    """A state log in memory.

    Parameters
    ----------
    header : LogHeader
    records : (R,) structured array
        Complete records in file order.
    bare_after : (B,) int
        For every bare mark, how many complete records stand before it.
    cut_bytes : int
        Bytes of an unfinished record at the end of the file.
    """

    header: LogHeader
    records: NDArray[np.void]
    bare_after: NDArray[np.int64]
    cut_bytes: int


def peek_header(path: Path) -> LogHeader | None:
    """Return the header of a state log, or None when `path` does not begin like one."""
    with path.open("rb") as stream:
        head = stream.read(2 * MAX_HEADER)
    try:
        return _parse_header(head, path)
    except UnreadableFile:
        return None


def looks_like_log(path: Path) -> bool:
    """Tell whether `path` means to be a state log, even if its header is damaged."""
    with path.open("rb") as stream:
        head = stream.read(2 * MAX_HEADER)
    first, _, rest = head.partition(b"\n")
    second = rest.partition(b"\n")[0].strip()
    letters = second.isalpha() and b"," in first and first.isascii()
    return letters or first.startswith(b"stepCount,timeStamp")


def begins_with_record(path: Path, header: LogHeader) -> bool:
    """Tell whether a mark, or nothing at all, follows the header."""
    with path.open("rb") as stream:
        stream.seek(header.offset)
        start = stream.read(2)
    return start in (MARK, b"")


def read_state_log(path: Path) -> StateLog:
    """Read a state log.

    Raises
    ------
    UnreadableFile
        When the header is not one, the records do not have the length that it announces, the
        step counter runs backwards, or there is no record at all.
    """
    path = safety.check_readable(path)
    raw = path.read_bytes()
    header = _parse_header(raw[: 2 * MAX_HEADER], path)
    body = raw[header.offset :]
    if not body:
        raise UnreadableFile(
            "the log has a header and no records",
            expected="records of at least one step",
            fix="call stepSimulation between startStateLogging and stopStateLogging, and name "
            "objectUniqueIds that exist",
            file=path,
        )
    return _split(body, header, path)


def _parse_header(head: bytes, path: Path) -> LogHeader:
    lines = head.split(b"\n", 2)
    if len(lines) < 3:
        raise _not_a_log(path, "it does not begin with two lines of text")
    try:
        first, second = (line.decode("ascii").rstrip("\r") for line in lines[:2])
    except UnicodeDecodeError:
        raise _not_a_log(path, "its first two lines are not plain text") from None
    names = tuple(name.strip() for name in first.split(","))
    letters = second.strip()
    if not letters or not letters.isalpha() or not all(names):
        raise _not_a_log(path, "its first two lines are not column names and type letters")
    strange = sorted(set(letters) - set(_LETTERS))
    if strange:
        column = names[min(letters.index(strange[0]), len(names) - 1)]
        raise UnreadableFile(
            f"the header gives column {column!r} the unknown type letter {strange[0]!r}",
            expected="one of " + " ".join(_LETTERS) + " for every column",
            fix="the file is not a PyBullet state log or its header is damaged; record it again",
            file=path,
        )
    if len(names) != len(letters):
        raise UnreadableFile(
            f"the header names {len(names)} columns and gives {len(letters)} type letters",
            expected="one letter for each name",
            fix="the header is damaged; record or copy the log again",
            file=path,
        )
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise UnreadableFile(
            f"the header names {', '.join(twice)} twice",
            expected="different column names",
            fix="the header is damaged; record or copy the log again",
            file=path,
        )
    return LogHeader(names, letters, len(lines[0]) + len(lines[1]) + 2)


def _not_a_log(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        f"this is not a PyBullet state log: {found}",
        expected="a line of column names, a line of type letters, then records",
        fix="name a file written by startStateLogging",
        file=path,
    )


def _split(body: bytes, header: LogHeader, path: Path) -> StateLog:
    dtype = header.dtype
    bare: list[int] = []
    records = _regular(body, header)
    if records is None:
        starts, bare, end = _walk(body, header)
        taken = b"".join(body[at : at + dtype.itemsize] for at in starts)
        records = np.frombuffer(taken, dtype=dtype)
    else:
        end = records.size * dtype.itemsize
    _check_rest(body, end, records.size + len(bare), dtype, path)
    if not records.size and not bare:
        raise UnreadableFile(
            f"the log has a header and {len(body)} bytes of an unfinished record",
            expected=f"at least one record of {dtype.itemsize} bytes",
            fix="record again and stop the log properly",
            file=path,
        )
    _check_counter(records, header, path)
    return StateLog(header, records, np.asarray(bare, dtype=np.int64), len(body) - end)


def _regular(body: bytes, header: LogHeader) -> NDArray[np.void] | None:
    """Return the records when all are complete and none is in doubt, else None."""
    size = header.dtype.itemsize
    count = len(body) // size
    rest = body[count * size :]
    if not count or rest[:2] != MARK[: len(rest)]:
        return None
    records = np.frombuffer(body, dtype=header.dtype, count=count)
    if np.any(records["@mark"] != _MARK_VALUE):
        return None
    octets = np.frombuffer(body, dtype=np.uint8, count=count * size).reshape(count, size)
    if np.any((octets[:, 2] == MARK[0]) & (octets[:, 3] == MARK[1])):
        return None
    return records


def _walk(body: bytes, header: LogHeader) -> tuple[list[int], list[int], int]:
    """Step from mark to mark; a bare mark is one that another mark follows at once.

    Both readings can fit when the counter's low half reads 48042, whose bytes are ``AA BB``:
    then the one that continues the count is taken.
    """
    size = header.dtype.itemsize
    starts: list[int] = []
    bare: list[int] = []
    last = 0
    at, total = 0, len(body)
    while at < total and body[at : at + 2] == MARK:
        if at + 2 == total:
            # A mark at the very end is bare when the log has others, else the beginning of a
            # record that was never finished.
            if bare:
                bare.append(len(starts))
                at = total
            break
        full = _mark_or_end(body, at + size)
        cut = at + size > total
        empty = body[at + 2 : at + 4] == MARK and (
            at + 4 == total
            or body[at + 4 : at + 6] == MARK
            or at + 2 + size > total
            or _mark_or_end(body, at + 2 + size)
        )
        if empty and (full or cut) and header.counts_first:
            empty = not _gap(body, at + 2, last) < _gap(body, at + 4, last)
        elif full:
            empty = False
        if empty:
            bare.append(len(starts))
            at += 2
        elif full:
            starts.append(at)
            if header.counts_first:
                last = int.from_bytes(body[at + 2 : at + 6], "little")
            at += size
        else:
            break
    return starts, bare, at


def _mark_or_end(body: bytes, at: int) -> bool:
    follows = body[at : at + 2]
    return at <= len(body) and follows == MARK[: len(follows)]


def _gap(body: bytes, at: int, last: int) -> float:
    """How far the counter at `at` lies ahead of `last`; infinite when it cannot be one."""
    octets = body[at : at + 4]
    count = int.from_bytes(octets, "little")
    return count - last if len(octets) == 4 and last <= count < 1 << 31 else float("inf")


def _check_rest(body: bytes, end: int, found: int, dtype: np.dtype[np.void], path: Path) -> None:
    rest = body[end:]
    if rest[:2] == MARK[: len(rest)] and len(rest) < dtype.itemsize:
        return
    marks = [at for at in range(min(len(rest), 8192)) if rest[at : at + 2] == MARK]
    seen = f"; the next mark is {marks[1]} bytes on" if len(marks) > 1 and marks[0] == 0 else ""
    if found == 0:
        raise UnreadableFile(
            f"the header announces records of {dtype.itemsize} bytes and the data are laid out "
            f"differently{seen}",
            expected="the mark AA BB at the start of every record",
            fix="the header and the data do not belong together; record or copy the log again",
            file=path,
        )
    raise UnreadableFile(
        f"after record {found} there is no record of {dtype.itemsize} bytes at byte {end} "
        f"of the data{seen}",
        expected="the mark AA BB at the start of every record",
        fix="the file is damaged in the middle; copy or record it again",
        file=path,
    )


def _check_counter(records: NDArray[np.void], header: LogHeader, path: Path) -> None:
    if not header.counts_first or records.size < 2:
        return
    name = header.names[0]
    count = records[name].astype(np.int64)
    back = np.flatnonzero(np.diff(count) < 0)
    if back.size:
        row = int(back[0]) + 1
        raise UnreadableFile(
            f"{name} runs backwards at record {row}: {count[row]} after {count[row - 1]}",
            expected="a counter that never decreases",
            fix="two logs in one file, or a damaged one: give each log a file of its own",
            file=path,
            key=name,
        )
