"""What is read off a body while it is stepped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.tables import FrameBuffer
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]
    Reader = Callable[["FrameBuffer", int], Reals]

Quantity = Literal[
    "positions",
    "displacements",
    "velocities",
    "bar_lengths",
    "bar_extensions",
    "bar_strains",
    "hinge_angles",
    "bend_angles",
]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
_AXES = "xyz"


@dataclass(frozen=True)
class Sensors:
    """A quantity of some nodes, bars, hinges or bends.

    Columns have the names and the order of the features of `openprc.reservoir` that read the
    same from a file, so that a readout which was trained on a recording fits.

    Parameters
    ----------
    quantity : str
        "positions" [m], "displacements" [m] from the geometry, "velocities" [m/s],
        "bar_lengths" [m], "bar_extensions" [m] beyond the unstressed lengths, "bar_strains"
        relative to these, "hinge_angles" or "bend_angles" [rad].
    ids : sequence of int, optional
        Nodes, bars, hinges or bends; all by default.
    axes : str
        Of quantities of nodes: some of "xyz".
    """

    quantity: Quantity
    ids: Sequence[int] | None = None
    axes: str = "xyz"

    def chosen(self, experiment: Experiment) -> NDArray[np.int64]:
        """Return the numbers of what is read.

        Raises
        ------
        ConfigError
            When there is no such quantity, axis, node or element.
        """
        if self.quantity not in QUANTITIES:
            raise ConfigError(
                f"sensors of {self.quantity!r}",
                expected="one of " + ", ".join(QUANTITIES),
                key="sensors.quantity",
            )
        if not self.axes or not set(self.axes) <= set(_AXES):
            raise ConfigError(
                f"the axes {self.axes!r}", expected="some of 'xyz'", key="sensors.axes"
            )
        geometry = experiment.geometry
        what = self._kind
        count = {
            "node": geometry.n_nodes,
            "bar": len(geometry.bars),
            "hinge": len(geometry.hinges),
            "bend": len(geometry.bends),
        }[what]
        ids = np.arange(count) if self.ids is None else np.atleast_1d(np.asarray(self.ids))
        if ids.ndim != 1 or not len(ids) or ids.dtype.kind not in "iu":
            raise ConfigError(
                f"sensors on no {what}",
                expected=f"numbers of {what}s, at least one",
                key="sensors.ids",
            )
        bad = ids[(ids < 0) | (ids >= count)]
        if len(bad):
            raise ConfigError(
                f"{what} {bad[0]} of {count}",
                expected=f"0 to {count - 1}",
                key="sensors.ids",
            )
        return ids.astype(np.int64)

    def names(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the name of every column."""
        ids = self.chosen(experiment)
        if self._kind == "node":
            prefix = "v" if self.quantity == "velocities" else ""
            return tuple(f"node{n}.{prefix}{axis}" for n in ids for axis in self.axes)
        suffix = {
            "bar_extensions": ".extension",
            "bar_strains": ".strain",
            "bend_angles": ".angle",
        }.get(self.quantity, "")
        return tuple(f"{self._kind}{e}{suffix}" for e in ids)

    def reader(self, experiment: Experiment, reference: Reals) -> Reader:
        """Return a function that reads the columns from a row of a frame buffer.

        Parameters
        ----------
        experiment : Experiment
        reference : (N, dims) [m]
            What the positions in the buffer are counted from.
        """
        ids, geometry = self.chosen(experiment), experiment.geometry
        if self._kind == "node":
            axes = np.array([_AXES.index(axis) for axis in self.axes])
            dims = reference.shape[1]
            offset = np.zeros((len(ids), 3))
            if self.quantity != "velocities":
                offset[:, :dims] = reference[ids]
            if self.quantity == "displacements":
                offset -= geometry.positions[ids]
            moving = axes < dims  # a planar scene has no third coordinate; it stays 0
            column = "v" if self.quantity == "velocities" else "x"
            nodes, start = ids[:, np.newaxis], offset[:, axes]

            def read_nodes(buffer: FrameBuffer, row: int) -> Reals:
                values = start.copy()
                values[:, moving] += getattr(buffer, column)[row][nodes, axes[moving]]
                return values.reshape(-1)

            return read_nodes
        name = {"bar": "length", "hinge": "angle", "bend": "bend_angle"}[self._kind]
        rest, unit = np.zeros(len(ids)), np.ones(len(ids))
        if self.quantity in ("bar_extensions", "bar_strains"):
            rest = geometry.bars.rest_length[ids]
        if self.quantity == "bar_strains":
            unit = rest

        def read_elements(buffer: FrameBuffer, row: int) -> Reals:
            values: Reals = (getattr(buffer, name)[row][ids] - rest) / unit
            return values

        return read_elements

    @property
    def _kind(self) -> str:
        for prefix in ("bar", "hinge", "bend"):
            if self.quantity.startswith(prefix):
                return prefix
        return "node"
