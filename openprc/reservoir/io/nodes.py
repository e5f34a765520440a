"""Motion of nodes: positions, displacements, velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, TaskError
from openprc.reservoir.io.recording import Origin, Recording

#: Frames that one-sided differences of second order need.
_FEWEST_FRAMES = 3


class NodeMotion(Recording):
    """The part of `StateLoader` that reads nodes."""

    def positions(self, nodes: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return node positions, (T, n, D) in the unit of the file.

        Raises
        ------
        MissingData
            When the file has no positions, or when samples are missing and `missing` says so.
        TaskError
            When a node number is out of range or named twice.
        """
        # The whole array is read and then selected: HDF5 reads scattered nodes far slower.
        values = np.asarray(self.trajectory.positions(), dtype=np.float64)
        chosen = self.check_ids(nodes, self.n_nodes, what="node")
        return self.treated(values[:, chosen], [f"node {i}" for i in chosen], "nodes/positions")

    def velocities(
        self, nodes: Sequence[int] | None = None, *, derive: bool = False
    ) -> NDArray[np.float64]:
        """Return node velocities, (T, n, D).

        Stored velocities are in the unit of the file.

        Parameters
        ----------
        derive : bool
            Where the file stores none, take central differences of the positions, in their
            unit per second. They look one frame ahead, and their error is
            ``dt^2 / 6`` times the third derivative.

        Raises
        ------
        MissingData
            When the file stores no velocities and `derive` is false; and as `positions`.
        NonUniformTime
            When differences are asked for and the frames are not evenly spaced.
        TaskError
            When differences are asked for, of load steps or of fewer than three frames.
        """
        if self.trajectory.has("/time_series/nodes/velocities"):
            values = np.asarray(self.trajectory.velocities(), dtype=np.float64)
            chosen = self.check_ids(nodes, self.n_nodes, what="node")
            labels = [f"node {i}" for i in chosen]
            return self.treated(values[:, chosen], labels, "nodes/velocities")
        if not derive:
            raise MissingData(
                "the file stores no velocities",
                expected="/time_series/nodes/velocities",
                fix="record them with the producer, or ask for differences of the positions "
                "with derive=True",
                file=self.path,
                key="/time_series/nodes/velocities",
            )
        positions = self.positions(nodes)
        self.require_physical_time("velocity")
        if len(positions) < _FEWEST_FRAMES:
            raise TaskError(
                f"the file has {len(positions)} frames",
                expected=f"{_FEWEST_FRAMES} frames to take differences of",
                fix="record for longer",
                file=self.path,
                key="/time_series/time",
            )
        return np.asarray(np.gradient(positions, self.dt, axis=0, edge_order=2))

    def displacements(
        self, nodes: Sequence[int] | None = None, *, origin: Origin = "auto"
    ) -> NDArray[np.float64]:
        """Return positions less those of the undeformed body, (T, n, D) in the unit of the file.

        Parameters
        ----------
        origin : {"auto", "rest", "first"}
            ``rest`` takes /topology/nodes/rest, ``first`` the first frame; ``auto`` takes the
            rest positions where the file has them and the first frame otherwise.

        Raises
        ------
        MissingData
            As `positions`; with ``rest`` when the file has no rest positions; with ``first``
            when a node was not measured in the first frame.
        """
        positions = self.positions(nodes)
        chosen = self.check_ids(nodes, self.n_nodes, what="node")
        if self.resolve_origin(origin) == "rest":
            return positions - np.asarray(self.trajectory.node("rest"), dtype=np.float64)[chosen]
        if np.isnan(positions[0]).any():
            raise MissingData(
                "the first frame has nodes that were not measured, so displacements have no origin",
                expected="rest positions, or a complete first frame",
                fix="leave those nodes out with node_ids, or use NodePositions",
                file=self.path,
                key="/time_series/nodes/positions",
            )
        return positions - positions[0]

    def resolve_origin(self, origin: Origin) -> Literal["rest", "first"]:
        """Return what ``origin="auto"`` stands for in this file."""
        self.check_origin(origin)
        if origin == "auto":
            return "rest" if self.trajectory.has("/topology/nodes/rest") else "first"
        return origin
