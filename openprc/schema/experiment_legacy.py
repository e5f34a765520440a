"""The older layout of geometry.h5 and signals.h5, read only.

``nodes/attributes`` is a bit mask: 1 fixed, 2 position-driven, 4 force-driven, 8 collidable.
A negative stiffness means rigid. Rest angles are called ``angle`` or ``phi0``. Signals are
datasets at the root, with one time step ``dt_base`` for all of them as a root attribute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.schema.experiment import Signal
from openprc.schema.experiment_reader import DatasetReader, read_number
from openprc.schema.geometry import Bars, Geometry, Hinges
from openprc.schema.mistakes import list_some

FIXED, POSITION_DRIVEN, FORCE_DRIVEN, COLLIDABLE = 1, 2, 4, 8


def read_geometry(reader: DatasetReader, driven: Sequence[int], notes: list[str]) -> Geometry:
    """Read geometry.h5 of the older layout.

    Parameters
    ----------
    driven : sequence of int
        Nodes that have a position or velocity actuator; the "fixed" bit of those means no
        more than that the integrator leaves them alone.
    notes : list of str
        Gets one entry for everything that had to be decided.

    Raises
    ------
    ConfigError
        When a required dataset is missing.
    """
    positions = reader.get("nodes/positions", kind="number")
    bits = reader.get("nodes/attributes", kind="integer")
    fixed = (bits & FIXED).astype(bool)
    for node in driven:
        if 0 <= node < fixed.size and fixed[node]:
            fixed[node] = False
            notes.append(f"node {node} has the fixed bit and an actuator that moves it: it moves")
    stray = np.setdiff1d(np.flatnonzero((bits & POSITION_DRIVEN).astype(bool) & ~fixed), driven)
    if len(stray):
        raise ConfigError(
            f"node {list_some(stray)} is marked position-driven and no actuator drives it",
            expected="a position actuator, or the fixed bit",
            fix="set the attribute to 1 (fixed) or 0 (free), or add the actuator",
            file=reader.path,
            key="nodes/attributes",
        )
    return Geometry(
        positions=positions,
        masses=reader.get("nodes/masses", kind="number"),
        fixed=fixed,
        collidable=(bits & COLLIDABLE).astype(bool),
        bars=Bars(**_bars(reader, notes)) if reader.has("elements/bars") else Bars(),
        hinges=Hinges(**_hinges(reader, notes)) if reader.has("elements/hinges") else Hinges(),
    )


def _bars(reader: DatasetReader, notes: list[str]) -> dict[str, Any]:
    group = "elements/bars"
    stiffness, rigid = _split_rigid(reader.get(f"{group}/stiffness", kind="number"))
    columns: dict[str, Any] = {
        "indices": reader.get(f"{group}/indices", kind="integer"),
        "stiffness": stiffness,
        "rigid": rigid,
        "rest_length": reader.get(f"{group}/rest_length", kind="number"),
    }
    for key in ("damping", "prestress"):
        if reader.has(f"{group}/{key}"):
            columns[key] = reader.get(f"{group}/{key}", kind="number")
        elif len(stiffness):
            notes.append(f"geometry.h5 has no {group}/{key}: 0 for every bar")
    return columns


def _hinges(reader: DatasetReader, notes: list[str]) -> dict[str, Any]:
    group = "elements/hinges"
    stiffness, rigid = _split_rigid(reader.get(f"{group}/stiffness", kind="number"))
    angle = "angle" if reader.has(f"{group}/angle") else "phi0"
    columns: dict[str, Any] = {
        "indices": reader.get(f"{group}/indices", kind="integer"),
        "stiffness": stiffness,
        "rigid": rigid,
        "rest_angle": reader.get(f"{group}/{angle}", kind="number"),
    }
    if reader.has(f"{group}/damping"):
        damping = reader.get(f"{group}/damping", kind="number")
        if np.any(damping < 0):
            raise ConfigError(
                f"negative damping at hinge {list_some(np.flatnonzero(damping < 0))}",
                expected="0 or more; the older files mark limited angles this way",
                fix="angle limits are not supported: remove the mark",
                file=reader.path,
                key=f"{group}/damping",
            )
        if damping.any():
            # Programs of that layout store the number and never use it.
            notes.append("hinge damping had no effect in the older layout: 0 for every hinge")
    return columns


def _split_rigid(stiffness: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    rigid = stiffness < 0
    return np.where(rigid, 0.0, stiffness), rigid


def read_signals(reader: DatasetReader) -> dict[str, Signal]:
    """Read signals.h5 of the older layout; samples are joined linearly.

    Raises
    ------
    ConfigError
        When ``dt_base`` is missing or a signal lies in a group.
    """
    names = list(reader.file)
    if not names:
        return {}
    dt = read_number(reader.file.attrs.get("dt_base"), reader.path, "@dt_base")
    signals = {}
    for name in names:
        if not isinstance(reader.file[name], h5py.Dataset):
            raise ConfigError(
                "a group where a signal was expected",
                expected="signals as datasets at the root of the file",
                fix="move the dataset to the root",
                file=reader.path,
                key=name,
            )
        signals[name] = Signal(name=name, values=reader.get(name, kind="number"), dt=dt)
    return signals
