"""Chains of bars in a geometry: which nodes follow each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.geometry import Geometry


@dataclass(frozen=True, eq=False)
class Chain:
    """Nodes that bars join one after the other.

    Parameters
    ----------
    nodes : (n + 1,)
        Numbers of the nodes, from the end with the smaller number.
    bars : (n,)
        Numbers of the bars between them.
    bend : (n - 1,) [N*m/rad]
        Stiffness of the bends at the inner nodes, 0 where there is none.
    """

    nodes: NDArray[np.int64]
    bars: NDArray[np.int64]
    bend: NDArray[np.float64]

    @property
    def n_elements(self) -> int:
        """Number of bars."""
        return len(self.bars)


@dataclass(frozen=True)
class Sorted:
    """What became of the nodes and bars of a geometry.

    Parameters
    ----------
    chains : tuple of Chain
    lone : tuple of int
        Nodes without a bar.
    branches : tuple of int
        Nodes with three or more bars.
    loop : int, optional
        A node of a closed loop.
    strays : tuple of int
        Bends whose three nodes do not follow each other in a chain.
    """

    chains: tuple[Chain, ...]
    lone: tuple[int, ...]
    branches: tuple[int, ...]
    loop: int | None
    strays: tuple[int, ...]


def sort_chains(geometry: Geometry) -> Sorted:
    """Take the bars of `geometry` apart into chains, as far as they are chains."""
    neighbours: list[list[tuple[int, int]]] = [[] for _ in range(geometry.n_nodes)]
    for bar, (a, b) in enumerate(geometry.bars.indices.tolist()):
        neighbours[a].append((b, bar))
        neighbours[b].append((a, bar))
    lone = tuple(node for node, others in enumerate(neighbours) if not others)
    branches = tuple(node for node, others in enumerate(neighbours) if len(others) > 2)
    if branches:
        return Sorted((), lone, branches, None, ())
    seen = np.zeros(geometry.n_nodes, dtype=bool)
    walks: list[tuple[list[int], list[int]]] = []
    for start, others in enumerate(neighbours):
        if len(others) == 1 and not seen[start]:
            walks.append(_walk(start, neighbours))
            seen[walks[-1][0]] = True
    left = [node for node, others in enumerate(neighbours) if others and not seen[node]]
    if left:
        return Sorted((), lone, (), left[0], ())
    bends, strays = _bends(geometry, walks)
    chains = tuple(
        Chain(np.array(nodes), np.array(bars), stiffness)
        for (nodes, bars), stiffness in zip(walks, bends, strict=True)
    )
    return Sorted(chains, lone, (), None, strays)


def _walk(start: int, neighbours: list[list[tuple[int, int]]]) -> tuple[list[int], list[int]]:
    nodes, bars = [start], []
    while True:
        onward = [step for step in neighbours[nodes[-1]] if not bars or step[1] != bars[-1]]
        if not onward:
            return nodes, bars
        nodes.append(onward[0][0])
        bars.append(onward[0][1])


def _bends(
    geometry: Geometry, walks: list[tuple[list[int], list[int]]]
) -> tuple[list[NDArray[np.float64]], tuple[int, ...]]:
    places = {
        tuple(nodes[i : i + 3]): (chain, i)
        for chain, (nodes, _) in enumerate(walks)
        for i in range(len(nodes) - 2)
    }
    stiffness = [np.zeros(max(0, len(nodes) - 2)) for nodes, _ in walks]
    strays = []
    for bend, corners in enumerate(geometry.bends.indices.tolist()):
        place = places.get(tuple(corners)) or places.get(tuple(reversed(corners)))
        if place is None:
            strays.append(bend)
        else:
            stiffness[place[0]][place[1]] += geometry.bends.stiffness[bend]
    return stiffness, tuple(strays)
