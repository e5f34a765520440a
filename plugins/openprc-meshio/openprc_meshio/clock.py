"""Time of the frames: from the files, from an option, or load steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc_meshio.frames import Frame, Series


class Clock:
    """Says when a frame is.

    Attributes
    ----------
    unit, kind : str
        As `TrajectoryWriter.declare_time` takes them.
    note : str
        Where the times come from.

    Raises
    ------
    ConfigError
        When the options do not fit what the files say.
    UnreadableFile
        When the times of the files do not increase.
    """

    def __init__(self, series: Series, options: Mapping[str, Any]) -> None:
        self._series = series
        self._dt = dt = options.get("dt")
        unit = options.get("time_unit")
        if dt is not None and not dt > 0:
            raise self._wrong("dt", f"dt is {dt}", "a number above 0", "correct the option")
        if unit and series.time_unit and unit != series.time_unit:
            raise self._wrong(
                "time_unit",
                f"the option says {unit!r} and the file {series.time_unit!r}",
                "one unit",
                "leave the option out",
            )
        timed = series.times is not None or series.frames[0].time is not None
        self._counted = not timed
        self._last = -np.inf
        if not timed and dt is None:
            if unit not in (None, "1"):
                raise self._wrong(
                    "dt",
                    "the files do not say when their frames are",
                    "the time between two frames",
                    "pass the option dt, or time_unit=1 for load steps",
                )
            unit = "1"
        self.unit = unit or series.time_unit or "s"
        self.kind = "pseudo" if self.unit == "1" else "physical"
        self._steps = self._count()
        self.note = self._origin(unit, timed=timed)

    def at(self, index: int, frame: Frame) -> float:
        """Return the time of a frame."""
        own = self._series.times[index] if self._series.times is not None else frame.time
        if self._dt is None:
            if self._counted:
                return float(self._steps[index])
            if own is None:
                raise self._damaged(f"frame {index} has no time, and the first has")
            if not own > self._last:
                raise self._damaged(f"frame {index} is at {own:g} after {self._last:g}")
            self._last = float(own)
            return float(own)
        start = self._first()
        even = start + float(self._steps[index]) * self._dt
        if not self._counted and (own is None or abs(own - even) > 0.1 * self._dt):
            raise self._damaged(f"frame {index} is at {own}, and at {even:g} with dt = {self._dt}")
        return float(even)

    def _first(self) -> float:
        times = self._series.times
        own = times[0] if times is not None else self._series.frames[0].time
        return 0.0 if own is None else float(own)

    def _count(self) -> NDArray[np.int64]:
        """Return how many steps every frame is after the first, or its load step."""
        index = np.arange(len(self._series.frames), dtype=np.int64)
        numbers = self._series.numbers
        if numbers is None or not self._counted:
            return index
        if self._dt is None:
            return numbers
        steps = np.diff(numbers)
        if (steps != steps[0]).any():
            gap = int(np.flatnonzero(steps != steps[0])[0])
            raise self._wrong(
                "dt",
                f"the files are numbered ..., {numbers[gap]}, {numbers[gap + 1]}, and before that "
                f"every {steps[0]}",
                "evenly numbered files, since dt is the time between two of them",
                "add the files that are missing, or import a part of the series",
            )
        return index

    def _origin(self, unit: str | None, *, timed: bool) -> str:
        if timed and self._dt is not None:
            return f"times were replaced by even ones of dt = {self._dt}, as asked"
        if timed and not (unit or self._series.time_unit):
            return "times are those of the files, taken as seconds"
        if timed:
            return f"times are those of the files, in {self.unit}"
        if self._dt is not None:
            return f"the files hold no times; dt = {self._dt} was given"
        what = (
            "the index of the frame" if self._series.numbers is None else "the number of the file"
        )
        return f"the files hold no times: load steps, {what}; dt=... makes it time"

    def _damaged(self, found: str) -> UnreadableFile:
        return UnreadableFile(
            found,
            expected="times that increase from frame to frame, and that dt agrees with to a tenth",
            fix="correct dt or leave it out; export the series again",
            file=self._series.path,
            key="time",
        )

    def _wrong(self, key: str, found: str, expected: str, fix: str) -> ConfigError:
        return ConfigError(found, expected=expected, fix=fix, file=self._series.path, key=key)
