"""`load`: components of a vision file, each for itself."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc.schema.damage import damage_named
from openprc.schema.safety import open_hdf5
from openprc.vision.storage import reading
from openprc.vision.storage.parts import GROUP, PARTS

_READERS = {
    "source": reading.read_source,
    "feature_map": reading.read_feature_map,
    "tracking_result": reading.read_tracking,
    "trajectory_set": reading.read_trajectories,
    "signals": reading.read_signals,
}


def load(path: str | Path, components: Iterable[str] | str | None = None) -> dict[str, Any]:
    """Return components of a file that `openprc.vision.save` wrote, here or in the older tracker.

    Parameters
    ----------
    path : path-like
    components : names, optional
        ``source``, ``feature_map``, ``tracking_result``, ``trajectory_set``, ``signals``; all
        that are there by default. Nothing else is read.

    Returns
    -------
    dict
        By the names of `save`: ``source`` as plain values, the others as objects, and with
        ``signals`` also ``signals_meta``.

    Raises
    ------
    ConfigError
        When a component has another name.
    MissingData
        When a component that was asked for is not in the file.
    UnreadableFile
        When the file is no vision file, or a component is damaged.
    """
    path = Path(path)
    wanted = (components,) if isinstance(components, str) else components
    names = None if wanted is None else tuple(wanted)
    for name in names or ():
        if name not in PARTS:
            raise ConfigError(
                f"there is no component {name!r}",
                expected="one of " + ", ".join(PARTS),
                fix="correct the name",
                key="components",
            )
    found: dict[str, Any] = {}
    with open_hdf5(path, allow_vlen=True) as file, damage_named(path, f"/{GROUP}"):
        there = stored_parts(file, path)
        for name in there if names is None else names:
            if name not in there:
                raise MissingData(
                    f"the file holds no {name}",
                    expected="one of " + ", ".join(there),
                    fix="ask for what is there, or save it",
                    file=path,
                    key=f"/{GROUP}/{PARTS[name]}",
                )
            value = _READERS[name](file[f"{GROUP}/{PARTS[name]}"], path)
            if name == "signals":
                found["signals"], found["signals_meta"] = value
            else:
                found[name] = value
    return found


def stored_parts(file: h5py.File, path: Path) -> tuple[str, ...]:
    """Return the components that a file has.

    Raises
    ------
    UnreadableFile
        When it has no group ``/vision``.
    """
    group = file.get(GROUP)
    if not isinstance(group, h5py.Group):
        raise UnreadableFile(
            "there is no group /vision",
            expected="a file of openprc.vision.save",
            fix="open a simulation.h5 with openprc.schema.Trajectory or StateLoader",
            file=path,
            key=f"/{GROUP}",
        )
    return tuple(name for name, part in PARTS.items() if isinstance(group.get(part), h5py.Group))
