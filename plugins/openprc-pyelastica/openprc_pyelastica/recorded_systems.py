"""Which systems of a simulator are recorded, and what they are called."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica.extras import clean_name

#: Blocks hold the memory of all rods once more; they join the systems when these are finalized.
_BLOCK = "MemoryBlock"


@dataclass(frozen=True, eq=False)
class Body:
    """A rod or a rigid body of a simulator.

    Parameters
    ----------
    name : str
    system : object
        Has ``position_collection`` (3, n) and ``velocity_collection`` (3, n).
    first : int
        Number of its first node among all nodes of the recording.
    """

    name: str
    system: Any
    first: int

    @property
    def n_nodes(self) -> int:
        """Number of nodes, 1 for a rigid body."""
        return int(self.system.position_collection.shape[1])

    @property
    def is_rod(self) -> bool:
        """Whether it is divided into elements."""
        return hasattr(self.system, "rest_lengths")

    @property
    def bars(self) -> NDArray[np.int64]:
        """Neighbouring nodes of its elements, counted within the body: (E, 2)."""
        if not self.is_rod:
            return np.zeros((0, 2), dtype=np.int64)
        first = np.arange(len(self.system.rest_lengths), dtype=np.int64)
        # A ring has as many elements as nodes, the last of which leads back to node 0.
        return np.stack([first, (first + 1) % self.n_nodes], axis=1)

    @property
    def corners(self) -> NDArray[np.int64]:
        """Nodes around each vertex between two elements, counted within the body: (V, 3)."""
        count = self.system.kappa.shape[1] if self.is_rod else 0
        first = np.arange(count, dtype=np.int64)
        return np.stack([first, first + 1, first + 2], axis=1) % self.n_nodes

    @property
    def labels(self) -> list[str]:
        """Names of its nodes."""
        return [f"{self.name}:{index}" for index in range(self.n_nodes)]


def is_recordable(system: Any) -> bool:
    """Whether a system has nodes that move: rods and rigid bodies, no planes, no blocks."""
    positions = getattr(system, "position_collection", None)
    moving = getattr(system, "velocity_collection", None)
    return (
        not type(system).__name__.startswith(_BLOCK)
        and isinstance(positions, np.ndarray)
        and isinstance(moving, np.ndarray)
        and positions.ndim == 2
        and positions.shape[0] == 3
    )


def choose(simulator: Any, systems: Any) -> dict[str, Any]:
    """Return the systems to record by name.

    Parameters
    ----------
    simulator : iterable of systems
    systems : None, Ellipsis, a system, an iterable of them, or a mapping of name to system
        Everything that moves when None.

    Raises
    ------
    ConfigError
        Nothing can be recorded, or something that was asked for cannot.
    """
    present = list(simulator)
    if systems is None or systems is Ellipsis:
        chosen = [system for system in present if is_recordable(system)]
        if not chosen:
            kinds = ", ".join(sorted({type(system).__name__ for system in present}))
            raise ConfigError(
                f"the simulator holds {kinds or 'no systems'}: nothing that has moving nodes",
                expected="at least one rod or rigid body",
                fix="append the rods to the simulator before the recorder is attached",
                key="simulator",
            )
        return _named(chosen)
    if isinstance(systems, Mapping):
        named = {clean_name(str(name)): system for name, system in systems.items()}
        if len(named) < len(systems):
            raise ConfigError(
                f"the names {list(map(str, systems))} are not different once cleaned",
                expected="names of letters, digits, '.', '_' and '-'",
                fix="choose other names",
                key="systems",
            )
    else:
        listed = list(systems) if isinstance(systems, Iterable) else [systems]
        named = _named(listed)
    if not named:
        raise ConfigError(
            "systems is empty",
            expected="at least one rod or rigid body",
            fix="leave systems out to record everything that moves",
            key="systems",
        )
    for name, system in named.items():
        if not is_recordable(system):
            raise ConfigError(
                f"{name} is a {type(system).__name__}, which has no moving nodes",
                expected="rods and rigid bodies",
                fix="leave it out of systems",
                key="systems",
            )
        if not any(system is other for other in present):
            raise ConfigError(
                f"{name} is not among the systems of the simulator",
                expected="systems that were appended",
                fix="call simulator.append() first",
                key="systems",
            )
    return named


def _named(systems: Iterable[Any]) -> dict[str, Any]:
    counts: dict[str, int] = {}
    named: dict[str, Any] = {}
    for system in systems:
        stem = "rod" if hasattr(system, "rest_lengths") else type(system).__name__.lower()
        number = counts.get(stem, 0)
        counts[stem] = number + 1
        named[f"{stem}{number}"] = system
    return named


def bodies(named: Mapping[str, Any]) -> tuple[Body, ...]:
    """Number the nodes of all systems, one after the other."""
    made: list[Body] = []
    first = 0
    for name, system in named.items():
        made.append(Body(name, system, first))
        first += made[-1].n_nodes
    return tuple(made)
