"""Coordinates of nodes as reservoir states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import Feature
from openprc.reservoir.io.state_loader import Origin, StateLoader

_AXES = "xyz"


class _NodeFeature(Feature):
    """Selection of nodes and coordinates, and motion relative to one node."""

    #: Before the name of a coordinate, where it is not the coordinate itself.
    _prefix = ""

    def __init__(
        self,
        node_ids: Sequence[int] | None = None,
        dims: Sequence[int] | None = None,
        *,
        reference_node: int | None = None,
    ) -> None:
        self.node_ids = node_ids
        self.dims = dims
        self.reference_node = reference_node

    def _read(self, loader: StateLoader, nodes: list[int]) -> NDArray[np.float64]:
        raise NotImplementedError

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        nodes = loader.check_ids(self.node_ids, loader.n_nodes, what="node")
        dims = self._dims(loader)
        values = self._read(loader, nodes)
        if self.reference_node is not None:
            (reference,) = loader.check_ids(
                [self.reference_node], loader.n_nodes, what="node", key="reference_node"
            )
            values = values - self._read(loader, [reference])
        return np.ascontiguousarray(values[:, :, dims]).reshape(len(values), -1)

    def _names(self, loader: StateLoader) -> list[str]:
        nodes = loader.check_ids(self.node_ids, loader.n_nodes, what="node")
        return [f"node{n}.{self._prefix}{_AXES[d]}" for n in nodes for d in self._dims(loader)]

    def _dims(self, loader: StateLoader) -> list[int]:
        if self.dims is None:
            return list(range(loader.dims))
        dims = np.atleast_1d(np.asarray(self.dims)).tolist()
        if loader.dims and not (dims and set(dims) <= set(range(loader.dims))):
            raise TaskError(
                f"dims is {dims} and the file has {loader.dims} coordinates",
                expected=f"coordinates from 0 to {loader.dims - 1}",
                fix="choose coordinates that were measured",
                file=loader.path,
                key="dims",
            )
        return dims


class NodePositions(_NodeFeature):
    """Positions of nodes; columns run over coordinates first, then nodes.

    Parameters
    ----------
    node_ids : sequence of int, optional
        Which nodes, from 0; all by default.
    dims : sequence of int, optional
        Which coordinates, 0 for x; all that were measured by default.
    reference_node : int, optional
        A node whose position is subtracted, so that a shaken frame drops out.
    """

    def _read(self, loader: StateLoader, nodes: list[int]) -> NDArray[np.float64]:
        return loader.positions(nodes)


class NodeDisplacements(_NodeFeature):
    """Displacements of nodes from the undeformed body; columns as in `NodePositions`.

    Parameters
    ----------
    node_ids, dims : as for `NodePositions`
    reference_node : int, optional
        A node whose displacement is subtracted. Its own columns become constant zeros, which
        the trainer reports.
    origin : {"auto", "rest", "first"}
        Rest positions where the file has them and the first frame otherwise, or one of the two.
        A readout that centres its states gives the same prediction for either.
    """

    def __init__(
        self,
        node_ids: Sequence[int] | None = None,
        dims: Sequence[int] | None = None,
        *,
        reference_node: int | None = None,
        origin: Origin = "auto",
    ) -> None:
        super().__init__(node_ids, dims, reference_node=reference_node)
        self.origin = origin

    def _read(self, loader: StateLoader, nodes: list[int]) -> NDArray[np.float64]:
        return loader.displacements(nodes, origin=self.origin)


class NodeVelocities(_NodeFeature):
    """Velocities of nodes; columns as in `NodePositions`, named such as ``"node3.vz"``.

    Parameters
    ----------
    node_ids, dims : as for `NodePositions`
    reference_node : int, optional
        A node whose velocity is subtracted.
    derive : bool
        Take central differences of the positions where the file stores no velocities; they look
        one frame ahead. By default such a file is refused.
    """

    _prefix = "v"

    def __init__(
        self,
        node_ids: Sequence[int] | None = None,
        dims: Sequence[int] | None = None,
        *,
        reference_node: int | None = None,
        derive: bool = False,
    ) -> None:
        super().__init__(node_ids, dims, reference_node=reference_node)
        self.derive = derive

    def _read(self, loader: StateLoader, nodes: list[int]) -> NDArray[np.float64]:
        return loader.velocities(nodes, derive=self.derive)
