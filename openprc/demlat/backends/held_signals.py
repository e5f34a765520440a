"""When held signals move driven coordinates at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.signal_table import SAMPLE_SLACK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.tables import Drives


class HeldSignals:
    """The steps at whose end some prescribed position jumps.

    Parameters
    ----------
    drives : Drives
    h : float
        Time step, in the units of the drives.
    """

    def __init__(self, drives: Drives, h: float) -> None:
        table = drives.signals
        used = np.unique(drives.motion_signal)
        held = used[table.steps[used]] if len(used) else used
        steps = [self._jumps(table, column, h) for column in held]
        self.steps: NDArray[np.int64] = np.unique(np.concatenate([*steps, np.zeros(0, np.int64)]))

    @staticmethod
    def _jumps(table: Any, column: int, h: float) -> NDArray[np.int64]:
        first, count, dt = table.first[column], table.count[column], table.dt[column]
        values = table.coefficients[first : first + count, 0]
        sample = 1 + np.flatnonzero(np.diff(values) != 0.0)
        step: NDArray[np.int64] = np.rint(sample * dt / h).astype(np.int64)
        # Of a sample within a step the stages of that step see both sides.
        return step[np.abs(step * h / dt - sample) <= SAMPLE_SLACK]

    def next_jump(self, after: int, before: int) -> int:
        """Return the first step number beyond `after` with a jump, or `before` if that is less."""
        at = int(np.searchsorted(self.steps, after, side="right"))
        return min(before, int(self.steps[at])) if at < len(self.steps) else before

    def jumps_at(self, step: int) -> bool:
        """Say whether positions jump when step number `step` begins."""
        at = int(np.searchsorted(self.steps, step))
        return at < len(self.steps) and int(self.steps[at]) == step
