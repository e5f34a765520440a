"""simulation.h5 to CSV."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.exporters.rows import Rows

if TYPE_CHECKING:
    from openprc.schema import Trajectory


class CsvExporter:
    """One header line and one row a frame, every number as text that reads back as the same one.

    Time, positions, the marks of filled-in points, channels and inputs go into the table.
    Velocities, elements, whole-body quantities, the topology and the input symbols have no
    place in it and stay behind; the exporter ``npz`` takes them all.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write every ``options["stride"]``-th frame of `trajectory` to `path`.

        Raises
        ------
        ConfigError
            When the stride is not at least 1.
        """
        frames = Rows(trajectory.n_frames, options)
        filled = _has_filled(trajectory)
        with path.open("x", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream, lineterminator="\n")
            table.writerow(_header(trajectory, filled=filled))
            for rows in frames.blocks():
                block = _block(trajectory, rows, filled=filled)
                # repr() of a float is the shortest text that reads back as the same one.
                table.writerows([repr(value) for value in row] for row in block.tolist())
        return [path]


def _has_filled(trajectory: Trajectory) -> bool:
    path = "/time_series/nodes/observed"
    return trajectory.has(path) and bool((trajectory.observed() == 2).any())


def _node_ids(trajectory: Trajectory) -> list[int]:
    if trajectory.has("/topology/nodes/id"):
        return [int(number) for number in trajectory.node("id")]
    return list(range(trajectory.n_nodes))


def _header(trajectory: Trajectory, *, filled: bool) -> list[str]:
    cells = [f"t [{trajectory.time_unit}]"]
    if trajectory.dims:
        ids, unit = _node_ids(trajectory), trajectory.position_unit
        cells += [f"{axis}{n} [{unit}]" for n in ids for axis in "xyz"[: trajectory.dims]]
        cells += [f"seen{n}" for n in ids if filled]
    for name in trajectory.channels:
        unit = trajectory.unit(f"/time_series/channels/{name}")
        cells += [f"{name}/{c} [{unit}]" for c in trajectory.channel_columns(name)]
    for name in trajectory.inputs:
        signal = trajectory.input(name)
        cells += [f"input/{name}/{c} [{signal.unit}]" for c in signal.columns]
    return cells


def _block(trajectory: Trajectory, rows: slice, *, filled: bool) -> NDArray[np.float64]:
    parts = [trajectory.time[rows, np.newaxis]]
    if trajectory.dims:
        places = trajectory.positions(rows)
        parts.append(places.reshape(len(places), -1))
    if filled:
        parts.append(trajectory.observed(rows).astype(np.float64))
    parts += [trajectory.channel(name, frames=rows) for name in trajectory.channels]
    parts += [trajectory.input(name).value[rows] for name in trajectory.inputs]
    return np.concatenate(parts, axis=1)
