"""Both files at the common instants, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.alignment.interpolants import WIDTHS, Name, sum_frames, weights_at
from openprc.errors import SchemaError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.common_clock import CommonClock, Sampling
    from openprc.compare.alignment.frame_reading import FrameReader
    from openprc.compare.alignment.rigid_motion import RigidMotion

    Reals = NDArray[np.float64]


@dataclass
class SampledFile:
    """One file at the instants of the comparison.

    Parameters
    ----------
    reader : FrameReader
    sampling : Sampling
    interpolant : {"nearest", "linear", "cubic", "hermite"}
        Where the instants fall between frames.
    speeds : FrameReader or None
        For the Hermite polynomial.
    """

    reader: FrameReader
    sampling: Sampling
    interpolant: Name = "cubic"
    speeds: FrameReader | None = None

    @cached_property
    def _reach(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First frame that each instant needs, and the one after the last."""
        below = self.sampling.below()
        if self.sampling.exact:
            return below, below + 1
        width = WIDTHS[self.interpolant]
        length = len(self.sampling.clock)
        first = np.clip(below - max(0, width // 2 - 1), 0, max(0, length - width))
        # The nearest frame may be the next one.
        return first, np.minimum(first + max(2, width), length)

    def until(self, start: int, most: int) -> int:
        """Return where a block of instants from `start` on ends that needs `most` frames."""
        first, last = self._reach
        return max(start + 1, int(np.searchsorted(last, first[start] + most, side="right")))

    def rows(self, start: int, stop: int) -> Reals:
        """Return instants [start, stop): (B, n, d), NaN where missing."""
        part = self.sampling.part(slice(start, stop))
        if part.frames is not None:
            return self.reader.scattered(part.frames)
        assert part.instants is not None  # noqa: S101 - a sampling has one of both
        first, last = (ends[start:stop] for ends in self._reach)
        low, high = int(first[0]), int(last[-1])
        weights = weights_at(self.sampling.clock[low:high], part.instants, name=self.interpolant)
        places = self.reader.rows(low, high)
        speeds = None if self.speeds is None else self.speeds.rows(low, high)
        return sum_frames(weights, places, speeds)


@dataclass
class PairedFrames:
    """The places of matched nodes in both files.

    Parameters
    ----------
    clock : CommonClock
    reference, other : SampledFile
    motion : RigidMotion or None
        Applied to the other file.
    offset : (n, d) or None
        Subtracted from the other file afterwards.
    block_bytes : int
    """

    clock: CommonClock
    reference: SampledFile
    other: SampledFile
    motion: RigidMotion | None = None
    offset: Reals | None = None
    block_bytes: int = 2 << 20

    def __len__(self) -> int:
        return len(self.clock)

    @property
    def n_nodes(self) -> int:
        """Number of matched nodes."""
        return self.reference.reader.n_nodes

    @property
    def dims(self) -> int:
        """Number of axes."""
        return len(self.reference.reader.coordinates.columns)

    def moved(self, motion: RigidMotion | None) -> PairedFrames:
        """Return the same pair with the other file moved."""
        return replace(self, motion=motion)

    def rows(self, start: int, stop: int) -> tuple[Reals, Reals]:
        """Return instants [start, stop) of both: (B, n, d) each.

        Raises
        ------
        SchemaError
            When a file holds numbers too large for squares.
        """
        x, y = self.reference.rows(start, stop), self.other.rows(start, stop)
        if self.motion is not None:
            y = self.motion.apply(y, offset=self.offset)
        elif self.offset is not None:
            y = y - self.offset
        return x, y

    def blocks(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[int, Reals, Reals]]:
        """Yield (first instant, x, y) in order, on borders of chunks where that is possible."""
        end = len(self) if stop is None else stop
        most = [self._frames(side) for side in (self.reference, self.other)]
        at = start
        while at < end:
            upto = min(
                end,
                self.reference.until(at, self._aligned(self.reference, at, most[0])),
                self.other.until(at, self._aligned(self.other, at, most[1])),
            )
            x, y = self.rows(at, upto)
            yield at, x, y
            at = upto

    def _frames(self, side: SampledFile) -> int:
        frames = max(1, self.block_bytes // side.reader.row_bytes)
        chunk = side.reader.chunk_rows
        return frames if frames < chunk else frames - frames % chunk

    @staticmethod
    def _aligned(side: SampledFile, at: int, most: int) -> int:
        """Shorten the block so that the next one begins with a chunk."""
        frames = side.sampling.frames
        chunk = side.reader.chunk_rows
        if frames is None or most < chunk:
            return most
        return most - int(frames[at]) % chunk


def refuse_too_large(value: float, pair: PairedFrames) -> None:
    """Raise where squares of places have no finite sum.

    Raises
    ------
    SchemaError
    """
    if np.isfinite(value):
        return
    names = [side.reader.trajectory.path for side in (pair.reference, pair.other)]
    raise SchemaError(
        f"places here or in {names[0].name} are too large: their squares overflow",
        expected="the motion of a body, which is finite",
        fix="the run diverged: repeat it with a smaller time step, or compare the part before"
        " with stop",
        file=names[1],
        key="/time_series/nodes/positions",
    )


__all__ = ["PairedFrames", "SampledFile", "refuse_too_large"]
