"""simulation.h5 to CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ResultExists

if TYPE_CHECKING:
    from openprc.schema import Trajectory

_BLOCK = 1024


class CsvExporter:
    """Writes what `openprc_example.importer.CsvImporter` reads, number for number.

    Time, positions, the marks of filled-in points, channels and inputs go into the table.
    Velocities, elements, whole-body quantities, the topology and the input symbols have no
    place in it and stay behind.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write `trajectory` to `path`; return the one file made.

        Raises
        ------
        ResultExists
            When `path` exists.
        """
        del options
        path = Path(path)
        if path.exists():
            raise ResultExists(
                "a file of this name exists",
                expected="a new name",
                fix="choose another name, or delete it",
                file=path,
            )
        partial = path.with_name(path.name + ".partial")
        filled = _has_filled(trajectory)
        try:
            # "x": another export of the same name must not be written into.
            with partial.open("x", newline="", encoding="utf-8") as stream:
                table = csv.writer(stream, lineterminator="\n")
                table.writerow(_header(trajectory, filled=filled))
                for block in _blocks(trajectory, filled=filled):
                    # repr() of a float is the shortest text that reads back as the same one.
                    table.writerows([repr(value) for value in row] for row in block.tolist())
            partial.replace(path)
        except FileExistsError:
            raise ResultExists(
                "an unfinished export of this name is in the way",
                expected="no such file",
                fix="delete it",
                file=partial,
            ) from None
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
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


def _blocks(trajectory: Trajectory, *, filled: bool) -> Iterator[NDArray[np.float64]]:
    inputs = [trajectory.input(name).value for name in trajectory.inputs]
    channels = [trajectory.channel(name) for name in trajectory.channels]
    for start in range(0, trajectory.n_frames, _BLOCK):
        rows = slice(start, min(start + _BLOCK, trajectory.n_frames))
        parts = [trajectory.time[rows, np.newaxis]]
        if trajectory.dims:
            places = trajectory.positions(rows)
            parts.append(places.reshape(len(places), -1))
        if filled:
            parts.append(trajectory.observed(rows).astype(np.float64))
        parts += [values[rows] for values in channels + inputs]
        yield np.concatenate(parts, axis=1)
