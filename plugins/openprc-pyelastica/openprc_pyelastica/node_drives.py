"""Actuators as tables: what forces and prescribed motions say at given instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.signal_table import SAMPLE_SLACK, Column, columns_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment


@dataclass(frozen=True, eq=False)
class Drives:
    """Coordinates and what drives them.

    Parameters
    ----------
    at : (C, 2)
        Node and axis of each column.
    columns : C columns
    start : (C,)
        What is added to a column: where a node was whose velocity is prescribed.
    """

    at: NDArray[np.int64]
    columns: Sequence[Column]
    start: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of driven coordinates."""
        return len(self.columns)

    def values(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the columns say: (T, C)."""
        return self._sampled(times, rate=False) + self.start

    def rates(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how fast that changes: (T, C); 0 between the steps of a held signal."""
        return self._sampled(times, rate=True)

    def _sampled(self, times: NDArray[np.float64], *, rate: bool) -> NDArray[np.float64]:
        result = np.zeros((len(times), len(self.columns)))
        for number, column in enumerate(self.columns):
            position = times / column.dt
            last = len(column.coefficients) - 1
            segment = np.clip(np.floor(position + SAMPLE_SLACK), 0, last).astype(np.int64)
            s = np.maximum(position - segment, 0.0)
            rows = column.coefficients[segment]
            for power in range(rows.shape[1] - 1, int(rate) - 1, -1):
                factor = power / column.dt if rate else 1.0
                result[:, number] = result[:, number] * s + factor * rows[:, power]
        return result


def drives_of(experiment: Experiment, *, forces: bool) -> Drives:
    """Return the forces of an experiment, or its prescribed positions and velocities."""
    at: list[tuple[int, int]] = []
    columns: list[Column] = []
    start: list[float] = []
    for actuator in experiment.actuators:
        if (actuator.type == "force") != forces:
            continue
        signal = experiment.signals[actuator.signal]
        integrated = actuator.type == "velocity"
        made = columns_of(signal, integrated=integrated)
        for axis in range(3):
            if not actuator.axes[axis]:
                continue
            at.append((actuator.node, axis))
            columns.append(made[axis if len(made) == 3 else 0])
            origin = experiment.geometry.positions[actuator.node, axis]
            start.append(float(origin) if integrated else 0.0)
    return Drives(np.array(at, dtype=np.int64).reshape(-1, 2), columns, np.array(start))
