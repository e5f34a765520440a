"""What the exporter keeps under ``openprc:`` keys, checked like everything from a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.schema import UNITS
from openprc_merlin.fold_mesh import vertices, wrong
from openprc_merlin.run import Static

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

Ints = NDArray[np.int64]
TIME = "openprc:time"
_CLOCK, _NODES, _INPUTS = "openprc:clock", "openprc:nodes", "openprc:inputs"
_KINDS = {"f": "f8", "i": "i4", "u": "u1"}


@dataclass(frozen=True)
class Said:
    """Topology and constants that FOLD has no key for.

    Attributes
    ----------
    unit : of the positions, or None
    n_bars : int, edges that are bars, or None where all of them are
    hinges : (H, 4), or None where they follow from the faces
    faces : (F, 3) in the sense they were stored in, or None where it is that of the file
    keys : the frame
    """

    unit: str | None
    n_bars: int | None
    hinges: Ints | None
    faces: Ints | None
    keys: Mapping[str, Any]
    file: Path
    n_nodes: int

    def nodes(self, dims: int) -> dict[str, Any]:
        """Return what `declare_nodes` takes besides number and unit."""
        said = _object(self.keys, _NODES, self.file)
        found: dict[str, Any] = {}
        shapes = {"rest": (self.n_nodes, dims), "mass": (self.n_nodes,), "fixed": (self.n_nodes,)}
        for name, shape in shapes.items():
            if name in said:
                found[name] = _numbers(said[name], shape, f"{_NODES}/{name}", self.file)
        if "mass" in found:
            found["mass_unit"] = _symbol(said.get("mass_unit", "kg"), _NODES, self.file)
        for name, argument, kind in (("id", "ids", int), ("label", "labels", str)):
            if name not in said:
                continue
            column = said[name]
            fits = isinstance(column, list) and len(column) == self.n_nodes
            if not fits or any(type(value) is not kind for value in column):
                raise wrong(
                    self.file, f"{_NODES}/{name}", "a list that does not fit", f"{self.n_nodes}"
                )
            if kind is int and not all(abs(value) < 1 << 62 for value in column):
                raise wrong(self.file, f"{_NODES}/{name}", "a huge number", "node numbers")
            found[argument] = column
        return found

    def constants(self, kind: str, count: int) -> dict[str, Static]:
        """Return constants of bars or hinges."""
        key = f"openprc:{kind}"
        static = _object(_object(self.keys, key, self.file), "static", self.file)
        found: dict[str, Static] = {}
        for name, entry in static.items():
            where = f"{key}/static/{name}"
            if not isinstance(entry, dict):
                raise wrong(self.file, where, "no object", "values, unit and type")
            unit, values = entry.get("unit"), entry.get("values")
            if entry.get("type") in _KINDS:
                column = _numbers(values, (count,), where, self.file)
                symbol = None if unit is None else _symbol(unit, where, self.file)
                if (
                    _KINDS[entry["type"]] != "f8"
                    and not ((np.abs(column) < 1 << 31) & (column == np.round(column))).all()
                ):
                    raise wrong(self.file, where, "codes that are no whole numbers", "codes")
                found[name] = (column.astype(_KINDS[entry["type"]]), symbol)
            elif isinstance(values, list) and all(isinstance(v, str) for v in values):
                found[name] = (values, None)
            else:
                raise wrong(self.file, where, "no numbers and no text", "values, unit and type")
        return found

    def declare_inputs(
        self, writer: TrajectoryWriter, *, n_frames: int
    ) -> dict[str, NDArray[np.float64]]:
        """Declare the inputs and return their values, (T, C) each."""
        found = {}
        for name, entry in _object(self.keys, _INPUTS, self.file).items():
            where = f"{_INPUTS}/{name}"
            columns = entry.get("columns") if isinstance(entry, dict) else None
            if not isinstance(columns, list) or not columns:
                raise wrong(self.file, where, "no columns", "columns, unit, quantity, values")
            texts = [*columns, *_list(entry.get("targets", []), where, self.file)]
            if not all(isinstance(text, str) for text in [*texts, entry.get("quantity", "")]):
                raise wrong(self.file, where, "names that are no text", "text")
            shape = (n_frames, len(columns))
            found[name] = _numbers(entry.get("values"), shape, where, self.file)
            held: dict[str, Any] = {}
            if "sequence" in entry:
                rows = len(_list(entry["sequence"], where, self.file))
                held["sequence"] = _numbers(
                    entry["sequence"], (rows, len(columns)), where, self.file
                )
                held["hold"], held["start"] = _numbers(
                    [entry.get("hold"), entry.get("start", 0.0)], (2,), where, self.file
                ).tolist()
            writer.declare_input(
                name,
                columns,
                quantity=entry.get("quantity", ""),
                unit=_symbol(entry.get("unit", "1"), where, self.file),
                targets=entry.get("targets", []),
                **held,
            )
        return found


def read(keys: Mapping[str, Any], *, n_nodes: int, file: Path) -> Said:
    """Return what a frame says under ``openprc:`` keys.

    Raises
    ------
    SchemaError
        When a value does not fit.
    """
    unit = _object(keys, _NODES, file).get("unit")
    bars = _object(keys, "openprc:bars", file) if "openprc:bars" in keys else None
    n_bars = None
    n_edges = len(_list(keys.get("edges_vertices", []), "edges_vertices", file))
    if bars is not None or "openprc:nodes" in keys:
        n_bars = 0 if bars is None else bars.get("count")
        if type(n_bars) is not int or not 0 <= n_bars <= n_edges:
            raise wrong(file, "openprc:bars/count", f"found {n_bars!r}", f"0 to {n_edges}")
    hinges = faces = None
    if "openprc:hinges" in keys or "openprc:nodes" in keys:
        hinges = _table(keys, "openprc:hinges", 4, n_nodes, file)
    if "openprc:faces" in keys:
        faces = _table(keys, "openprc:faces", 3, n_nodes, file)
    symbol = None if unit is None else _symbol(unit, _NODES, file)
    return Said(symbol, n_bars, hinges, faces, keys, file, n_nodes)


def _table(keys: Mapping[str, Any], name: str, width: int, n_nodes: int, file: Path) -> Ints:
    """Return the (E, width) vertices of elements, none where the key is not there."""
    key = f"{name}/vertices"
    rows = [
        vertices(row, n_nodes, key=f"{key}/{n}", file=file)
        for n, row in enumerate(_list(_object(keys, name, file).get("vertices", []), key, file))
    ]
    if any(len(row) != width for row in rows):
        raise wrong(file, key, "a row of another length", f"{width} vertices")
    return np.array(rows, dtype=np.int64).reshape(-1, width)


def clock(keys: Mapping[str, Any], *, file: Path) -> tuple[str, str]:
    """Return unit and kind of the instants."""
    said = _object(keys, _CLOCK, file)
    unit, kind = said.get("unit", "s"), said.get("kind", "physical")
    if kind not in ("physical", "pseudo"):
        raise wrong(file, _CLOCK, f"kind {kind!r}", "physical or pseudo")
    return _symbol(unit, _CLOCK, file), kind


def _object(keys: Mapping[str, Any], name: str, file: Path) -> Mapping[str, Any]:
    value = keys.get(name, {})
    if not isinstance(value, dict):
        raise wrong(file, name, f"a JSON {type(value).__name__}", "an object")
    return value


def _list(value: Any, key: str, file: Path) -> list[Any]:
    if not isinstance(value, list):
        raise wrong(file, key, f"found {str(value)[:40]}", "a list")
    return value


def _symbol(value: Any, key: str, file: Path) -> str:
    if not isinstance(value, str) or value not in UNITS:
        raise wrong(file, key, f"the unit {value!r}", "a unit of the file contract")
    return value


def _numbers(value: Any, shape: tuple[int, ...], key: str, file: Path) -> NDArray[np.float64]:
    """Return finite numbers of a shape."""
    try:
        array = np.array(_list(value, key, file), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise wrong(file, key, "something that is no number", f"numbers of shape {shape}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise wrong(
            file,
            key,
            f"{'finite' if np.isfinite(array).all() else 'other'} numbers of shape {array.shape}",
            f"finite numbers of shape {shape}",
        )
    return array
