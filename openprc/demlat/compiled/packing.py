"""Cutting elements into blocks of lanes that can be loaded and stored as vectors.

A *run* block holds elements whose node numbers all advance by one from lane to lane: each of
its ends is one stretch of memory. Lattices and tessellations that are numbered row by row
consist of them almost entirely. The lanes of a block write to different nodes, so nothing
conflicts, and blocks follow one another, so results do not depend on any race. What fits into
no run becomes *spread* blocks (every lane has its own place) or single elements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: A run block with fewer elements than this share of its lanes costs more than it saves.
LEAST_FILL = 0.4
#: Nodes whose positions, velocities and forces stay in a second-level cache together.
TILE = 4096


class Blocks(NamedTuple):
    """How elements stand in lanes.

    Attributes
    ----------
    element : (B * width,) i4
        Element of every lane, -1 for filling.
    places : (B, k) i4, or (B, width, k) i4 when spread
        Where the nodes of a block are.
    width : int
    """

    element: NDArray[np.int32]
    places: NDArray[np.int32]
    width: int

    def column(self, number: int) -> NDArray[np.int32]:
        """Return the places of one node of all elements, contiguous."""
        return np.ascontiguousarray(self.places[..., number])

    def spread_out(self, values: NDArray[np.float64], fill: float = 0.0) -> NDArray[np.float64]:
        """Return values (E,) in the order of the lanes: (B * width,), with `fill` between."""
        packed = np.full(len(self.element), fill)
        real = self.element >= 0
        packed[real] = values[self.element[real]]
        return packed


def run_blocks(
    indices: NDArray[np.int32], chosen: NDArray[np.int64], width: int
) -> tuple[Blocks, NDArray[np.int64]]:
    """Cover elements with run blocks.

    Parameters
    ----------
    indices : (E, k)
    chosen : (C,)
        The elements to cover.
    width : int

    Returns
    -------
    blocks : Blocks
    rest : (R,)
        Elements that would have left a block too empty.
    """
    # The loop over a million elements is compiled, and loaded only when there is one.
    from openprc.demlat.compiled.covering import cover  # noqa: PLC0415

    nodes = indices[chosen]
    steps = nodes[:, 1:] - nodes[:, :1]
    order = np.lexsort((nodes[:, 0], *steps.T[::-1]))
    chosen = chosen[order]
    # Elements of one shape form a strip.
    new_strip = np.ones(len(chosen), dtype=np.bool_)
    new_strip[1:] = (steps[order[1:]] != steps[order[:-1]]).any(axis=1)
    del steps
    nodes = nodes[order]
    lane = np.full(len(chosen), -1, dtype=np.int32)
    block = np.zeros(len(chosen), dtype=np.int32)
    n_blocks = cover(nodes[:, 0].copy(), new_strip, width, LEAST_FILL * width, block, lane)
    placed = lane >= 0
    element = np.full((n_blocks, width), -1, dtype=np.int32)
    element[block[placed], lane[placed]] = chosen[placed]
    first = np.zeros((n_blocks, indices.shape[1]), dtype=np.int32)
    first[block[placed]] = nodes[placed] - lane[placed, np.newaxis]
    # Tile by tile, so that what one strip has loaded is still near when the next one needs it.
    tiled = np.argsort(first[:, 0] // TILE, kind="stable")
    return Blocks(element[tiled].reshape(-1), first[tiled], width), np.sort(chosen[~placed])


def spread_blocks(indices: NDArray[np.int32], chosen: NDArray[np.int64], width: int) -> Blocks:
    """Cut elements into blocks whose lanes have a place each; the last one is filled up.

    Filling lanes repeat the nodes of an element and have no parameters, so they add zeros.
    """
    count = -(-len(chosen) // width) * width
    element = np.full(count, -1, dtype=np.int32)
    element[: len(chosen)] = chosen
    nodes = np.repeat(indices[chosen[-1:]], count, axis=0).astype(np.int32)
    nodes[: len(chosen)] = indices[chosen]
    places = nodes.reshape(-1, width, indices.shape[1]) if width > 1 else nodes
    return Blocks(element, places, width)


def ensemble_blocks(indices: NDArray[np.int32], chosen: NDArray[np.int64], width: int) -> Blocks:
    """Give every element a block of its own, whose lanes are the scenes of an ensemble.

    They go along the nodes, so that what one element has loaded is in the nearest cache when its
    neighbour needs it.
    """
    nodes = indices[chosen]
    chosen = chosen[np.lexsort((nodes.max(axis=1), nodes.min(axis=1)))]
    return Blocks(
        np.repeat(chosen, width).astype(np.int32), (indices[chosen] * width).astype(np.int32), width
    )
