"""The clock of older files, which was rounded when it was stored.

The older engine keeps time in single precision, and laboratory recordings carry Unix time,
where a float64 resolves 0.24 microseconds. Either makes an even clock look uneven.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema.legacy_kinds import read


@dataclass(frozen=True)
class Clock:
    """Frame times (T,) [s], and what was done to them ("" for nothing)."""

    time: NDArray[np.float64]
    remark: str


def rebuild(stored: NDArray[np.floating], *, rates: Sequence[float], epoch: float = 0.0) -> Clock:
    """Undo the rounding of an even clock.

    The times become ``t0 + i dt`` where that explains every stored one to within one unit in
    the last place of the stored numbers; otherwise they stay as they are.

    Parameters
    ----------
    stored : (T,) [s]
        As in the file, f4 or f8.
    rates : sequence of float [Hz]
        Frame rates that the file claims. They are candidates, not facts.
    epoch : float [s]
        What was subtracted from the times before they were stored, which sets their
        resolution.
    """
    time = stored.astype(np.float64)
    if len(time) < 2:
        return Clock(time, "")
    largest = np.abs(stored).max() + stored.dtype.type(abs(epoch))
    resolution = float(np.spacing(largest))
    t0 = float(str(stored[0])) if stored.dtype == np.float32 else float(time[0])
    mean = (time[-1] - time[0]) / (len(time) - 1)
    claimed = [_tidy(1.0 / rate) for rate in rates if np.isfinite(rate) and rate > 0]
    # The shortest decimal that fits is what somebody once typed as dt_save.
    decimals = [float(f"{mean:.{digits}g}") for digits in range(1, 10)]
    index = np.arange(len(time), dtype=np.float64)
    for dt in claimed + decimals:
        even: NDArray[np.float64] = t0 + index * dt
        difference = float(np.abs(time - even).max())
        if difference <= resolution:
            if difference == 0.0:
                return Clock(even, "")
            return Clock(
                even,
                f"time was stored with a resolution of {resolution:.2g} s; it was rebuilt as "
                f"{t0:g} + i * {dt!r} s, which differs from the stored times by up to "
                f"{difference:.2g} s",
            )
    return Clock(time, "")


def _tidy(dt: float) -> float:
    # 1 / 333.33333333333331 is 0.0030000000000000001 or one bit beside it.
    short = float(f"{dt:.12g}")
    return short if abs(short - dt) <= 2 * np.spacing(dt) else dt


def read_times(dataset: h5py.Dataset, rows: int, *, path: Path) -> NDArray[np.floating]:
    """Return the first `rows` times (T,) in the type in which they are stored.

    Raises
    ------
    UnreadableFile
        When they are no real numbers, not finite, or do not increase.
    """
    stored = read(dataset, slice(0, rows)).reshape(-1)
    if stored.dtype.kind != "f":
        stored = stored.astype(np.float64)
    time = np.where(np.isfinite(stored), stored, np.nan).astype(np.float64)
    # A comparison with NaN is false, so this finds what is not finite as well.
    wrong = np.flatnonzero(~(np.diff(time, prepend=time[0] - 1.0) > 0))
    if len(wrong):
        row = int(wrong[0])
        raise UnreadableFile(
            f"time is {float(stored[row])} at frame {row}"
            + (f", after {float(stored[row - 1])}" if row else ""),
            expected="finite times that increase from frame to frame",
            fix="the recording is damaged there; export it again, or cut it before that frame",
            file=path,
            key=dataset.name,
        )
    return stored
