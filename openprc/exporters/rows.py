"""Which frames an export holds, and how they are taken from the file in blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from openprc.errors import ConfigError, MissingData

if TYPE_CHECKING:
    from openprc.schema import Trajectory

_BLOCK = 1024


class Rows:
    """Every ``stride``-th of `n_frames` frames.

    Parameters
    ----------
    n_frames : int
        Of the trajectory.
    options : mapping
        ``"stride"``, an int of at least 1; 1 when there is none.

    Raises
    ------
    ConfigError
        When the stride is below 1.
    """

    def __init__(self, n_frames: int, options: Mapping[str, Any]) -> None:
        self.n_frames = n_frames
        self.stride = int(options.get("stride", 1))
        if self.stride < 1:
            raise ConfigError(
                f"stride is {self.stride}",
                expected="1 for every frame, or more",
                fix="correct the option",
                key="stride",
            )

    def __len__(self) -> int:
        """Return how many frames are taken."""
        return len(range(0, self.n_frames, self.stride))

    def all(self) -> slice:
        """Return all frames taken, as one slice."""
        return slice(0, self.n_frames, self.stride)

    def blocks(self) -> Iterator[slice]:
        """Yield slices that take the same frames a thousand or so at a time."""
        step = _BLOCK * self.stride
        for start in range(0, self.n_frames, step):
            yield slice(start, min(start + step, self.n_frames), self.stride)


def require_positions(trajectory: Trajectory) -> None:
    """Refuse a trajectory of channels alone, for formats that are about nodes in space.

    Raises
    ------
    MissingData
    """
    if not trajectory.dims:
        raise MissingData(
            "the trajectory has no positions",
            expected="nodes in space",
            fix="export it as csv or npz, which take channels",
            file=trajectory.path,
            key="/time_series/nodes/positions",
        )
