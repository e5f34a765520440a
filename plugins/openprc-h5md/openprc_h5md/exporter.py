"""simulation.h5 to H5MD 1.1 (de Buyl et al. 2014, doi:10.1016/j.cpc.2014.01.018)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from openprc.errors import MissingData
from openprc.exporters.rows import Rows, require_positions
from openprc.schema.units import UNITS
from openprc_h5md.unit_names import from_contract, length_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Trajectory

#: Dimension of a velocity, and the unit that readers of molecules know for it.
_SPEED = "m s-1"


class H5mdExporter:
    """Writes particles, their bonds, and every channel and input as an observable.

    Positions are three-dimensional, which MDAnalysis asks for: where there is no z, z is 0.
    A point that is missing in a frame is NaN. Elements other than the bonds, labels and the
    symbols of an input go into ``/parameters/openprc`` as JSON or stay behind.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write every ``options["stride"]``-th frame of `trajectory` to `path`.

        Raises
        ------
        MissingData
            When the trajectory has no positions, or not the elements named as bonds.
        ConfigError
            When the stride is below 1.
        """
        require_positions(trajectory)
        frames = Rows(trajectory.n_frames, options)
        bonds = _bonds(trajectory, str(options["bonds"]))
        with h5py.File(path, "x", libver=("earliest", "v110")) as file:
            _write_envelope(file)
            group = file.create_group("particles/trajectory")
            group.create_group("box").attrs.update(
                {"dimension": np.int32(3), "boundary": np.array([b"none"] * 3)}
            )
            clock = _write_clock(group, trajectory, frames)
            _write_particles(group, trajectory, frames, clock, str(options["unit"]))
            if bonds is not None:
                item = file.create_dataset("connectivity/bonds", data=bonds)
                item.attrs["particles_group"] = group.ref
            _write_observables(file, trajectory, frames, clock)
            _write_parameters(file, trajectory)
        return [path]


def _bonds(trajectory: Trajectory, kind: str) -> NDArray[np.int32] | None:
    if kind in trajectory.element_kinds and trajectory.indices(kind).shape[1] == 2:
        return trajectory.indices(kind)
    if kind == "bars":  # the default: a body need not have any
        return None
    pairs = [k for k in trajectory.element_kinds if trajectory.indices(k).shape[1] == 2]
    raise MissingData(
        f"there are no two-node elements named {kind!r}",
        expected="one of " + (", ".join(pairs) or "none: the trajectory has no such elements"),
        fix="correct the option bonds, or leave it out",
        file=trajectory.path,
        key=f"/topology/{kind}/indices",
    )


def _write_envelope(file: h5py.File) -> None:
    head = file.create_group("h5md")
    head.attrs["version"] = np.array([1, 1], dtype="i4")
    head.create_group("author").attrs["name"] = "unknown"
    creator = head.create_group("creator")
    creator.attrs["name"] = "openprc-h5md"
    creator.attrs["version"] = version("openprc-h5md")
    head.create_group("modules/units").attrs.update(
        {"version": np.array([1, 0], dtype="i4"), "system": "SI"}
    )


def _write_clock(
    group: h5py.Group, trajectory: Trajectory, frames: Rows
) -> dict[str, h5py.Dataset]:
    """Write step and time once; every element links to them."""
    home = group.create_group("position")
    step = np.arange(0, trajectory.n_frames, frames.stride, dtype="i8")
    physical = trajectory.time_kind == "physical"
    factor = UNITS[trajectory.time_unit].si_factor if physical else 1.0
    time = home.create_dataset("time", data=trajectory.time[frames.all()] * factor)
    if physical:
        time.attrs["unit"] = "s"
    return {"step": home.create_dataset("step", data=step), "time": time}


def _write_particles(
    group: h5py.Group, trajectory: Trajectory, frames: Rows, clock: dict[str, h5py.Dataset],
    wanted: str,
) -> None:  # fmt: skip
    stored = trajectory.position_unit
    known = UNITS[stored].dimension == "length" and wanted != "stored"
    factor = length_factor(stored, wanted) if known else 1.0
    shape = (len(frames), trajectory.n_nodes, 3)
    place = group["position"].create_dataset("value", shape, "f8", chunks=_chunks(shape))
    if known or UNITS[stored].dimension == "length":
        place.attrs["unit"] = wanted if known else stored
    speed, slow = None, 1.0
    if trajectory.has("/time_series/nodes/velocities"):
        home = group.create_group("velocity")
        for name, item in clock.items():
            home[name] = item
        speed = home.create_dataset("value", shape, "f8", chunks=_chunks(shape))
        unit = UNITS[trajectory.unit("/time_series/nodes/velocities")]
        if unit.dimension == "velocity":
            speed.attrs["unit"], slow = _SPEED, unit.si_factor
    start = 0
    for rows in frames.blocks():
        values = trajectory.positions(rows)
        stop = start + len(values)
        place[start:stop] = _in_space(values) * factor
        if speed is not None:
            speed[start:stop] = _in_space(trajectory.velocities(rows)) * slow
        start = stop
    n_nodes = trajectory.n_nodes
    numbers = trajectory.node("id") if trajectory.has("/topology/nodes/id") else None
    group["id"] = np.arange(n_nodes) if numbers is None else numbers
    group["species"] = np.zeros(n_nodes, "i4")
    if trajectory.has("/topology/nodes/mass"):
        group["mass"] = trajectory.node("mass")
        group["mass"].attrs["unit"] = trajectory.unit("/topology/nodes/mass")


def _chunks(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return chunks of whole frames of about a megabyte."""
    return (max(1, min(shape[0], 40_000 // max(1, shape[1]))), max(1, shape[1]), 3)


def _in_space(values: NDArray[np.float64]) -> NDArray[np.float64]:
    if values.shape[2] == 3:
        return values
    flat = np.zeros((*values.shape[:2], 3))
    flat[..., : values.shape[2]] = values
    # A point that is missing is missing in z, too.
    flat[..., 2][np.isnan(values).any(axis=2)] = np.nan
    return flat


def _write_observables(
    file: h5py.File, trajectory: Trajectory, frames: Rows, clock: dict[str, h5py.Dataset]
) -> None:
    series = {name: trajectory.input(name) for name in trajectory.inputs}
    rows = frames.all()
    found = [
        *(
            (f"channels/{name}", trajectory.channel(name, frames=rows),
             trajectory.unit(f"/time_series/channels/{name}"), trajectory.channel_columns(name))
            for name in trajectory.channels
        ),
        *((f"inputs/{name}", s.value[rows], s.unit, s.columns) for name, s in series.items()),
        *(
            (f"system/{name}", trajectory.system(name)[rows],
             trajectory.unit(f"/time_series/system/{name}"), ())
            for name in trajectory.systems
        ),
    ]  # fmt: skip
    for name, values, unit, columns in found:
        home = file.create_group(f"observables/{name}")
        for part, item in clock.items():
            home[part] = item
        data = home.create_dataset("value", data=values)
        data.attrs["unit"] = from_contract(unit)
        if columns:
            data.attrs["columns"] = list(columns)


def _write_parameters(file: h5py.File, trajectory: Trajectory) -> None:
    """Keep what a reader of this package can use and H5MD has no word for."""
    told: dict[str, Any] = {
        "dims": trajectory.dims,
        "position_unit": trajectory.position_unit,
        "time_kind": trajectory.time_kind,
        "time_unit": trajectory.time_unit,
        "run_id": trajectory.run_id,
    }
    if trajectory.has("/topology/nodes/label"):
        told["labels"] = [str(label) for label in trajectory.node("label")]
    if trajectory.has("/topology/nodes/fixed"):
        told["fixed"] = [int(flag) for flag in trajectory.node("fixed")]
    file.create_group("parameters/openprc").attrs["run"] = json.dumps(told, sort_keys=True)
