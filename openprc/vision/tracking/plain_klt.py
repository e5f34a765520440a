"""Plain pyramidal Lucas-Kanade from frame to frame: a lost point stays lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.predictor import PyramidalKLT
from openprc.vision.tracking.status import Status
from openprc.vision.tracking.track_steps import FrameTracks

if TYPE_CHECKING:
    from openprc.vision.source.frame import Frame


class PlainKLT:
    """Follows points by Lucas-Kanade alone.

    The errors of all steps add up, a change of lighting moves the points, and neither is seen
    by the check forward and back; quality, one-sigma and deformation are not known.
    """

    def __init__(self, config: KLTConfig) -> None:
        self.config = config
        self.notes: tuple[str, ...] = ()
        self._klt = PyramidalKLT(config)

    def place(self, frame: Frame, points: NDArray[np.float64]) -> FrameTracks:
        """Take `points` (N, 2) [px] as they lie in the reference frame."""
        self._positions = points.copy()
        self._status = np.full(len(points), Status.TRACKED, np.uint8)
        self._before = frame.grey
        self._last_step = 0.0
        return self._tracks(frame, np.full(len(points), Status.REFERENCE, np.uint8))

    def step(self, frame: Frame) -> FrameTracks:
        """Find the points that are still followed in the next frame."""
        alive = np.flatnonzero(self._status == Status.TRACKED)
        start = self._positions[alive]
        step = self._klt.step(self._before, frame.grey, start, last_step=self._last_step)
        status = np.full(len(alive), Status.TRACKED, np.uint8)
        moved = np.hypot(*(step.positions - start).T)
        status[step.fb_error > self.config.fb_threshold] = Status.DRIFT
        if self.config.max_step is not None:
            status[moved > self.config.max_step] = Status.DRIFT
        status[~step.found] = Status.LOST
        status[step.outside] = Status.OOB
        kept = status == Status.TRACKED
        if kept.any():
            self._last_step = float(np.median(moved[kept]))
        self._positions[alive] = np.where(kept[:, None], step.positions, np.nan)
        self._status[alive] = status
        self._before = frame.grey
        return self._tracks(frame, self._status.copy())

    def _tracks(self, frame: Frame, status: NDArray[np.uint8]) -> FrameTracks:
        n = len(self._positions)
        return FrameTracks(
            index=frame.index,
            stamp=frame.stamp,
            duplicate=frame.duplicate,
            positions=self._positions.copy(),
            status=status,
            quality=np.full(n, np.nan, np.float32),
            sigma=np.full((n, 2), np.nan, np.float32),
            template=np.zeros(n, np.int32),
            deformation=np.full((n, 2, 2), np.nan, np.float32),
        )
