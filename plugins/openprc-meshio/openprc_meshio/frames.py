"""What every kind of series gives: frames with points, cells and fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.generic]


@dataclass(frozen=True)
class Cells:
    """A block of cells of one shape.

    Attributes
    ----------
    shape : str
        ``vertex``, ``line``, ``triangle``, ``quad``, ``tetra``, ``hexahedron``, ...
    nodes : (E, k) int
    """

    shape: str
    nodes: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.nodes)


class Frame(Protocol):
    """One instant. Arrays are read when they are asked for.

    ``same_points`` and ``same_cells`` are equal for frames that name the same stored array;
    None when that cannot be told.
    """

    same_points: object
    same_cells: object
    point_names: tuple[str, ...]
    cell_names: tuple[str, ...]

    def points(self) -> Array:
        """Return the places, (N, D)."""
        ...

    def cells(self) -> Sequence[Cells]:
        """Return the cells, block by block."""
        ...

    def point_field(self, name: str) -> Array:
        """Return a field of the points, (N,) or (N, k)."""
        ...

    def cell_field(self, name: str) -> Sequence[Array | None]:
        """Return a field of the cells, one array a block, None where it has none."""
        ...


@dataclass
class Series:
    """Frames in order of time.

    Attributes
    ----------
    frames : sequence of Frame
    times : (T,) or None
        None when the files do not say.
    time_unit, time_kind : str
        Where the files say so.
    units : mapping of field name to unit
        ``positions``, ``velocities``, ``bars.strain``: where the files say so.
    sources : list of Path
        What was read besides the file that was named.
    notes : list of str
    """

    path: Path
    frames: Sequence[Frame]
    times: NDArray[np.float64] | None
    time_unit: str = ""
    time_kind: str = ""
    dims: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    sources: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
