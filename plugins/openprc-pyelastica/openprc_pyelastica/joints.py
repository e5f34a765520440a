"""Joints between systems, read off a simulator before it forgets them.

PyElastica's joints are penalty springs: the two nodes that they join stay different and a small
distance apart. They are recorded as bars of rest length 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from openprc_pyelastica.recorded_systems import Body


@dataclass(frozen=True)
class Joint:
    """Two nodes of the recording that a joint ties, and the class of the joint."""

    nodes: tuple[int, int]
    kind: str


def find(simulator: Any, bodies: Iterable[Body]) -> tuple[list[Joint], list[str]]:
    """Return the joints among `bodies`, and remarks about those that are left out.

    To be called before or while the simulator is finalized, which empties its list.
    """
    found: list[Joint] = []
    notes: list[str] = []
    by_system = {id(body.system): body for body in bodies}
    for connection in getattr(simulator, "_connections", ()):
        one, two, first, second = connection.id()
        kind = getattr(getattr(connection, "_connect_cls", None), "__name__", "connection")
        ends = (by_system.get(id(simulator[one])), by_system.get(id(simulator[two])))
        if ends[0] is None or ends[1] is None:
            notes.append(f"a {kind} to a system that is not recorded was left out")
            continue
        pairs = list(_pairs(first, second))
        if not pairs:
            notes.append(f"a {kind} between {ends[0].name} and {ends[1].name} names no nodes")
        for a, b in pairs:
            nodes = (_node(ends[0], a), _node(ends[1], b))
            if nodes[0] == nodes[1]:
                notes.append(f"a {kind} ties node {ends[0].labels[a]} to itself; left out")
            else:
                found.append(Joint(nodes, kind))
    return found, notes


def _pairs(first: Any, second: Any) -> Iterator[tuple[int, int]]:
    if isinstance(first, int | np.integer):
        yield int(first), int(second)
        return
    ends: tuple[Sequence[Any], Sequence[Any]] = (list(first), list(second))
    for a, b in zip(*ends, strict=False):
        yield int(a), int(b)


def _node(body: Body, index: int) -> int:
    # Negative numbers count from the end, as they do in the simulator.
    return body.first + index % body.n_nodes
