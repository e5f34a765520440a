"""Cutting elements into blocks of lanes that can be loaded and stored as vectors.

A *run* block holds elements whose node numbers all advance by one from lane to lane: each of
its ends is one stretch of memory. Lattices and tessellations that are numbered row by row
consist of them almost entirely. The lanes of a block write to different nodes, so nothing
conflicts, and blocks follow one another, so results do not depend on any race. What fits into
no run becomes *spread* blocks (every lane has its own place) or single elements.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: A run block with fewer elements than this share of its lanes costs more than it saves.
LEAST_FILL = 0.4


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
    nodes = indices[chosen].astype(np.int64)
    steps = nodes[:, 1:] - nodes[:, :1]
    order = np.lexsort((nodes[:, 0], *steps.T[::-1]))
    nodes, steps, chosen = nodes[order], steps[order], chosen[order]
    # Elements of one shape form a strip; twins at one place would need the same lane.
    new_strip = np.ones(len(chosen), dtype=bool)
    new_strip[1:] = (steps[1:] != steps[:-1]).any(axis=1)
    element: list[NDArray[np.int32]] = []
    firsts: list[NDArray[np.int64]] = []
    rest: list[int] = []
    bounds = [*np.flatnonzero(new_strip).tolist(), len(chosen)]
    for begin, end in pairwise(bounds):
        at = begin
        while at < end:
            start = nodes[at, 0]
            stop = begin + int(np.searchsorted(nodes[begin:end, 0], start + width))
            lanes = nodes[at:stop, 0] - start
            if len(lanes) < LEAST_FILL * width or (np.diff(lanes) == 0).any():
                rest.append(int(chosen[at]))
                at += 1
                continue
            block = np.full(width, -1, dtype=np.int32)
            block[lanes] = chosen[at:stop]
            element.append(block)
            firsts.append(nodes[at])
            at = stop
    width_of_row = indices.shape[1]
    return Blocks(
        np.concatenate(element) if element else np.zeros(0, np.int32),
        np.array(firsts, dtype=np.int32).reshape(-1, width_of_row),
        width,
    ), np.array(sorted(rest), dtype=np.int64)


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
    """Give every element a block of its own, whose lanes are the scenes of an ensemble."""
    return Blocks(
        np.repeat(chosen, width).astype(np.int32), (indices[chosen] * width).astype(np.int32), width
    )
