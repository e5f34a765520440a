"""Which field is what: displacement, velocity, or something that was measured."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc.schema import units
from openprc_meshio.frames import Frame, Series

#: What programs call the displacement; compared without regard to case.
DISPLACEMENTS = ("u", "disp", "displacement", "displacements")
_UNFIT = re.compile(r"[^A-Za-z0-9_.\- ]")
#: Names of columns stand in one attribute, which HDF5 limits to 64 KiB.
_MOST_COLUMNS = 4000


@dataclass(frozen=True)
class Kept:
    """A field that is kept as a channel or as a series of elements.

    ``name`` is that of the source, ``stored`` that of the trajectory.
    """

    name: str
    stored: str
    unit: str


@dataclass
class Roles:
    """What the fields of a series are.

    Attributes
    ----------
    displacement, velocity : str or None
    velocity_unit : str or None
    observed : bool
        There is a mask that this plugin's exporters wrote.
    channels : fields of the points; elements : kind to fields of the cells
    """

    displacement: str | None
    velocity: str | None
    velocity_unit: str | None
    observed: bool
    channels: list[Kept]
    elements: dict[str, list[Kept]]
    notes: list[str]


def assign(series: Series, options: Mapping[str, Any], *, unit: str, time_unit: str) -> Roles:
    """Find the roles by the options, by what the file states, and by names.

    Raises
    ------
    MissingData
        When an option names a field that is not there.
    ConfigError
        When a field does not fit its role, or several do.
    """
    first = series.frames[0]
    notes: list[str] = []
    displacement = _displacement(first, options.get("displacement"), series.path, notes)
    velocity = options.get("velocity")
    if velocity is None and "velocities" in series.units and "velocities" in first.point_names:
        velocity = "velocities"
    speed = None
    if velocity is not None:
        _vector(first, velocity, "velocity", series.path)
        speed = _velocity_unit(series, options, unit=unit, time_unit=time_unit)
        notes.append(f"velocities are the field {velocity!r}, in {speed}")
    channels, elements = _kept(series, options)
    return Roles(
        displacement,
        velocity,
        speed,
        # The mask goes with files that state the unit of their places: those of our exporters.
        "observed" in first.point_names and "positions" in series.units,
        channels,
        elements,
        notes,
    )


def _displacement(first: Frame, given: str | None, path: Path, notes: list[str]) -> str | None:
    if given == "none":
        return None
    if given is not None:
        _vector(first, given, "displacement", path)
        notes.append(f"places are the points plus the field {given!r}, as asked")
        return given
    found = [name for name in first.point_names if name.lower() in DISPLACEMENTS]
    found = [name for name in found if first.point_field(name).shape[1:] in ((2,), (3,))]
    if len(found) > 1:
        raise ConfigError(
            f"the fields {' and '.join(map(repr, found))} may both be the displacement",
            expected="one",
            fix=f"pass displacement={found[0]}, or displacement=none if the points move themselves",
            file=path,
            key="displacement",
        )
    if found:
        notes.append(
            f"the field {found[0]!r} was taken as the displacement, by its name; places are the "
            "points plus it. Say displacement=none if it is something else"
        )
        return found[0]
    return None


def _vector(first: Frame, name: str, role: str, path: Path) -> None:
    require(first, name, 0, path, key=role)
    shape = first.point_field(name).shape
    if shape[1:] not in ((2,), (3,)):
        raise ConfigError(
            f"the field {name!r} has {shape[1] if len(shape) > 1 else 1} numbers a point",
            expected="2 or 3",
            fix=f"name a vector field with the option {role}",
            file=path,
            key=role,
        )


def require(frame: Frame, name: str, index: int, path: Path, *, key: str) -> None:
    """Refuse a frame without a field of the points.

    Raises
    ------
    MissingData
    """
    if name not in frame.point_names:
        raise MissingData(
            f"frame {index} has no point field {name!r}",
            expected="one of " + (", ".join(frame.point_names) or "none: there are no fields"),
            fix=f"correct the option {key}",
            file=path,
            key=key,
        )


def _velocity_unit(series: Series, options: Mapping[str, Any], *, unit: str, time_unit: str) -> str:
    given = options.get("velocity_unit")
    stated = series.units.get("velocities")
    if given and stated and given != stated:
        raise ConfigError(
            f"the option says {given!r} and the file {stated!r}",
            expected="one unit",
            fix="leave the option out",
            file=series.path,
            key="velocity_unit",
        )
    if given or stated:
        return str(given or stated)
    if time_unit != "s":
        raise ConfigError(
            f"nothing says which unit velocities have beside time in {time_unit!r}",
            expected="a unit of velocity",
            fix="pass velocity_unit=m/s, mm/s, ...",
            file=series.path,
            key="velocity_unit",
        )
    return units.velocity_unit(unit)


def _kept(series: Series, options: Mapping[str, Any]) -> tuple[list[Kept], dict[str, list[Kept]]]:
    first = series.frames[0]
    channels: dict[str, Kept] = {}
    elements: dict[str, dict[str, Kept]] = {"bars": {}, "faces": {}}
    for name in first.cell_names:
        for kind, fields in elements.items():
            if f"{kind}.{name}" in series.units:
                fields[name] = Kept(name, stored_name(name), series.units[f"{kind}.{name}"])
    for text in options.get("channels") or ():
        name, equals, unit = text.rpartition("=")
        name, unit = (name, unit) if equals else (text, "arb")
        units.unit(unit, file=str(series.path), key="channels")
        kept = Kept(name, stored_name(name), unit)
        if name not in first.point_names and name not in first.cell_names:
            known = ", ".join([*first.point_names, *first.cell_names])
            raise MissingData(
                f"there is no field {name!r}",
                expected="one of " + (known or "none: there are no fields"),
                fix="correct the option channels",
                file=series.path,
                key="channels",
            )
        if name in first.point_names:
            values = first.point_field(name)
            if values.size > _MOST_COLUMNS:
                raise ConfigError(
                    f"the field {name!r} has {values.size} numbers a frame",
                    expected=f"at most {_MOST_COLUMNS} columns in a channel",
                    fix="export a part of the mesh, or leave the field out",
                    file=series.path,
                    key="channels",
                )
            channels[name] = kept
        if name in first.cell_names:
            for fields in elements.values():
                fields[name] = kept
    return list(channels.values()), {kind: list(f.values()) for kind, f in elements.items()}


def stored_name(name: str) -> str:
    """Return a name that the contract allows."""
    fit = _UNFIT.sub("_", name)
    return fit if fit[:1].isalnum() or fit[:1] == "_" else f"_{fit}"


def check_values(values: Any, name: str, index: int, path: Path) -> None:
    """Refuse what is no real number.

    Raises
    ------
    UnreadableFile
    """
    if values.dtype.kind not in "fiu":
        raise UnreadableFile(
            f"the field {name!r} of frame {index} is of type {values.dtype}",
            expected="real numbers",
            fix="leave the field out",
            file=path,
            key=name,
        )
