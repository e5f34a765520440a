"""The outline of any file of the package: what `openprc info` prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from openprc.schema.damage import damage_named
from openprc.schema.results import read_result
from openprc.schema.safety import open_hdf5
from openprc.schema.trajectory import Trajectory


def describe(path: str | Path) -> dict[str, Any]:
    """Return the outline of a file as plain values; of foreign HDF5, what is in it.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When the file cannot be opened.
    SchemaError
        When it is a file of the contract that breaks it.
    """
    path = Path(path)
    with open_hdf5(path, allow_references=True, allow_vlen=True) as file, damage_named(path):
        kind = str(file.attrs.get("kind", "")) if "openprc_schema" in file.attrs else ""
    if kind == "trajectory":
        with damage_named(path), Trajectory(path, allow_incomplete=True) as trajectory:
            return _trajectory(trajectory)
    if kind in ("readout", "metrics", "optimization"):
        result = read_result(path)
        return {
            "path": str(path),
            "kind": result.kind,
            "run_id": result.run_id,
            "attributes": dict(result.attrs),
            "arrays": {name: list(array.shape) for name, array in result.arrays.items()},
            "provenance": dict(result.provenance),
        }
    return _foreign(path, kind)


def _foreign(path: Path, kind: str) -> dict[str, Any]:
    """Outline HDF5 that is none of the package's results: names, shapes and types."""
    datasets: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = f"{item.shape} {item.dtype}"

    with open_hdf5(path, allow_references=True, allow_vlen=True) as file, damage_named(path):
        attributes = {name: str(value) for name, value in file.attrs.items()}
        file.visititems(visit)
    return {
        "path": str(path),
        "kind": kind or "HDF5 of another program; `openprc import` may read it",
        "attributes": attributes,
        "datasets": datasets,
    }


def _trajectory(trajectory: Trajectory) -> dict[str, Any]:
    time = trajectory.time
    clock: dict[str, Any] = {
        "kind": trajectory.time_kind,
        "unit": trajectory.time_unit,
        "start": float(time[0]) if len(time) else None,
        "end": float(time[-1]) if len(time) else None,
        "uniform": trajectory.uniform,
    }
    if trajectory.uniform:
        clock["dt"] = trajectory.dt
    outline: dict[str, Any] = {
        "path": str(trajectory.path),
        "kind": "trajectory",
        "status": trajectory.status,
        "run_id": trajectory.run_id,
        "created": trajectory.created,
        "n_frames": trajectory.n_frames,
        "n_nodes": trajectory.n_nodes,
        "dims": trajectory.dims,
        "time": clock,
        "elements": {
            kind: {
                "count": len(trajectory.indices(kind)),
                "series": list(trajectory.element_series(kind)),
            }
            for kind in trajectory.element_kinds
        },
        "channels": {name: list(trajectory.channel_columns(name)) for name in trajectory.channels},
        "system": list(trajectory.systems),
        "inputs": {name: _input(trajectory, name) for name in trajectory.inputs},
        "provenance": trajectory.provenance,
    }
    if trajectory.dims:
        outline["positions"] = _positions(trajectory)
    return outline


def _positions(trajectory: Trajectory) -> dict[str, Any]:
    unit = trajectory.position_unit
    found: dict[str, Any] = {"unit": unit}
    if trajectory.n_frames == 0:
        return found
    positions = trajectory.positions()
    found["missing"] = int(np.isnan(positions[..., 0]).sum())
    if np.isfinite(positions).any():
        span = np.nanmax(positions, axis=(0, 1)) - np.nanmin(positions, axis=(0, 1))
        found["extent"] = [float(value) for value in span]
    moving = np.ptp(positions, axis=0).max(axis=1)
    found["moving_nodes"] = int((moving > 0).sum() + np.isnan(moving).sum())
    return found


def _input(trajectory: Trajectory, name: str) -> dict[str, Any]:
    signal = trajectory.input(name)
    found: dict[str, Any] = {
        "quantity": signal.quantity,
        "unit": signal.unit,
        "columns": list(signal.columns),
        "targets": list(signal.targets),
    }
    if signal.sequence is not None:
        found.update({"symbols": len(signal.sequence), "hold": signal.hold, "start": signal.start})
    return found
