"""What one body leaves at each recorded step: copies, in memory that is made beforehand.

A callback runs inside the user's loop, so `Track.take` does as little as it can: it copies the
strided views that PyElastica's rods have into their memory block, and nothing else.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica.recorded_systems import Body

#: Frames are handed on in blocks of about this size (that at which the writer writes what it has,
#: so that it need not gather several), and of so many frames.
BLOCK_BYTES, LEAST_ROWS, MOST_ROWS = 4 << 20, 16, 8192


class Track:
    """The frames of one body that were not handed on yet.

    Parameters
    ----------
    body : Body
    rows : int
        Room for so many frames.
    extra : tuple of str
        Attributes of the system to keep beside positions and velocities.
    """

    def __init__(self, body: Body, *, rows: int, extra: tuple[str, ...] = ()) -> None:
        self.body = body
        self.rows = rows
        self.row = 0
        self.last = -math.inf
        self.times = np.empty(rows)
        names = ("position_collection", "velocity_collection", *extra)
        self.blocks: dict[str, NDArray[np.float64]] = {
            name: np.empty((rows, *getattr(body.system, name).shape)) for name in names
        }
        self._positions = self.blocks["position_collection"]
        self._velocities = self.blocks["velocity_collection"]
        self._extra = tuple((name, self.blocks[name]) for name in extra)

    def take(self, system: Any, time: float) -> bool:
        """Copy the state of `system`; False when this instant was taken before.

        Raises
        ------
        ConfigError
            When time runs backwards.
        """
        if time <= self.last:
            if time == self.last:
                return False
            raise ConfigError(
                f"{self.body.name} is at t = {time:.12g} s after t = {self.last:.12g} s",
                expected="a loop whose time grows",
                fix="pass the time that step() returned on to the next step(); record a second "
                "run to a file of its own",
                key="time",
            )
        self.last = time
        row = self.row
        self.times[row] = time
        self._positions[row] = system.position_collection
        self._velocities[row] = system.velocity_collection
        for name, block in self._extra:
            block[row] = getattr(system, name)
        self.row = row + 1
        return True

    def lengths(self, rows: int) -> NDArray[np.float64]:
        """Return the lengths of the elements in the first `rows` frames: (rows, E) [m]."""
        positions = self._positions[:rows]
        arms = np.diff(positions, axis=2)
        if len(self.body.bars) > arms.shape[2]:  # a ring
            arms = np.concatenate([arms, positions[:, :, :1] - positions[:, :, -1:]], axis=2)
        arms *= arms
        squares: NDArray[np.float64] = arms[:, 0] + arms[:, 1]
        squares += arms[:, 2]
        return np.sqrt(squares, out=squares)

    def drop(self, rows: int) -> None:
        """Forget the first `rows` frames; what follows them moves to the front."""
        left = self.row - rows
        if left:
            for block in (self.times, *self.blocks.values()):
                block[:left] = block[rows : self.row].copy()
        self.row = left


def rows_for(n_numbers: int) -> int:
    """Return how many frames of `n_numbers` float64 a block holds."""
    return max(LEAST_ROWS, min(MOST_ROWS, BLOCK_BYTES // (8 * max(1, n_numbers))))
