"""A feature: what a readout may see of a trajectory, as a matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class NodeSpeeds:
    """Speed of every node, |dx/dt|, by central differences on the clock of the file.

    Works on a `Trajectory` and on a `StateLoader`. A missing position makes the speed NaN in
    its own frame and in the two beside it; nothing is filled in.
    """

    def transform(self, source: Any) -> NDArray[np.float64]:
        """Return the state matrix, (T, N) [unit of length / unit of time]."""
        positions = np.asarray(source.positions(), dtype=np.float64)
        velocities = np.gradient(positions, np.asarray(source.time), axis=0, edge_order=1)
        speeds: NDArray[np.float64] = np.linalg.norm(velocities, axis=2)
        return speeds

    def names(self, source: Any) -> list[str]:
        """Return the N column names."""
        return [f"speed of node {node}" for node in range(source.n_nodes)]
