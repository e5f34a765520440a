"""The input folder beside an older run: geometry, wiring and signals.

Unlike `openprc.schema.experiment`, which refuses a wrong experiment before it is simulated,
this takes from a run that already happened whatever fits it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema import safety
from openprc.schema.legacy_kinds import read

FIXED = 1
_MAX_JSON = 16 << 20
#: Dataset of an element group, its name in the contract, its unit.
_BARS = (
    ("rest_length", "rest_length", "m"),
    ("stiffness", "stiffness", "N/m"),
    ("damping", "damping", "N*s/m"),
    ("prestress", "prestress", "1"),
)
_HINGES = (
    ("stiffness", "stiffness", "N*m/rad"),
    ("angle", "rest_angle", "rad"),
    ("phi0", "rest_angle", "rad"),
    ("damping", "damping", "N*m*s/rad"),
)


@dataclass(frozen=True)
class Elements:
    """Nodes of every element (E, k), and constants by name: (array (E,), unit or None)."""

    indices: NDArray[np.int64]
    static: dict[str, tuple[NDArray[Any], str | None]]


@dataclass(frozen=True)
class Geometry:
    """geometry.h5 of the older layout.

    Parameters
    ----------
    rest : (N, 3) [m]
    masses : (N,) [kg] or None
    fixed : (N,) bool or None
    elements : mapping of "bars" and "hinges" to Elements
    """

    rest: NDArray[np.float64]
    masses: NDArray[np.float64] | None
    fixed: NDArray[np.bool_] | None
    elements: Mapping[str, Elements]


@dataclass(frozen=True)
class Wire:
    """An actuator: which signal drove which node, and how."""

    node: int
    signal: str
    type: str
    dof: tuple[int, ...]


@dataclass(frozen=True)
class Siblings:
    """Files found beside a run; everything may be absent."""

    geometry_file: Path | None = None
    config_file: Path | None = None
    signals_file: Path | None = None
    wires: tuple[Wire, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)

    def number(self, name: str) -> float | None:
        """Return a number of the section "simulation", or None."""
        value = self.settings.get(name)
        return float(value) if isinstance(value, int | float) and value > 0 else None


def find_siblings(run: Path) -> Siblings:
    """Look for the input folder of the run at `run`, and read the wiring.

    Only ``../input`` and ``input`` are looked at: a path written in the file could point
    anywhere.

    Raises
    ------
    UnreadableFile
        When a config.json is there and is no settings file.
    """
    for folder in (run.absolute().parent.parent / "input", run.absolute().parent / "input"):
        files = {name: folder / name for name in ("geometry.h5", "config.json", "signals.h5")}
        there = {name: path for name, path in files.items() if path.is_file()}
        if there:
            config = there.get("config.json")
            data = {} if config is None else _read_json(config)
            simulation = data.get("simulation")
            return Siblings(
                geometry_file=there.get("geometry.h5"),
                config_file=config,
                signals_file=there.get("signals.h5"),
                wires=() if config is None else _wires(data, config),
                settings=simulation if isinstance(simulation, dict) else {},
            )
    return Siblings()


def _read_json(path: Path) -> dict[str, Any]:
    safety.check_readable(path)
    if path.stat().st_size > _MAX_JSON:
        raise _broken(path, f"it has {path.stat().st_size} bytes", "a settings file")
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise _broken(path, f"it is no JSON: {error}", "JSON text in UTF-8") from None
    if not isinstance(data, dict):
        raise _broken(path, f"it holds a {type(data).__name__}", "a JSON object")
    return data


def _broken(path: Path, found: str, expected: str, key: str | None = None) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected=expected,
        fix="correct it, or move the input folder away to import the run without it",
        file=path,
        key=key,
    )


def _wires(data: Mapping[str, Any], path: Path) -> tuple[Wire, ...]:
    entries = data.get("actuators", [])
    if not isinstance(entries, list):
        raise _broken(path, "actuators is no list", "a list of actuators", "actuators")
    wires: list[Wire] = []
    for number, entry in enumerate(entries):
        entry = entry if isinstance(entry, dict) else {}
        node = entry.get("node_idx", entry.get("node_id", entry.get("node")))
        signal = entry.get("signal_name", entry.get("signal"))
        if not isinstance(node, int) or not isinstance(signal, str):
            raise _broken(
                path,
                f"actuator {number} names no node or no signal",
                "node_idx and signal_name",
                f"actuators[{number}]",
            )
        dof = entry.get("dof", entry.get("axes", (1, 1, 1)))
        dof = tuple(int(bool(axis)) for axis in dof) if isinstance(dof, list | tuple) else ()
        wires.append(Wire(node, signal, str(entry.get("type", "position")), dof or (1, 1, 1)))
    return tuple(wires)


def read_geometry(path: Path) -> Geometry:
    """Read geometry.h5 of the older layout.

    Raises
    ------
    UnreadableFile
        When it has no nodes, or its arrays do not fit together.
    """
    with safety.open_hdf5(path, allow_vlen=True) as file:
        rest = _array(file, "nodes/positions", path)
        if rest is None or rest.ndim != 2 or rest.shape[1] != 3:
            found = "missing" if rest is None else f"of shape {rest.shape}"
            raise _broken(path, f"the node positions are {found}", "(N, 3)", "nodes/positions")
        n = len(rest)
        masses = _array(file, "nodes/masses", path, length=n)
        bits = _array(file, "nodes/attributes", path, length=n)
        elements = {}
        for kind, k, columns in (("bars", 2, _BARS), ("hinges", 4, _HINGES)):
            found_elements = _elements(file, kind, k, columns, n, path)
            if found_elements is not None:
                elements[kind] = found_elements
    return Geometry(
        rest=rest.astype(np.float64),
        masses=None if masses is None else masses.astype(np.float64),
        fixed=None if bits is None else (bits.astype(np.int64) & FIXED).astype(bool),
        elements=elements,
    )


def _elements(
    file: h5py.File,
    kind: str,
    k: int,
    columns: tuple[tuple[str, str, str], ...],
    n_nodes: int,
    path: Path,
) -> Elements | None:
    group = f"elements/{kind}"
    indices = _array(file, f"{group}/indices", path)
    if indices is None or len(indices) == 0:
        return None
    if indices.ndim != 2 or indices.shape[1] != k or indices.dtype.kind not in "iu":
        raise _broken(
            path,
            f"{indices.dtype} of shape {indices.shape}",
            f"(E, {k}) integers",
            f"{group}/indices",
        )
    wrong = np.flatnonzero(((indices < 0) | (indices >= n_nodes)).any(axis=1))
    if len(wrong):
        # That engine never checked, and read whatever memory lay there.
        raise _broken(
            path,
            f"element {wrong[0]} names node {indices[wrong[0]].tolist()} of {n_nodes}",
            f"nodes 0 to {n_nodes - 1}",
            f"{group}/indices",
        )
    static: dict[str, tuple[NDArray[Any], str | None]] = {}
    for source, name, unit in columns:
        values = _array(file, f"{group}/{source}", path, length=len(indices))
        if values is None or name in static:
            continue
        if name == "stiffness" and (values < 0).any():
            # The sign was a flag for "rigid"; the number behind it was never used.
            static["rigid"] = ((values < 0).astype(np.uint8), None)
            values = np.where(values < 0, values.dtype.type(0), values)
        static[name] = (values, unit)
    return Elements(indices.astype(np.int64), static)


def _array(
    file: h5py.File, name: str, path: Path, *, length: int | None = None
) -> NDArray[Any] | None:
    item = file.get(name)
    if not isinstance(item, h5py.Dataset):
        return None
    if item.dtype.kind not in "fiu" or (length is not None and item.shape != (length,)):
        wanted = "numbers" if length is None else f"{length} numbers"
        raise _broken(path, f"{item.dtype} of shape {item.shape}", wanted, name)
    return read(item)
