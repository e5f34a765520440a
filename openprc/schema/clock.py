"""The clock of a stored trajectory: instants as they are, and one step where there is one."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from openprc.errors import NonUniformTime
from openprc.schema.damage import damage_named
from openprc.schema.stored import ALL, StoredData
from openprc.schema.timebase import UNIFORM_TOLERANCE, max_deviation


class Clock(StoredData):
    """The part of `Trajectory` that knows about time."""

    @cached_property
    def time(self) -> NDArray[np.float64]:
        """Time of every frame, (T,), in `time_unit`.

        Raises
        ------
        SchemaError
            When an instant is not finite or not later than the one before.
        """
        values = self._series("/time_series/time", ALL)
        bad = np.flatnonzero(~(np.diff(values) > 0)) + 1
        if not np.isfinite(values).all() or bad.size:
            frame = int(bad[0]) if bad.size else 0
            raise self._broken(
                "/time_series/time",
                f"frame {frame} is at {values[frame]:g}, which is not later than the one before",
                "finite, strictly increasing time",
            )
        return values

    @property
    def time_unit(self) -> str:
        """Unit of time."""
        return str(self._attr("/time_series/time", "unit"))

    @property
    def time_kind(self) -> str:
        """``physical``, or ``pseudo`` for quasi-static load steps."""
        return str(self._attr("/time_series/time", "kind"))

    @property
    def uniform(self) -> bool:
        """Whether frames are evenly spaced, as the writer checked."""
        path = "/time_series/time"
        with damage_named(self.path, f"{path}@uniform"):
            return bool(self._file[path].attrs.get("uniform", 0))

    @property
    def t0(self) -> float:
        """Time of frame 0."""
        return float(self.time[0])

    @property
    def dt(self) -> float:
        """Time between frames, in `time_unit`.

        Raises
        ------
        NonUniformTime
            When frames are not evenly spaced: there is no single step to return.
        SchemaError
            When the file claims that they are, and they are not.
        """
        if not self.uniform:
            steps = np.diff(self.time)
            spread = f" (steps from {steps.min():g} to {steps.max():g})" if len(steps) else ""
            raise NonUniformTime(
                f"the frames are not evenly spaced{spread}",
                expected="a uniform clock",
                fix="resample the file explicitly, or work with `time`",
                file=self.path,
                key="/time_series/time",
            )
        dt = float(self._attr("/time_series/time", "dt"))
        off = max_deviation(self.time, float(self._attr("/time_series/time", "t0")), dt)
        if not off <= UNIFORM_TOLERANCE:
            raise self._broken(
                "/time_series/time",
                f"the file claims steps of {dt!r}, and a frame is {off:.3g} steps off",
                "a claim that holds for every frame",
            )
        return dt
