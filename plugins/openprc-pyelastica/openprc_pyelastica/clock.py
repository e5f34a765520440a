"""The time axis of a rod, and which of the stored samples stand on it.

Scripts store a sample at t = 0 twice (once by hand, once from ``finalize``), or leave some
quantities out of the first sample, so that lengths differ by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, SchemaError
from openprc_pyelastica.containers import Entries

#: Agreement between a time step that the caller names and the stored times.
DT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Clock:
    """Times of the frames and the samples that they are.

    Parameters
    ----------
    time : (T,) [s]
    raw : int
        Number of stored samples, before repeated ones were dropped.
    keep : (T,) of int
        Which of the stored samples are frames.
    surplus : bool
        Some arrays hold one sample more, before the first that is known everywhere.
    """

    time: NDArray[np.float64]
    raw: int
    keep: NDArray[np.int64]
    surplus: bool = False

    def fits(self, length: int) -> bool:
        """Tell whether an array of `length` samples can be aligned."""
        return length in (self.raw, self.raw - 1) or (self.surplus and length == self.raw + 1)

    def align(self, array: NDArray[np.float64], *, key: str) -> tuple[NDArray[np.float64], int]:
        """Return the frames of `array` and the index of the first one.

        An array that is one sample shorter ends with the others and starts at frame 1.

        Raises
        ------
        SchemaError
            When the length is another one.
        """
        if self.surplus and len(array) == self.raw + 1:
            array = array[1:]
        if len(array) == self.raw:
            # Nothing dropped is the usual case, and long recordings are large.
            return array if len(self.keep) == self.raw else array[self.keep], 0
        if len(array) == self.raw - 1:
            later = self.keep[self.keep > 0]
            return array[later - 1], len(self.keep) - len(later)
        raise SchemaError(
            f"{len(array)} samples, and {self.raw} times",
            expected=f"{self.raw} samples, or one fewer",
            fix="store this quantity in the same branch of the callback as the time",
            key=key,
        )

    def frames(self, array: NDArray[np.float64], *, key: str) -> NDArray[np.float64]:
        """Return all T frames of `array`.

        Raises
        ------
        SchemaError
            When it has another length.
        """
        aligned, first = self.align(array, key=key)
        if first:
            raise SchemaError(
                f"{len(array)} samples, and {self.raw} times",
                expected=f"{self.raw} samples",
                fix="store it in the same branch of the callback as the time",
                key=key,
            )
        return aligned


def read(
    slots: Mapping[str, str],
    entries: Entries,
    *,
    dt: float | None,
    notes: list[str],
    name: str,
) -> Clock:
    """Find the clock of one rod.

    Parameters
    ----------
    slots : mapping of canonical name to key
    entries : mapping of key to array
    dt : float, optional
        Time between samples [s]; only for files that hold no time.
    notes : list of str
        Remarks are appended here.
    name : str
        Name of the rod, for remarks.

    Raises
    ------
    MissingData
        Neither times nor `dt`.
    SchemaError
        Times that run backwards or are not finite, or another number of them than of positions.
    ConfigError
        `dt` contradicts the file.
    """
    key = slots["position"]
    samples = len(entries[key])
    if not samples:
        raise MissingData(
            "no samples were stored",
            expected="at least one sample",
            fix="check that the callback's step_skip is smaller than the number of steps",
            key=key,
        )
    if "time" not in slots:
        return _from_dt(slots, entries, samples, dt)
    time = entries[slots["time"]].astype(np.float64)
    time = np.atleast_1d(time)
    surplus = abs(len(time) - samples) == 1
    if surplus:
        more, less = ("times", "positions") if len(time) > samples else ("positions", "times")
        notes.append(f"{name}: one sample more of {more} than of {less}; the first was left out")
        time = time[-min(samples, len(time)) :]
    elif len(time) != samples:
        raise SchemaError(
            f"{samples} samples of positions and {len(time)} times",
            expected="one time for each sample",
            fix="store both in the same branch of the callback",
            key=key,
        )
    if not np.isfinite(time).all():
        raise SchemaError(
            f"time is not finite at sample {int(np.argmin(np.isfinite(time)))}",
            expected="finite times",
            fix="check the script that saved the file",
            key=slots["time"],
        )
    repeats = _repeats(time, slots)
    clock = Clock(time[repeats], len(time), repeats, surplus)
    _tell_repeats(time, entries[key], clock, notes, name)
    _check_dt(clock.time, dt)
    return clock


def _from_dt(slots: Mapping[str, str], entries: Entries, samples: int, dt: float | None) -> Clock:
    if dt is None:
        raise MissingData(
            f"no time axis goes with {slots['position']}",
            expected="a key time, times or t with one value for each sample",
            fix="say dt=SECONDS between samples, or time=KEY if it has another name",
            key="time",
        )
    if not (np.isfinite(dt) and dt > 0.0):
        raise ConfigError(
            f"dt is {dt}", expected="a positive number of seconds", fix="correct dt", key="dt"
        )
    step = entries.get(slots.get("step", ""))
    if step is not None and len(step) == samples > 2 and np.ptp(np.diff(step)) != 0:
        raise ConfigError(
            "the stored steps are not evenly spaced, so one dt cannot place the samples",
            expected="evenly spaced samples, or times in the file",
            fix="save the time with every sample",
            key="dt",
        )
    frames = np.arange(samples)
    return Clock(np.multiply(frames, dt, dtype=np.float64), samples, frames)


def _repeats(time: NDArray[np.float64], slots: Mapping[str, str]) -> NDArray[np.int64]:
    back = np.flatnonzero(np.diff(time) < 0.0)
    if len(back):
        at = int(back[0])
        raise SchemaError(
            f"time runs backwards after sample {at}: {time[at]:.6g} s, then {time[at + 1]:.6g} s",
            expected="times that grow",
            fix="the same dict was probably filled by two runs; save each run by itself",
            key=slots["time"],
        )
    # Of several samples at one time the last one counts: it comes from the simulator's own call.
    return np.flatnonzero(np.append(np.diff(time) > 0.0, True))


def _tell_repeats(
    time: NDArray[np.float64],
    position: NDArray[np.generic],
    clock: Clock,
    notes: list[str],
    name: str,
) -> None:
    dropped = np.setdiff1d(np.arange(len(time)), clock.keep)
    if not len(dropped):
        return
    stored = position[-len(time) :].astype(np.float64)
    change = float(np.abs(stored[dropped] - stored[dropped + 1]).max())
    same = "identical to" if change == 0.0 else f"up to {change:.3g} m away from"
    notes.append(
        f"{name}: dropped {len(dropped)} repeated sample(s), first at t = "
        f"{time[dropped[0]]:.6g} s, {same} the later one, which was kept"
    )


def _check_dt(time: NDArray[np.float64], dt: float | None) -> None:
    if dt is None or len(time) < 2:
        return
    found = float(np.median(np.diff(time)))
    if abs(found - dt) > DT_TOLERANCE * found:
        raise ConfigError(
            f"dt is {dt:g}, and the file has its own times, {found:.6g} s apart",
            expected="no dt, which is for files without times",
            fix="leave dt out",
            key="dt",
        )
