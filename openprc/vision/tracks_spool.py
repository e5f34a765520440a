"""Tracks on disk while the video runs: what is known of a frame only at the end can wait.

The time axis, and with it everything that is a function of time, is settled when the last
frame has been seen. Until then the steps lie in a file without a name, so that memory does not
grow with the length of the video and nothing is left behind, however the run ends.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.track_steps import FrameTracks

if TYPE_CHECKING:
    from openprc.vision.source.time_axis import TimeAxis

#: Bytes of a block that is read at once.
BLOCK = 32 * 2**20
_PER_POINT = ("positions", "status", "quality", "sigma", "template", "deformation")


class TracksSpool:
    """Steps of a tracker, appended one by one and read as arrays.

    Parameters
    ----------
    folder : path-like
        Where the file without a name lies: beside the result, which needs as much room.
    n_points : int
    """

    def __init__(self, folder: str | Path, n_points: int) -> None:
        self.n_points = n_points
        self._dtype = np.dtype(
            [
                ("stamp", "f8"),
                ("positions", "f8", (n_points, 2)),
                ("sigma", "f4", (n_points, 2)),
                ("deformation", "f4", (n_points, 2, 2)),
                ("quality", "f4", (n_points,)),
                ("template", "i4", (n_points,)),
                ("status", "u1", (n_points,)),
                ("duplicate", "?"),
            ],
            align=True,
        )
        # It goes when the last array that looks at it does, also after a crash.
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as we do
        self._row = np.zeros((), self._dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, step: FrameTracks) -> None:
        """Keep what is known of one frame."""
        row = self._row
        row["stamp"], row["duplicate"] = step.stamp, step.duplicate
        for name in _PER_POINT:
            row[name] = getattr(step, name)
        self._file.write(row.tobytes())
        self._count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def rows(self) -> NDArray[Any]:
        """All frames as a structured array, mapped and not read; it outlives the spool."""
        if not self._count:
            return np.zeros(0, self._dtype)
        self._file.flush()
        return np.memmap(self._file, self._dtype, mode="r", shape=(self._count,))

    def clock(self) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        """Return the time stamps (T,) [s] and the numbers of the duplicated frames."""
        rows = self.rows
        return rows["stamp"].copy(), tuple(np.flatnonzero(rows["duplicate"]).tolist())

    def result(self, axis: TimeAxis, **attributes: Any) -> TrackingResult:
        """Return the tracks on a clock; the arrays are mapped, so no memory is needed."""
        rows = self.rows
        arrays = {name: rows[name] for name in _PER_POINT}
        return TrackingResult(timestamps=axis.times, time_axis=axis, **arrays, **attributes)


def slices(total: int, size: int) -> list[slice]:
    """Return what divides `total` rows into blocks of `size`."""
    return [slice(start, min(start + size, total)) for start in range(0, total, size)]
