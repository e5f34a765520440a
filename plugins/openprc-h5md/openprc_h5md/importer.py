"""H5MD to simulation.h5."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from openprc.errors import ConfigError, OpenPRCError
from openprc.schema import safety
from openprc.schema.units import UNITS, velocity_unit
from openprc_h5md.periodic import Unwrapping, refuse_wrapped
from openprc_h5md.reading import Element, choose_group, read_element, wrong
from openprc_h5md.unit_names import is_known, to_contract

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import TrajectoryWriter

#: Numbers handed to the writer at once.
_BLOCK = 1 << 20


class H5mdImporter:
    """Imports one particles group with its bonds, and the observables on its clock."""

    def sniff(self, path: Path) -> float:
        """Return 1.0 for a file with the group h5md and moving particles, 0.3 by the name."""
        path = Path(path)
        by_name = 0.3 if path.suffix.lower() == ".h5md" else 0.0
        if not path.is_file() or not safety.is_hdf5(path):
            return by_name
        try:
            with _open(path) as file:
                head = file.get("h5md")
                known = isinstance(head, h5py.Group) and "version" in head.attrs
                return 1.0 if known and "particles" in file else by_name
        except OpenPRCError:
            return by_name

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the run at `path`.

        Raises
        ------
        SchemaError
            When the file does not keep H5MD, or has several particles groups.
        ConfigError
            When a unit is neither in the file nor given, or the box is periodic and the file
            does not say how often a particle crossed it.
        UnitError
            When a unit is not known.
        """
        with _open(Path(path)) as file:
            _Run(file, Path(path), options).write(writer)


def _open(path: Path) -> h5py.File:
    # The specification shares step and time by links, and names particle groups by reference.
    return safety.open_hdf5(path, allow_references=True, allow_vlen=True, allow_soft_links=True)


class _Run:
    """One file on its way into a writer."""

    def __init__(self, file: h5py.File, path: Path, options: Mapping[str, Any]) -> None:
        self.file, self.path, self.options = file, path, options
        self.group = choose_group(file, options.get("group"), path)
        self.place = read_element(self.group["position"], path)
        if self.place.value.ndim != 3 or self.place.value.shape[2] not in (1, 2, 3):
            raise wrong(
                path, self.place.value.name, f"positions of shape {self.place.value.shape}",
                "(T, N, D)",
            )  # fmt: skip
        self.told = _told(file)
        self.n_nodes = self.place.value.shape[1]
        stored = self.place.value.shape[2]
        #: z that this package added itself is taken back.
        self.dims = 2 if stored == 3 and self.told.get("dims") == 2 else max(stored, 2)

    def write(self, writer: TrajectoryWriter) -> None:
        time = self._declare_time(writer)
        unit, factor = self._unit_of_length()
        unwrapping = Unwrapping.of(self.group, self.place, self.path)
        if unwrapping is None and not self.options["wrapped"]:
            refuse_wrapped(self.group, self.path)
        speed = self._velocity(unit)
        ids = self._ids()
        observed = self._has_gaps()
        self._declare_nodes(writer, unit, ids, moving=speed is not None, gaps=observed)
        self._declare_bonds(writer)
        channels, inputs = self._declare_observables(writer)
        rows = max(1, _BLOCK // max(1, 3 * self.n_nodes))
        for start in range(0, len(time), rows):
            block = slice(start, min(start + rows, len(time)))
            values = self.place.value[block].astype("f8", copy=False)
            if unwrapping is not None:
                values = unwrapping.unwrap(values, block)
            values = self._fit(values) * factor
            mask = np.isnan(values).any(axis=2)
            values[mask] = np.nan
            writer.append(
                time[block],
                positions=values,
                velocities=None if speed is None else self._speeds(speed, block, mask),
                observed=(~mask).astype("u1") if observed else None,
                channels={n: _wide(e.value[block]) * f for n, (e, f) in channels.items()},
                inputs={n: _wide(e.value[block]) * f for n, (e, f) in inputs.items()},
            )

    def _fit(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        if values.shape[2] >= self.dims:
            return np.array(values[:, :, : self.dims])
        flat = np.zeros((*values.shape[:2], self.dims))
        flat[..., : values.shape[2]] = values
        return flat

    def _speeds(
        self, speed: tuple[Element, float], block: slice, mask: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        values = speed[0].value[block].astype("f8", copy=False)
        values = self._fit(values) * speed[1]
        values[mask] = np.nan
        return values

    def _declare_time(self, writer: TrajectoryWriter) -> NDArray[np.float64]:
        given = self.options.get("time_unit")
        name = self.place.time_unit or given or self._pseudo()
        if self.place.time is None:
            writer.declare_time(unit="1", kind="pseudo")
            writer.note("the file tells steps and no time; the steps are the clock")
            return self.place.step.astype("f8")
        if name is None:
            raise ConfigError(
                "the file does not say in which unit its time is",
                expected="an attribute 'unit' of the time",
                fix="give it with the option time_unit; 1 for steps without a duration",
                file=self.path,
                key="time_unit",
            )
        if name == "1":
            writer.declare_time(unit="1", kind="pseudo")
            return self.place.time
        unit, factor = to_contract(name, file=self.path, key="/particles/.../time")
        writer.declare_time(unit=unit)
        return self.place.time * factor

    def _pseudo(self) -> str | None:
        return "1" if self.told.get("time_kind") == "pseudo" else None

    def _unit_of_length(self) -> tuple[str, float]:
        name = self.place.unit or self.options.get("unit") or self.told.get("position_unit")
        if name is None:
            raise ConfigError(
                "the file does not say in which unit its positions are",
                expected="an attribute 'unit' of the positions",
                fix="give it with the option unit; arb when there is none",
                file=self.path,
                key="unit",
            )
        return to_contract(str(name), file=self.path, key=self.place.value.name)

    def _velocity(self, unit: str) -> tuple[Element, float] | None:
        if "velocity" not in self.group:
            return None
        element = read_element(self.group["velocity"], self.path)
        if element.value.shape != self.place.value.shape:
            return None
        if element.unit is None:
            return element, 1.0
        found, factor = to_contract(element.unit, file=self.path, key=element.value.name)
        if UNITS[found].dimension != "velocity" or unit not in ("m", "cm", "mm", "um"):
            raise wrong(
                self.path, element.value.name, f"velocities in {element.unit!r} beside positions "
                f"in {unit!r}", "units that belong together",
            )  # fmt: skip
        return element, factor * UNITS[found].si_factor / UNITS[velocity_unit(unit)].si_factor

    def _ids(self) -> NDArray[Any] | None:
        """Return the ids of the particles, (N,), where the file gives other than 0, 1, ..."""
        item = self.group.get("id")
        if isinstance(item, h5py.Group):
            series = read_element(item, self.path).value
            numbers = np.asarray(series[0])
            if (series[()] != numbers).any():
                raise ConfigError(
                    "the particles change their places in the arrays from frame to frame",
                    expected="particles in one order",
                    fix="sort every frame by id when the file is written",
                    file=self.path,
                    key=series.name,
                )
        elif isinstance(item, h5py.Dataset):
            numbers = item[()]
        else:
            return None
        if np.shape(numbers) != (self.n_nodes,) or len(np.unique(numbers)) != self.n_nodes:
            raise wrong(self.path, f"{self.group.name}/id", "ids that repeat", "one id a particle")
        return None if np.array_equal(numbers, np.arange(self.n_nodes)) else numbers

    def _has_gaps(self) -> bool:
        value, rows = self.place.value, max(1, _BLOCK // max(1, 3 * self.n_nodes))
        return any(
            bool(np.isnan(value[start : start + rows]).any())
            for start in range(0, len(value), rows)
        )

    def _declare_nodes(
        self, writer: TrajectoryWriter, unit: str, ids: Any, *, moving: bool, gaps: bool
    ) -> None:
        mass, mass_unit = self._mass()
        writer.declare_nodes(
            self.n_nodes,
            self.dims,
            unit=unit,
            velocities=moving,
            observed=gaps,
            mass=mass,
            **({} if mass_unit is None else {"mass_unit": mass_unit}),
            fixed=self._per_node("fixed"),
            ids=ids,
            labels=self._per_node("labels"),
        )

    def _per_node(self, name: str) -> list[Any] | None:
        told = self.told.get(name)
        return told if isinstance(told, list) and len(told) == self.n_nodes else None

    def _mass(self) -> tuple[NDArray[np.float64] | None, str | None]:
        item = self.group.get("mass")
        if not isinstance(item, h5py.Dataset) or item.shape != (self.n_nodes,):
            return None, None
        unit = item.attrs.get("unit")
        unit = unit.decode() if isinstance(unit, bytes) else unit
        # Atomic mass units and the like have no place in the contract.
        if unit is None or unit not in UNITS or UNITS[unit].dimension != "mass":
            return None, None
        return item[()].astype("f8"), str(unit)

    def _declare_bonds(self, writer: TrajectoryWriter) -> None:
        home = self.file.get("connectivity")
        for name in home if isinstance(home, h5py.Group) else ():
            item = home[name]
            if not isinstance(item, h5py.Dataset) or item.ndim != 2 or item.shape[1] != 2:
                continue
            target = item.attrs.get("particles_group")
            if isinstance(target, h5py.Reference) and self.file[target] != self.group:
                continue
            pairs = item[()].astype("i8")
            pairs = pairs[(pairs >= 0).all(axis=1)]  # the fill value marks empty rows
            writer.declare_elements("bars" if name == "bonds" else name, pairs)

    def _declare_observables(
        self, writer: TrajectoryWriter
    ) -> tuple[dict[str, tuple[Element, float]], dict[str, tuple[Element, float]]]:
        channels: dict[str, tuple[Element, float]] = {}
        inputs: dict[str, tuple[Element, float]] = {}
        skipped: list[str] = []
        for name, element in _observables(self.file, self.path, skipped):
            if not np.array_equal(element.step, self.place.step) or element.value.ndim > 2:
                skipped.append(name)
                continue
            symbol, factor = "arb", 1.0
            if element.unit is not None and is_known(element.unit):
                symbol, factor = to_contract(element.unit, file=self.path, key=name)
            kind, _, rest = name.partition("/")
            plain = rest if kind in ("channels", "inputs", "system") and rest else name
            plain = plain.replace("/", " ")
            width = 1 if element.value.ndim == 1 else element.value.shape[1]
            columns = _columns(element.value, plain, width)
            if kind == "inputs":
                writer.declare_input(plain, columns, quantity="input", unit=symbol)
                inputs[plain] = (element, factor)
            else:
                writer.declare_channel(plain, columns, unit=symbol)
                channels[plain] = (element, factor)
        if skipped:
            writer.note(
                f"observables left out, since they are on another clock or no columns of "
                f"numbers: {', '.join(sorted(skipped))}"
            )
        return channels, inputs


def _told(file: h5py.File) -> dict[str, Any]:
    """Return what the exporter of this plugin added, if it wrote the file."""
    item = file.get("parameters/openprc")
    text = item.attrs.get("run") if isinstance(item, h5py.Group) else None
    if not isinstance(text, str):
        return {}
    try:
        told = json.loads(text)
    except ValueError:
        return {}
    return told if isinstance(told, dict) else {}


def _observables(file: h5py.File, path: Path, skipped: list[str]) -> list[tuple[str, Element]]:
    found: list[tuple[str, Element]] = []
    pending = [("", file.get("observables"))]
    while pending:
        prefix, group = pending.pop()
        for name in group if isinstance(group, h5py.Group) else ():
            item, key = group[name], f"{prefix}{name}"
            if isinstance(item, h5py.Group) and isinstance(item.get("value"), h5py.Dataset):
                if item["value"].dtype.kind in "fiu" and item["value"].ndim in (1, 2):
                    found.append((key, read_element(item, path)))
                else:
                    skipped.append(key)
            elif isinstance(item, h5py.Group):
                pending.append((f"{key}/", item))
    return sorted(found, key=lambda pair: pair[0])


def _columns(value: h5py.Dataset, name: str, width: int) -> list[str]:
    told = value.attrs.get("columns")
    if told is not None and len(told) == width:
        return [str(text) for text in told]
    return [name] if width == 1 else [f"{name} {place}" for place in range(width)]


def _wide(values: NDArray[Any]) -> NDArray[np.float64]:
    numbers = values.astype("f8")
    return numbers[:, np.newaxis] if numbers.ndim == 1 else numbers
