"""What drove the body: from a table beside the video, or from a marker in it."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc.schema import safety, units
from openprc.schema.derive import sample_held

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

#: Columns that say when, and the unit that they are in where they do not tell.
_CLOCKS = {"t": "s", "time": "s", "timestamp": "s", "t_s": "s", "time_s": "s", "t_ms": "ms",
           "time_ms": "ms"}  # fmt: skip
#: Steps of a clock that differ by less than this are even.
_EVEN = 1e-3
_BRACKET = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
NAME = "drive"


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Values of an input, and when they hold.

    Attributes
    ----------
    values : (K, C) [unit]
    columns : C names
    unit, quantity : str
    times : (K,) [s], optional
        When each value begins to hold, in the clock of the video. Without it there is one
        value a frame, or symbols of the length `hold`.
    hold : float [s], optional
        Duration of one symbol.
    start : float [s]
        When the first symbol begins.
    file : path, optional
    """

    values: NDArray[np.float64]
    columns: tuple[str, ...]
    unit: str = "1"
    quantity: str = "drive"
    times: NDArray[np.float64] | None = None
    hold: float | None = None
    start: float = 0.0
    file: Path | None = None

    @property
    def per_frame(self) -> bool:
        """Whether there is one value for each frame."""
        return self.times is None and self.hold is None

    def check_length(self, n_frames: int) -> None:
        """Refuse a table of one value a frame that has another number of rows.

        Raises
        ------
        ConfigError
        """
        if self.per_frame and len(self.values) != n_frames:
            raise ConfigError(
                f"the drive has {len(self.values)} values, the video {n_frames} frames",
                expected="one value a frame, a column time, or symbols of a known duration",
                fix="add a column t [s], or say how long a symbol lasts (drive_hold)",
                file=self.file,
                key="drive",
            )

    def cut(self, n_frames: int) -> Drive:
        """Return the drive of the first frames only: of a run that was interrupted."""
        return replace(self, values=self.values[:n_frames]) if self.per_frame else self

    def on_clock(
        self, instants: NDArray[np.float64], frames: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the value in force at each instant, (S, C).

        Parameters
        ----------
        instants : (S,) [s]
        frames : (T,) [s]
            Times of the frames, for a drive with one value each.

        Raises
        ------
        ConfigError
            When the drive does not cover the instants: nothing is extrapolated.
        """
        if self.hold is not None:
            try:
                return sample_held(self.values, instants, hold=self.hold, start=self.start)
            except ConfigError as error:
                raise self._uncovered(
                    instants, self.start + self.hold * len(self.values)
                ) from error
        times = frames if self.times is None else self.times
        slack = 1e-6 * float(np.median(np.diff(times))) if len(times) > 1 else 1e-9
        # The last value holds for as long as the one before did.
        end = times[-1] + (float(times[-1] - times[-2]) if len(times) > 1 else np.inf)
        if instants[0] < times[0] - slack or instants[-1] > end + slack:
            raise self._uncovered(instants, end)
        index = np.searchsorted(times, instants + slack, side="right") - 1
        held: NDArray[np.float64] = self.values[np.clip(index, 0, len(times) - 1)]
        return held

    def _uncovered(self, instants: NDArray[np.float64], end: float) -> ConfigError:
        start = self.start if self.times is None else float(self.times[0])
        return ConfigError(
            f"the drive covers {start:g} to {end:g} s, the video {instants[0]:g} to "
            f"{instants[-1]:g} s",
            expected="a drive that covers every frame; the first frame is at 0 s",
            fix="give the whole signal, shift it (drive_start), or correct drive_hold or fps",
            file=self.file,
            key="drive",
        )

    def declare(self, writer: TrajectoryWriter, *, targets: Sequence[str] = ()) -> None:
        """Announce the input, with its symbols where it is made of such."""
        symbols = {"sequence": self.values, "hold": self.hold, "start": self.start}
        writer.declare_input(
            NAME, self.columns, quantity=self.quantity, unit=self.unit, targets=targets,
            **(symbols if self.hold is not None else {}),
        )  # fmt: skip


def read_drive(
    path: str | Path,
    *,
    hold: float | None = None,
    start: float | None = None,
    unit: str | None = None,
    quantity: str = "drive",
) -> Drive:
    """Read a drive from CSV.

    A column ``t`` or ``time`` says from when on each row holds (``time [ms]`` is understood);
    evenly spaced rows are symbols. Without one there are symbols of the duration `hold`, or one
    row a frame. A header ``u [N]`` names the unit.

    Parameters
    ----------
    path : path-like
    hold : float [s], optional
        Duration of one symbol.
    start : float [s], optional
        When the first row begins, in the clock of the video: 0 is its first frame. Of a table
        with times, what these are shifted by.
    unit, quantity : str, optional
        Of the values.

    Raises
    ------
    UnreadableFile
        When the file is no table of finite numbers.
    ConfigError
        When the times do not increase, or options contradict the file.
    """
    path, header, table = _table(Path(path))
    clock = [i for i, name in enumerate(header) if _plain(name).lower() in _CLOCKS]
    names = [_plain(name) for name in header]
    found = {_bracket(name) for i, name in enumerate(header) if i not in clock} - {None}
    if unit is None and len(found) > 1:
        raise ConfigError(
            f"the columns have the units {', '.join(sorted(map(str, found)))}",
            expected="columns of one unit",
            fix="keep the columns of one unit, or say which it is (drive_unit)",
            file=path,
            key="drive",
        )
    symbol = unit or next(iter(found), None) or "1"
    units.unit(symbol, file=str(path), key="drive")
    values = np.delete(table, clock, axis=1)
    if not values.shape[1]:
        raise _no_table(path, "there is a column of times and none of values")
    columns = tuple(name for i, name in enumerate(names) if i not in clock)
    if not columns:
        columns = tuple(f"u{i}" if values.shape[1] > 1 else "u" for i in range(values.shape[1]))
    drive = Drive(values=values, columns=columns, unit=symbol, quantity=quantity, file=path)
    if hold is not None and not hold > 0:
        raise ConfigError(
            f"drive_hold is {hold:g}", expected="a duration above 0 s", fix="correct it",
            key="drive_hold",
        )  # fmt: skip
    if not clock:
        if hold is None and start is not None:
            raise ConfigError(
                f"the drive begins at {start:g} s and says nothing of how long a value holds",
                expected="drive_hold, or a column of times",
                fix="add one of them, or leave drive_start out: one value a frame",
                file=path,
                key="drive_start",
            )
        return replace(drive, hold=hold, start=start or 0.0)
    if hold is not None:
        raise ConfigError(
            f"the drive has a column {header[clock[0]]!r} and drive_hold is {hold:g} s",
            expected="one of them",
            fix="leave drive_hold out: the times say how long a value holds",
            file=path,
            key="drive_hold",
        )
    return _timed(drive, table[:, clock[0]], header[clock[0]], shift=start or 0.0)


def _timed(drive: Drive, column: NDArray[np.float64], name: str, *, shift: float) -> Drive:
    symbol = _bracket(name) or _CLOCKS[_plain(name).lower()]
    measured = units.unit(symbol, file=str(drive.file), key=name)
    if measured.dimension != "time":
        raise ConfigError(
            f"the column {name!r} is in {symbol}",
            expected="a unit of time: s, ms, us, min",
            fix="correct the header",
            file=drive.file,
            key="drive",
        )
    times = column * measured.si_factor + shift
    steps = np.diff(times)
    if not (steps > 0).all():
        row = int(np.flatnonzero(~(steps > 0))[0]) + 1
        raise ConfigError(
            f"time does not increase at row {row}: {times[row - 1]:g} s is followed by "
            f"{times[row]:g} s",
            expected="increasing times",
            fix="sort the table, and keep one row for each instant",
            file=drive.file,
            key=name,
        )
    if len(steps) and np.ptp(steps) <= _EVEN * steps.mean():
        hold = float(times[-1] - times[0]) / len(steps)
        return replace(drive, hold=hold, start=float(times[0]))
    return replace(drive, times=times)


def marker_drive(
    positions: NDArray[np.float64], *, unit: str, axes: Sequence[str], label: str
) -> Drive:
    """Return the displacement of a marker since the first frame, one value a frame.

    Parameters
    ----------
    positions : (T, D) [unit]

    Raises
    ------
    MissingData
        When the marker is missing in a frame: what drove the body is not made up.
    """
    missing = np.isnan(positions).any(axis=1)
    if missing.any():
        first = int(np.flatnonzero(missing)[0])
        raise MissingData(
            f"the marker ({label}) was not seen in {int(missing.sum())} of {len(positions)} "
            f"frames, first in frame {first}",
            expected="a marker that is seen in every frame, as its motion is the input",
            fix="choose another marker, let gaps be filled (max_gap), or give the drive as a CSV",
            key="drive_marker",
        )
    return Drive(
        values=positions - positions[0],
        columns=tuple(f"d{axis}" for axis in axes),
        unit=unit,
        quantity="displacement",
    )


def _table(path: Path) -> tuple[Path, list[str], NDArray[np.float64]]:
    """Return the header, empty where there is none, and the numbers, (K, columns)."""
    path = safety.check_readable(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise _no_table(path, "it is not text") from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip(" ,;\t") and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise _no_table(path, "it holds no line of data")
    mark = next((mark for mark in ",;\t" if mark in lines[0][1]), ",")
    cells_of = csv.reader([line for _, line in lines], delimiter=mark)
    split = [
        (number, [cell.strip() for cell in row])
        for (number, _), row in zip(lines, cells_of, strict=True)
    ]
    header = [] if _numbers(split[0][1]) is not None else split[0][1]
    width = len(split[0][1])
    rows = []
    for number, cells in split[1:] if header else split:
        values = _numbers(cells)
        if values is None or len(values) != width:
            raise _no_table(path, f"line {number} is {mark.join(cells)!r}")
        rows.append(values)
    if not rows:
        raise _no_table(path, "it holds a header and no data")
    if header and (len(set(map(_plain, header))) != width or not all(map(_plain, header))):
        raise _no_table(path, f"the header is {', '.join(header)!r}, with a name empty or twice")
    return path, header, np.array(rows, dtype=np.float64)


def _numbers(cells: Sequence[str]) -> list[float] | None:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _plain(name: str) -> str:
    return _BRACKET.sub("", name).strip()


def _bracket(name: str) -> str | None:
    match = _BRACKET.search(name)
    return match[1] if match else None


def _no_table(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected="CSV of finite numbers, one row a frame or a symbol, with or without a header",
        fix="export the drive again",
        file=path,
        key="drive",
    )
