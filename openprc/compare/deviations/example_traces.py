"""A few points of the worst node in both files, for pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.paired_frames import PairedFrames

    Reals = NDArray[np.float64]

#: Points of a trace.
POINTS = 2000
#: Numbers that an overview of all nodes may hold before the pass says which is the worst.
HELD = 1 << 22


@dataclass(frozen=True)
class Trace:
    """Motion of one node in both files.

    Parameters
    ----------
    kind : {"whole", "detail"}
        Evenly chosen instants of the whole comparison, or consecutive ones around the largest
        deviation.
    node : str
    times : (P,)
    reference, other : (P, d) [unit of the comparison]
        Displacement from the reference's place at the first common instant.
    every : int
        Instants from one point to the next.
    """

    kind: str
    node: str
    times: Reals
    reference: Reals
    other: Reals
    every: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            "kind": self.kind,
            "node": self.node,
            "times": self.times.tolist(),
            "reference": self.reference.tolist(),
            "other": self.other.tolist(),
            "every": self.every,
        }


class Overview:
    """Keeps every so-many-th instant of all nodes as they go by, as far as memory allows."""

    def __init__(self, pair: PairedFrames) -> None:
        self._pair = pair
        self.every = -(-len(pair) // POINTS)
        self.count = -(-len(pair) // self.every)
        size = self.count * pair.n_nodes * pair.dims
        self._kept: tuple[list[Reals], list[Reals]] | None = ([], []) if size <= HELD else None

    def add(self, first: int, x: Reals, y: Reals) -> None:
        """Add instants from `first` on."""
        if self._kept is None:
            return
        skip = -first % self.every
        for kept, block in zip(self._kept, (x, y), strict=True):
            if skip < len(block):
                kept.append(block[skip :: self.every].copy())

    def of(self, node: int) -> tuple[Reals, Reals]:
        """Return the places of a node in both files: (P, d) each; read again if need be."""
        if self._kept is not None:
            first, second = (np.concatenate(kept)[:, node] for kept in self._kept)
            return first, second
        rows = [self._pair.rows(k, k + 1) for k in range(0, len(self._pair), self.every)]
        return np.stack([x[0, node] for x, _ in rows]), np.stack([y[0, node] for _, y in rows])


def worst_traces(
    pair: PairedFrames, overview: Overview, *, node: int, sample: int, label: str
) -> tuple[Trace, ...]:
    """Return the whole motion of a node, and the part around an instant where that is longer.

    Parameters
    ----------
    pair : PairedFrames
    overview : Overview
    node, sample : int
        Of the largest deviation.
    label : str
    """
    x, y = overview.of(node)
    seen = np.flatnonzero(np.isfinite(x).all(axis=1))
    origin = x[seen[0]] if len(seen) else np.zeros(pair.dims)
    times = pair.clock.times[:: overview.every]
    traces = [Trace("whole", label, times, x - origin, y - origin, overview.every)]
    if overview.every > 1:
        low = max(0, min(sample - POINTS // 2, len(pair) - POINTS))
        high = min(len(pair), low + POINTS)
        parts = [(a[:, node].copy(), b[:, node].copy()) for _, a, b in pair.blocks(low, high)]
        x, y = (np.concatenate(side) for side in zip(*parts, strict=True))
        times = pair.clock.times[low:high]
        traces.append(Trace("detail", label, times, x - origin, y - origin, 1))
    return tuple(traces)


__all__ = ["Overview", "Trace", "worst_traces"]
