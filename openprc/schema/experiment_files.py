"""geometry.h5, signals.h5 and config.json: reading both layouts, writing the present one.

Layout of geometry.h5: root attributes ``openprc_schema`` "1.0" and ``kind`` "geometry";
``nodes/{positions, masses, fixed, collidable?, velocities?, label?}``,
``elements/bars/{indices, stiffness, rest_length, damping, prestress, rigid, law?,
stiffness_cubic?, damping_cubic?}``, ``elements/hinges/{indices, stiffness, rest_angle,
damping, rigid, law?, limit_low?, limit_high?}``, ``elements/bends/{indices, stiffness,
rest_angle?, damping?}``, ``elements/faces/indices``. Layout of signals.h5: ``signals/<name>``
with the attributes ``dt``, ``unit`` and ``interpolation``, and ``sequences/<name>`` with the
attribute ``hold`` where symbols were interpolated. The older layout is described in
`openprc.schema.experiment_legacy`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from openprc.errors import ConfigError, UnreadableFile
from openprc.schema import experiment_legacy
from openprc.schema.atomic import publish
from openprc.schema.experiment import (
    ACTUATOR_UNITS,
    AUTO,
    DEFAULT_INTEGRATOR,
    Actuator,
    Collision,
    Experiment,
    Signal,
    Stored,
)
from openprc.schema.experiment_checks import check_experiment
from openprc.schema.experiment_reader import (
    SCHEMA,
    DatasetReader,
    is_new_layout,
    read_number,
    read_text,
)
from openprc.schema.geometry import FULL_TURN, Bars, Bends, Geometry, Hinges
from openprc.schema.safety import open_hdf5
from openprc.schema.units import UNITS, conversion_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.config_sections import Config

NAMES = ("geometry.h5", "signals.h5", "config.json")
BAR_UNITS = {"stiffness": "N/m", "rest_length": "m", "damping": "N*s/m", "prestress": "1"}
HINGE_UNITS = {"stiffness": "N*m/rad", "rest_angle": "rad", "damping": "N*m*s/rad"}
BEND_UNITS = HINGE_UNITS
#: Columns that are written only where they say something, with the value that says nothing.
SPECIAL_UNITS = {
    "bars": {"stiffness_cubic": ("N/m3", 0.0), "damping_cubic": ("N*s3/m3", 0.0)},
    "hinges": {"limit_low": ("rad", 0.0), "limit_high": ("rad", FULL_TURN)},
    "bends": {},
}


# --- finding ------------------------------------------------------------------------------


def input_folder(directory: str | Path) -> Path:
    """Return the folder with the input files, given the experiment folder or itself.

    Raises
    ------
    UnreadableFile
        When neither holds a geometry.h5 and a config.json.
    """
    path = Path(directory)
    for folder in (path / "input", path):
        if (folder / "geometry.h5").is_file() or (folder / "config.json").is_file():
            return folder
    raise UnreadableFile(
        "there is no experiment here" if path.is_dir() else "the folder does not exist",
        expected="a folder with input/geometry.h5 and input/config.json",
        fix="make one with openprc.demlat.SimulationSetup, or check the path",
        file=path,
    )


# --- reading ------------------------------------------------------------------------------


def read_experiment(directory: str | Path) -> Experiment:
    """See `openprc.schema.experiment.load_experiment`."""
    from openprc.schema.config import load_config  # noqa: PLC0415  pydantic only when needed

    folder = input_folder(directory)
    geometry_file, signals_file, config_file = (folder / name for name in NAMES)
    config, legacy_config = load_config(config_file)
    notes: list[str] = []
    geometry, legacy_geometry = _read_geometry(geometry_file, config, notes)
    sources = [geometry_file, config_file]
    signals: dict[str, Signal] = {}
    # Without actuators there is nothing that a missing signals.h5 could drive.
    if signals_file.exists() or config.actuators:
        signals = _read_signals(signals_file)
        sources.insert(1, signals_file)
    physics, times = config.physics, config.simulation
    experiment = Experiment(
        geometry=geometry,
        signals=signals,
        actuators=tuple(
            Actuator(node=entry.node, signal=entry.signal, type=entry.type, axes=entry.axes)
            for entry in config.actuators
        ),
        duration=times.duration,
        dt=times.save_interval if times.dt is None else times.dt,
        dt_stated=times.dt is not None,
        save_interval=times.save_interval,
        integrator=times.integrator or (DEFAULT_INTEGRATOR if times.accuracy is None else AUTO),
        accuracy=times.accuracy,
        gravity=physics.gravity_vector(),
        damping=physics.damping,
        collision=Collision(
            enabled=physics.enable_collision,
            radius=physics.collision_radius,
            restitution=physics.collision_restitution,
            iterations=physics.collision_iterations,
            friction=physics.collision_friction,
            faces=physics.collision_faces,
        ),
        bar_damping=physics.bar_damping,
        tolerance=times.tolerance,
        constraint_tolerance=times.constraint_tolerance,
        precision=times.precision,
        step_check=times.step_check,
        stored=Stored(
            precision=config.export.precision,
            velocities=config.export.velocities,
            elements=config.export.elements,
        ),
        overwrite=config.export.overwrite,
        path=folder.parent if folder.name == "input" else folder,
        sources=tuple(sources),
        layout="legacy" if legacy_config or legacy_geometry else "1.0",
        notes=tuple(notes),
    )
    check_experiment(
        experiment,
        geometry_file=geometry_file,
        signals_file=signals_file,
        config_file=config_file,
    )
    return experiment


def _read_geometry(path: Path, config: Config, notes: list[str]) -> tuple[Geometry, bool]:
    with open_hdf5(path) as file:
        reader = DatasetReader(file, path)
        if not is_new_layout(file, path, "geometry"):
            driven = [a.node for a in config.actuators if a.type != "force"]
            return experiment_legacy.read_geometry(reader, driven, notes), True
        optional: dict[str, Any] = {}
        for key, kind, unit in (
            ("fixed", "switch", None),
            ("collidable", "switch", None),
            ("velocities", "number", "m/s"),
        ):
            if reader.has(f"nodes/{key}"):
                optional[key] = reader.get(f"nodes/{key}", kind=kind, unit=unit)
        if reader.has("nodes/label"):
            optional["labels"] = _read_texts(reader, "nodes/label")
        if reader.has("elements/faces"):
            optional["faces"] = reader.get("elements/faces/indices", kind="integer")
        geometry = Geometry(
            positions=reader.get("nodes/positions", kind="number", unit="m"),
            masses=reader.get("nodes/masses", kind="number", unit="kg"),
            bars=Bars(**_read_elements(reader, "bars", BAR_UNITS, ("damping", "prestress"))),
            hinges=Hinges(**_read_elements(reader, "hinges", HINGE_UNITS, ("damping",))),
            bends=Bends(**_read_elements(reader, "bends", BEND_UNITS, ("rest_angle", "damping"))),
            **optional,
        )
    return geometry, False


def _read_elements(
    reader: DatasetReader, name: str, units: dict[str, str], optional: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    group = f"elements/{name}"
    if not reader.has(group):
        return {}
    columns = {"indices": reader.get(f"{group}/indices", kind="integer")}
    for key, unit in units.items():
        if key not in optional or reader.has(f"{group}/{key}"):
            columns[key] = reader.get(f"{group}/{key}", kind="number", unit=unit)
    if name == "bends":
        return columns  # no law but one, and never rigid
    if reader.has(f"{group}/rigid"):
        columns["rigid"] = reader.get(f"{group}/rigid", kind="switch")
    for key, (unit, _) in SPECIAL_UNITS[name].items():
        if reader.has(f"{group}/{key}"):
            columns[key] = reader.get(f"{group}/{key}", kind="number", unit=unit)
    if reader.has(f"{group}/law"):
        columns["law"] = np.array(_read_texts(reader, f"{group}/law"))
    return columns


def _read_texts(reader: DatasetReader, key: str) -> tuple[str, ...]:
    node = reader.file[key]
    if not isinstance(node, h5py.Dataset) or node.dtype.kind != "S":
        raise ConfigError(
            "not fixed-length text", expected="a dataset of UTF-8 bytes", file=reader.path, key=key
        )
    return tuple(bytes(label).decode("utf-8") for label in node[()])


def _read_signals(path: Path) -> dict[str, Signal]:
    with open_hdf5(path) as file:
        reader = DatasetReader(file, path)
        if not is_new_layout(file, path, "signals"):
            return experiment_legacy.read_signals(reader)
        signals = {}
        for name in file.get("signals", {}):
            key = f"signals/{name}"
            values = reader.get(key, kind="number")
            attrs = file[key].attrs
            dt = read_number(attrs.get("dt"), path, f"{key}@dt")
            unit = read_text(attrs.get("unit"))
            if unit in UNITS:
                si = _si_unit(unit)
                values = values * conversion_factor(unit, si, file=str(path), key=key)
                unit = si
            symbols: dict[str, Any] = {}
            if reader.has(f"sequences/{name}"):
                symbols["sequence"] = reader.get(f"sequences/{name}", kind="number")
                held = file[f"sequences/{name}"].attrs.get("hold")
                symbols["hold"] = read_number(held, path, f"sequences/{name}@hold")
            signals[name] = Signal(
                name=name,
                values=values,
                dt=dt,
                interpolation=read_text(attrs.get("interpolation", "linear")) or "?",  # type: ignore[arg-type]
                unit=unit,
                **symbols,
            )
    return signals


def _si_unit(unit: str) -> str:
    for si in ACTUATOR_UNITS.values():
        if UNITS[si].dimension == UNITS[unit].dimension:
            return si
    return unit


# --- writing ------------------------------------------------------------------------------


def write_experiment(experiment: Experiment, directory: str | Path) -> tuple[Path, ...]:
    """See `openprc.schema.experiment.save_experiment`."""
    from openprc.schema.config import parse_config  # noqa: PLC0415  pydantic only when needed

    folder = Path(directory) / "input"
    targets = tuple(folder / name for name in NAMES)
    check_experiment(
        experiment, geometry_file=targets[0], signals_file=targets[1], config_file=targets[2]
    )
    settings = experiment.settings()
    parse_config(settings, file=targets[2])
    folder.mkdir(parents=True, exist_ok=True)
    writers: tuple[Callable[[Path], None], ...] = (
        lambda path: _write_geometry(experiment.geometry, path),
        lambda path: _write_signals(experiment, path),
        lambda path: _write_text(json.dumps(settings, indent=2, sort_keys=True) + "\n", path),
    )
    # All three are complete before the first one is put in place.
    with tempfile.TemporaryDirectory(prefix=".saving-", dir=folder) as scratch:
        drafts = [Path(scratch) / name for name in NAMES]
        for write, draft in zip(writers, drafts, strict=True):
            write(draft)
        for draft, target in zip(drafts, targets, strict=True):
            publish(draft, target)
    return targets


def _write_text(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")


def _put(file: h5py.File, key: str, values: NDArray[Any], unit: str | None = None) -> None:
    dataset = file.create_dataset(key, data=values)
    if unit is not None:
        dataset.attrs["unit"] = unit


def _write_geometry(geometry: Geometry, path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["openprc_schema"] = SCHEMA
        file.attrs["kind"] = "geometry"
        _put(file, "nodes/positions", geometry.positions, "m")
        _put(file, "nodes/masses", geometry.masses, "kg")
        _put(file, "nodes/fixed", geometry.fixed.astype("u1"))
        if geometry.collidable.any():
            _put(file, "nodes/collidable", geometry.collidable.astype("u1"))
        if geometry.velocities.any():
            _put(file, "nodes/velocities", geometry.velocities, "m/s")
        if geometry.labels is not None:
            labels = np.array([label.encode("utf-8") for label in geometry.labels])
            _put(file, "nodes/label", labels)
        for name, elements, units in (
            ("bars", geometry.bars, BAR_UNITS),
            ("hinges", geometry.hinges, HINGE_UNITS),
            ("bends", geometry.bends, BEND_UNITS),
        ):
            if len(elements) == 0:
                continue
            _put(file, f"elements/{name}/indices", elements.indices)
            for key, unit in units.items():
                _put(file, f"elements/{name}/{key}", getattr(elements, key), unit)
            if isinstance(elements, Bends):
                continue  # no law but one, and never rigid
            _put(file, f"elements/{name}/rigid", elements.rigid.astype("u1"))
            for key, (unit, default) in SPECIAL_UNITS[name].items():
                if (getattr(elements, key) != default).any():
                    _put(file, f"elements/{name}/{key}", getattr(elements, key), unit)
            if (elements.law != "linear").any():
                _put(file, f"elements/{name}/law", elements.law.astype("S16"))
        if len(geometry.faces):
            _put(file, "elements/faces/indices", geometry.faces)


def _write_signals(experiment: Experiment, path: Path) -> None:
    uses: dict[str, set[str]] = {}
    for actuator in experiment.actuators:
        uses.setdefault(actuator.signal, set()).add(ACTUATOR_UNITS[actuator.type])
    with h5py.File(path, "w") as file:
        file.attrs["openprc_schema"] = SCHEMA
        file.attrs["kind"] = "signals"
        group = file.create_group("signals")
        for name, signal in experiment.signals.items():
            dataset = group.create_dataset(name, data=signal.values)
            dataset.attrs["dt"] = float(signal.dt)
            dataset.attrs["interpolation"] = signal.interpolation
            units = uses.get(name, set())
            unit = signal.unit or (next(iter(units)) if len(units) == 1 else None)
            if unit is not None:
                dataset.attrs["unit"] = unit
            # The symbols of a held signal are its values.
            if signal.sequence is not None and signal.interpolation != "hold":
                symbols = file.create_dataset(f"sequences/{name}", data=signal.sequence)
                symbols.attrs["hold"] = float(signal.hold or 0.0)
