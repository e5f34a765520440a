"""A stretch of frames of a trajectory, read as if it were a whole file."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.io.state_loader import StateLoader
from openprc.schema import Trajectory
from openprc.schema.stored import InputSignal


class FrameWindow:
    """Frames `start` to `stop` of a trajectory, after its frame 0.

    Frame 0 always comes first, because displacements and extensions may be counted from it.
    Whatever does not depend on time is that of the whole file, and so is the time step.

    Parameters
    ----------
    trajectory : Trajectory
    start, stop : int
        ``start`` of 0 gives the frames from the beginning, once.
    """

    def __init__(self, trajectory: Trajectory, start: int, stop: int) -> None:
        self._whole = trajectory
        self._frames = slice(start, stop)
        self.n_frames = stop - start + self.n_before

    @property
    def n_before(self) -> int:
        """Frames that are put in front: 1, or 0 where the window begins at frame 0."""
        return int(self._frames.start > 0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._whole, name)

    @property
    def time(self) -> NDArray[np.float64]:
        """Instants of the frames."""
        return self._cut(self._whole.time)

    def positions(self, **keywords: Any) -> NDArray[np.float64]:
        """Return positions; see `Trajectory.positions`."""
        return self._joined(self._whole.positions, **keywords)

    def velocities(self, **keywords: Any) -> NDArray[np.float64]:
        """Return velocities; see `Trajectory.velocities`."""
        return self._joined(self._whole.velocities, **keywords)

    def observed(self) -> NDArray[np.uint8]:
        """Return the mask; see `Trajectory.observed`."""
        return self._joined(self._whole.observed)

    def element(self, kind: str, quantity: str, **keywords: Any) -> NDArray[np.float64]:
        """Return a quantity of every element; see `Trajectory.element`."""
        return self._joined(self._whole.element, kind, quantity, **keywords)

    def channel(self, name: str, **keywords: Any) -> NDArray[np.float64]:
        """Return a channel; see `Trajectory.channel`."""
        return self._joined(self._whole.channel, name, **keywords)

    def system(self, name: str, **keywords: Any) -> NDArray[np.float64]:
        """Return a whole-body quantity; see `Trajectory.system`."""
        return self._cut(self._whole.system(name, **keywords))

    def input(self, name: str | None = None) -> InputSignal:
        """Return an input; see `Trajectory.input`."""
        signal = self._whole.input(name)
        return replace(signal, value=self._cut(signal.value))

    def _cut(self, series: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([series[: self.n_before], series[self._frames]])

    def _joined(self, read: Any, *names: str, **keywords: Any) -> NDArray[Any]:
        inside = read(*names, frames=self._frames, **keywords)
        if not self.n_before:
            return np.asarray(inside)
        return np.concatenate([read(*names, frames=slice(0, 1), **keywords), inside])


def windowed(loader: StateLoader, start: int, stop: int) -> StateLoader:
    """Return a loader of the same file that sees frame 0 and frames `start` to `stop` only."""
    window = copy.copy(loader)
    window.trajectory = FrameWindow(loader.trajectory, start, stop)  # type: ignore[assignment]
    return window
