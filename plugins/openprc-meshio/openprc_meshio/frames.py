"""What every kind of series gives: frames with points, cells and fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


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
    """One instant. Arrays are read when they are asked for."""

    @property
    def same_points(self) -> object:
        """Equal for frames that name the same stored array; None when that cannot be told."""
        ...

    @property
    def same_cells(self) -> object:
        """Equal for frames that name the same stored cells; None when that cannot be told."""
        ...

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the fields of points."""
        ...

    @property
    def cell_names(self) -> tuple[str, ...]:
        """Names of the fields of cells."""
        ...

    @property
    def time(self) -> float | None:
        """Time that stands in the frame itself, where there is one."""
        ...

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
    """Frames in order of time, and what the files say about all of them.

    Attributes
    ----------
    frames : sequence of Frame
    times : (T,) or None
        None when the files do not say, or each says for itself.
    numbers : (T,) or None
        Numbers in the names of the files.
    time_unit, time_kind, dims, units
        Stated by files that this plugin's exporters wrote; units are by field:
        ``positions``, ``velocities``, ``bars.strain``.
    sources : list of Path
        What was read besides the file that was named.
    notes : list of str
    """

    path: Path
    frames: Sequence[Frame]
    times: NDArray[np.float64] | None = None
    numbers: NDArray[np.int64] | None = None
    time_unit: str = ""
    time_kind: str = ""
    dims: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    sources: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def by_shape(cells: Sequence[Cells]) -> dict[str, NDArray[np.int64]]:
    """Return shape to nodes, (E, k), blocks of one shape joined in their order.

    Polylines and polygons of different lengths are different shapes: ``polygon5``.
    """
    found: dict[str, list[NDArray[np.int64]]] = {}
    for block in cells:
        found.setdefault(shape_of(block), []).append(block.nodes)
    return {shape: np.concatenate(tables) for shape, tables in found.items()}


def shape_of(block: Cells) -> str:
    """Return the shape of a block, with the number of nodes where the name leaves it open."""
    open_ended = block.shape in ("polygon", "polyline", "vertex")
    return f"{block.shape}{block.nodes.shape[1]}" if open_ended else block.shape
