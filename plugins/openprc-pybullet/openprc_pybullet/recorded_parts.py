"""What every recorded part of a scene has: nodes, channels, and a way to read a frame of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of a part: name, columns, unit, and what it is."""

    name: str
    columns: tuple[str, ...]
    unit: str
    quantity: str


@dataclass(frozen=True, slots=True)
class Nodes:
    """The nodes of a part.

    Parameters
    ----------
    labels : n names, unique in the file
    owners : n pairs
        Id of the body and index of the link (-1 the base) or of the vertex.
    masses : n floats [kg], or None when PyBullet does not tell
    fixed : n flags
    bars : pairs of own nodes
    faces : triples of own nodes
    has_velocities : bool
        Whether PyBullet tells how fast they move.
    """

    labels: tuple[str, ...]
    owners: tuple[tuple[int, int], ...]
    masses: tuple[float, ...] | None
    fixed: tuple[bool, ...]
    bars: tuple[tuple[int, int], ...] = ()
    faces: tuple[tuple[int, int, int], ...] = ()
    has_velocities: bool = True


NO_NODES = Nodes((), (), (), ())


@dataclass(frozen=True, slots=True)
class Values:
    """A block of B frames of one part.

    Parameters
    ----------
    positions : (B, n, 3) [m]
    velocities : (B, n, 3) [m/s], or None
    channels : mapping of name to (B, C)
    """

    positions: NDArray[np.float64]
    velocities: NDArray[np.float64] | None = None
    channels: dict[str, NDArray[np.float64]] = field(default_factory=dict)


class Part(Protocol):
    """A body, a soft body, or the contacts of all of them."""

    @property
    def nodes(self) -> Nodes:
        """What it adds to the nodes."""
        ...

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What it adds to the channels."""
        ...

    @property
    def width(self) -> int:
        """Numbers of one frame."""
        ...

    def read(self, row: list[float]) -> None:
        """Append the numbers of the present state to `row`; this runs in every step."""
        ...

    def values(self, block: NDArray[np.float64]) -> Values:
        """Sort B frames (B, width) of such numbers."""
        ...
