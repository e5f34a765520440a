"""Frames of a file in the coordinates of the comparison, read forwards in blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.alignment.coordinates import POSITIONS, VELOCITIES
from openprc.schema.streams import CHUNK_BYTES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.coordinates import Coordinates
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

OBSERVED = "/time_series/nodes/observed"
#: Code of a place that was filled in, not measured.
FILLED = 2


class FrameReader:
    """Reads ranges of frames; a range that begins in the last one reads only what is new.

    Parameters
    ----------
    trajectory : Trajectory
    coordinates : Coordinates
    nodes : (n,) int, optional
        All by default.
    filled : bool
        Keep places that were filled in; they become NaN otherwise.
    velocities : bool
        Read velocities instead of places.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        coordinates: Coordinates,
        *,
        nodes: NDArray[np.integer] | None = None,
        filled: bool = False,
        velocities: bool = False,
    ) -> None:
        self.trajectory = trajectory
        self.coordinates = coordinates
        n, dims = trajectory.n_nodes, trajectory.dims
        every = nodes is None or np.array_equal(nodes, np.arange(n))
        self.nodes = None if every else np.asarray(nodes, dtype=np.intp)
        self.n_nodes = n if self.nodes is None else len(self.nodes)
        self._columns = (
            None if coordinates.columns == tuple(range(dims)) else list(coordinates.columns)
        )
        # Held open: finding it again for every block takes as long as reading the block.
        self._series = trajectory.series(VELOCITIES if velocities else POSITIONS)
        factor = coordinates.speed_factor if velocities else coordinates.factor
        self._factor = 1.0 if factor is None else factor
        self._masked = trajectory.has(OBSERVED) and not filled
        #: Size of a frame as it is stored in float64.
        self.row_bytes = n * dims * 8
        #: Frames in a chunk as the writer makes them; only speed depends on it.
        self.chunk_rows = max(1, CHUNK_BYTES // self.row_bytes)
        self._range = (0, 0)
        self._rows: Reals = np.empty((0, self.n_nodes, len(coordinates.columns)))

    def rows(self, start: int, stop: int) -> Reals:
        """Return frames [start, stop): (B, n, d), NaN where missing."""
        held_from, held_to = self._range
        if held_from <= start < held_to:
            kept = self._rows[start - held_from : max(stop, start) - held_from]
            if stop <= held_to:
                return kept
            rows = np.concatenate([kept, self._read(held_to, stop)])
        else:
            rows = self._read(start, stop)
        self._range, self._rows = (start, stop), rows
        return rows

    def single(self, frame: int) -> Reals:
        """Return one frame, (n, d), and hold on to what was read before."""
        return self._read(frame, frame + 1)[0]

    def scattered(self, frames: NDArray[np.integer]) -> Reals:
        """Return frames of any number in rising order: (B, n, d)."""
        span = int(frames[-1]) + 1 - int(frames[0])
        if span == len(frames):
            return self.rows(int(frames[0]), int(frames[-1]) + 1)
        if span <= 2 * self.chunk_rows * len(frames):
            return self.rows(int(frames[0]), int(frames[-1]) + 1)[frames - frames[0]]
        return np.stack([self.single(int(frame)) for frame in frames])

    def _read(self, start: int, stop: int) -> Reals:
        rows = self._series.read(slice(start, stop)).astype("f8", copy=False)
        if self._masked:
            dropped = self.trajectory.observed(slice(start, stop)) == FILLED
            if dropped.any():
                rows[dropped] = np.nan
        if self.nodes is not None:
            rows = rows[:, self.nodes]
        if self._columns is not None:
            rows = rows[..., self._columns]
        if self._factor != 1.0:
            rows = rows * self._factor
        return np.ascontiguousarray(rows)


__all__ = ["FILLED", "OBSERVED", "FrameReader"]
