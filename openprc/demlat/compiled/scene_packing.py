"""Where the coordinates and parameters of scenes stand in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.compiled.aligned import aligned_copy, aligned_zeros
from openprc.demlat.compiled.packing import Blocks, ensemble_blocks, run_blocks, spread_blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

Lanes = tuple[float, ...]
#: Lanes of a vector register (and what two narrower ones hold).
WIDTH = {"float64": 8, "float32": 16}


@dataclass(frozen=True)
class Packing:
    """How coordinates and parameters of S scenes stand in memory.

    Attributes
    ----------
    lanes : template
    scenes : int
        1, or the number of lanes.
    n_nodes, dims, stride : int
    """

    lanes: Lanes
    scenes: int
    n_nodes: int
    dims: int
    stride: int

    @classmethod
    def plan(
        cls, *, n_nodes: int, dims: int, vectors: bool, scenes: int, precision: str
    ) -> Packing:
        """Return the packing of `scenes` scenes with `n_nodes` nodes."""
        width = WIDTH[precision] if vectors else 1
        number = np.float32 if precision == "float32" else float
        used = n_nodes * width if scenes > 1 else n_nodes + width - 1
        stride = -(-used // width) * width
        if (stride * (4 if precision == "float32" else 8)) % 4096 == 0:
            stride += width  # or x, y and z would compete for the same lines of the cache
        return cls((number(0.0),) * width, scenes, n_nodes, dims, stride)

    @property
    def dtype(self) -> type:
        """Type of the coordinates."""
        return np.float32 if isinstance(self.lanes[0], np.float32) else np.float64

    def coordinates(self, values: Reals) -> Reals:
        """Return values (S, N, 3) as flat coordinates: (dims * stride,)."""
        flat = aligned_zeros(self.dims * self.stride, self.dtype).reshape(self.dims, self.stride)
        by_axis = values.transpose(2, 1, 0)[: self.dims]
        flat[:, : self.n_nodes * self.scenes] = by_axis.reshape(self.dims, -1)
        return flat.reshape(-1)

    def nodes(self, flat: Reals) -> Reals:
        """Return flat coordinates as (S, N, dims)."""
        used = flat.reshape(self.dims, self.stride)[:, : self.n_nodes * self.scenes]
        return used.reshape(self.dims, self.n_nodes, self.scenes).transpose(2, 1, 0)

    def at(self, node: int, axis: int, scene: int) -> int:
        """Return where a coordinate stands."""
        return axis * self.stride + node * self.scenes + scene

    def blocks(self, indices: NDArray[np.int32], chosen: NDArray[np.int64]) -> Iterator[Blocks]:
        """Yield blocks that cover the chosen elements."""
        width = len(self.lanes)
        if self.scenes > 1:
            yield ensemble_blocks(indices, chosen, width)
        elif width == 1:
            yield spread_blocks(indices, chosen, 1)
        else:
            blocks, rest = run_blocks(indices, chosen, width)
            if len(blocks.element):
                yield blocks
            if len(rest):
                yield spread_blocks(indices, rest, width)

    def parameters(self, blocks: Blocks, values: Reals, fill: float = 0.0) -> Reals:
        """Return values (S, E) in the order of the lanes."""
        if self.scenes > 1:
            chosen = blocks.element.reshape(-1, self.scenes)[:, 0]
            return aligned_copy(values[:, chosen].T, self.dtype)
        return aligned_copy(blocks.spread_out(values[0], fill), self.dtype)
