"""What a producer says it has, before the first frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from openprc.schema import units
from openprc.schema.declared_values import DeclaredValues, is_text
from openprc.schema.layout import ELEMENT_ARITY, TIME_AXIS
from openprc.schema.plain_text import storable
from openprc.schema.streams import Stream


class Declarations(DeclaredValues):
    """The declaring half of `TrajectoryWriter`; plain bookkeeping, no file is touched."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.streams: dict[str, Stream] = {}
        self.static: dict[str, tuple[Any, dict[str, Any]]] = {}
        self.group_attrs: dict[str, dict[str, Any]] = {}
        self.dims = 0
        self._n_nodes = 0
        self._time: tuple[str, str] | None = None
        self._frozen = False

    # --- clock ---------------------------------------------------------------------------

    def declare_time(
        self, *, unit: str = "s", kind: Literal["physical", "pseudo"] = "physical"
    ) -> None:
        """Say what time means: physical in a unit of time, or pseudo (load steps, unit "1")."""
        self._open_for("declare_time")
        measured = units.unit(unit, file=str(self.path), key="/time_series/time").dimension
        wanted = {"physical": "time", "pseudo": "number"}.get(kind)
        if wanted is None:
            raise self._error("/time_series/time", f"kind {kind!r}", "physical or pseudo")
        if measured != wanted:
            raise self._error(
                "/time_series/time", f"{kind} time in {unit!r}", f"a unit of {wanted}"
            )
        self._time = (unit, kind)

    # --- nodes ---------------------------------------------------------------------------

    def declare_nodes(
        self,
        n_nodes: int,
        dims: int,
        *,
        unit: str,
        axes: str | None = None,
        frame: str = "world",
        dtype: Literal["f8", "f4"] = "f8",
        velocities: bool = False,
        velocity_unit: str | None = None,
        observed: bool = False,
        rest: ArrayLike | None = None,
        mass: ArrayLike | None = None,
        mass_unit: str = "kg",
        fixed: ArrayLike | None = None,
        ids: Sequence[int] | None = None,
        labels: Sequence[str] | None = None,
    ) -> None:
        """Declare N nodes in D dimensions.

        Parameters
        ----------
        n_nodes, dims : int
            D is what was measured, 2 or 3: never a padded column of zeros.
        unit : str
            Of positions and `rest`.
        axes : str
            Comma-separated names, ``"x,y,z"`` by default.
        velocities, observed : bool
            Whether append() will give them.
        rest : (N, D) [unit]
        mass : (N,) [mass_unit]
        fixed : (N,) bool
        ids, labels : length N, unique
        """
        self._open_for("declare_nodes")
        key = "/time_series/nodes/positions"
        if dims not in (2, 3):
            raise self._error(key, f"{dims} dimensions", "2 or 3")
        if n_nodes < 1 or n_nodes != int(n_nodes):
            raise self._error(key, f"{n_nodes} nodes", "at least one node")
        if dtype not in ("f8", "f4"):
            raise self._error(key, f"dtype {dtype!r}", "'f8' or 'f4'")
        dims, n_nodes = int(dims), int(n_nodes)
        names = tuple(name.strip() for name in (axes or "x,y,z"[: 2 * dims - 1]).split(","))
        if len(names) != dims or len(set(names)) != dims:
            raise self._error(key, f"axes {names}", f"{dims} different names")
        names = self._columns(key, names)
        frame = storable(frame, key=key, file=self.path)
        self._stream(
            key, (n_nodes, dims), dtype, {**self._unit(unit, key), "frame": frame, "axes": names}
        )
        self.dims, self._n_nodes = dims, n_nodes
        if velocities:
            path = "/time_series/nodes/velocities"
            speed = velocity_unit or units.velocity_unit(unit)
            self._stream(path, (n_nodes, dims), dtype, self._unit(speed, path))
        if observed:
            self._stream("/time_series/nodes/observed", (n_nodes,), "u1", {})
        base = "/topology/nodes/"
        if rest is not None:
            attrs = self._unit(unit, base + "rest")
            self._put(base + "rest", self._floats(base + "rest", rest, (n_nodes, dims)), attrs)
        if mass is not None:
            values = self._floats(base + "mass", mass, (n_nodes,))
            if (values < 0).any():
                raise self._error(base + "mass", "a negative mass", "masses of 0 or more")
            self._put(base + "mass", values, self._unit(mass_unit, base + "mass"))
        if fixed is not None:
            flags = np.asarray(fixed, dtype=bool).astype("u1")
            self._shape(base + "fixed", flags.shape, (n_nodes,))
            self._put(base + "fixed", flags, {})
        if ids is not None:
            numbers = np.asarray(ids)
            if numbers.dtype.kind not in "iu":
                raise self._error(base + "id", f"ids of type {numbers.dtype}", "integers")
            self._unique(base + "id", numbers.tolist(), n_nodes)
            self._put(base + "id", numbers.astype("i8"), {})
        if labels is not None:
            text = self._text(base + "label", labels)
            self._unique(base + "label", text.tolist(), n_nodes)
            self._put(base + "label", text, {})

    # --- elements, channels, whole body ------------------------------------------------------

    def declare_elements(
        self,
        kind: str,
        indices: ArrayLike,
        *,
        series: Mapping[str, str] | None = None,
        widths: Mapping[str, int] | None = None,
        static: Mapping[str, tuple[ArrayLike, str | None]] | None = None,
        dtype: Literal["f8", "f4"] = "f8",
    ) -> None:
        """Declare elements between nodes.

        Parameters
        ----------
        kind : str
            ``bars``, ``bends``, ``faces``, ``hinges`` or another name.
        indices : (E, k) int
            Nodes counted from 0; hinges name the crease first, then the two wings; bends
            have their vertex in the middle.
        series : mapping of quantity to unit
            What append() will give for every frame, (E,) each.
        widths : mapping of quantity to k
            For quantities of shape (E, k).
        static : mapping of property to ((E,) array, unit or None for codes and names)
        dtype : {"f8", "f4"}
            Of the series.
        """
        self._open_for("declare_elements")
        key = f"/topology/{self._name(kind, '/topology')}/indices"
        if kind == "nodes":
            raise self._error(key, "elements named 'nodes'", "bars, bends, faces, hinges, ...")
        if dtype not in ("f8", "f4"):
            raise self._error(key, f"dtype {dtype!r}", "'f8' or 'f4'")
        table = np.asarray(indices)
        if table.ndim != 2 or table.dtype.kind not in "iu":
            raise self._error(key, f"{table.dtype} of shape {table.shape}", "(E, k) integers")
        arity = ELEMENT_ARITY.get(kind)
        if arity is not None and table.shape[1] != arity:
            raise self._error(key, f"{table.shape[1]} nodes an element", f"{arity} for {kind}")
        if table.size and (table.min() < 0 or table.max() >= self._n_nodes):
            raise self._error(
                key,
                f"node {int(table.min() if table.min() < 0 else table.max())}",
                f"0 to {self._n_nodes - 1} (declare the nodes first)",
            )
        double = np.flatnonzero((np.diff(np.sort(table, axis=1), axis=1) == 0).any(axis=1))
        if double.size:
            first = int(double[0])
            raise self._error(
                key, f"element {first} is {table[first].tolist()}", "no node twice in an element"
            )
        stray = sorted(set(widths or {}) - set(series or {}))
        if stray:
            raise self._error(key, f"a width for {stray[0]!r}", "widths of quantities in series")
        self._put(key, table.astype("i4"), {})
        for quantity, symbol in (series or {}).items():
            width = (widths or {}).get(quantity)
            path = f"/time_series/elements/{kind}/{self._name(quantity, key)}"
            if width is not None and width < 1:
                raise self._error(path, f"a width of {width}", "1 or more")
            row = (len(table),) if width is None else (len(table), int(width))
            self._stream(path, row, dtype, self._unit(symbol, path))
        for name, (values, unit) in (static or {}).items():
            path = f"/topology/{kind}/{self._name(name, key)}"
            array = self._constants(path, values)
            self._shape(path, array.shape, (len(table),))
            if array.dtype.kind == "f" and unit is None:
                raise self._error(path, "no unit", "a unit; '1' for plain numbers")
            self._put(path, array, {} if unit is None else self._unit(unit, path))

    def declare_channel(
        self, name: str, columns: Sequence[str], *, unit: str, quantity: str = ""
    ) -> None:
        """Declare a sensor with C named columns of one unit."""
        self._open_for("declare_channel")
        path = f"/time_series/channels/{self._name(name, '/time_series/channels')}"
        attrs = {**self._unit(unit, path), "columns": self._columns(path, columns)}
        if quantity:
            attrs["quantity"] = storable(quantity, key=path, file=self.path)
        self._stream(path, (len(columns),), "f8", attrs)

    def declare_system(self, name: str, *, unit: str = "J") -> None:
        """Declare a quantity of the whole body, one number a frame."""
        self._open_for("declare_system")
        path = f"/time_series/system/{self._name(name, '/time_series/system')}"
        self._stream(path, (), "f8", self._unit(unit, path))

    def declare_input(
        self,
        name: str,
        columns: Sequence[str],
        *,
        quantity: str,
        unit: str,
        targets: Sequence[str] = (),
        sequence: ArrayLike | None = None,
        hold: float | None = None,
        start: float = 0.0,
    ) -> None:
        """Declare what drives the body.

        Parameters
        ----------
        name : str
        columns : C names
        quantity : str
            position, force, torque, voltage, ...
        targets : names of what it acts on
        sequence : (K, C), optional
            The symbols before they were held or interpolated, symbol k from
            ``start + k hold`` on.
        hold, start : float
            In the unit of time.
        """
        self._open_for("declare_input")
        base = f"/inputs/{self._name(name, '/inputs')}"
        if isinstance(targets, str):
            raise self._error(base + "/value", f"targets {targets!r}", "a list of names")
        attrs: dict[str, Any] = {
            **self._unit(unit, base + "/value"),
            "columns": self._columns(base + "/value", columns),
            "quantity": storable(quantity, key=base + "/value", file=self.path),
            "targets": tuple(self._text(base + "/value", targets)),
        }
        self._stream(base + "/value", (len(columns),), "f8", attrs)
        if sequence is None:
            return
        path = base + "/sequence"
        symbols = self._numbers(path, sequence)
        symbols = symbols[:, np.newaxis] if symbols.ndim == 1 else symbols
        if symbols.ndim != 2 or symbols.shape[1] != len(columns) or len(symbols) == 0:
            raise self._error(path, f"shape {np.shape(sequence)}", f"(K, {len(columns)})")
        if not np.isfinite(symbols).all():
            raise self._error(path, "NaN or infinite symbols", "finite numbers")
        if hold is None or not 0 < hold < np.inf:
            raise self._error(path, f"hold {hold}", "the duration of one symbol, above 0")
        if not np.isfinite(start):
            raise self._error(path, f"start {start}", "the time at which symbol 0 begins")
        self._put(path, symbols, {"hold": float(hold), "start": float(start)})

    # --- extensions ----------------------------------------------------------------------------

    def declare_extension(self, distribution: str, version: str) -> None:
        """Open the subtree ``/extensions/<distribution>`` of a plugin."""
        self._open_for("declare_extension")
        owner = f"/extensions/{self._name(distribution, '/extensions')}"
        if not version:
            raise self._error(owner, "no version", "the version of the extension")
        self.group_attrs[owner] = {"version": storable(version, key=owner, file=self.path)}

    def put_extension(
        self, distribution: str, name: str, array: ArrayLike, *, unit: str = "1", comment: str = ""
    ) -> None:
        """Store an array below the plugin's own subtree."""
        self._open_for("put_extension")
        owner = f"/extensions/{distribution}"
        if owner not in self.group_attrs:
            raise self._error(owner, "not declared", "declare_extension() first")
        path = f"{owner}/{self._name(name, owner)}"
        data = self._text(path, array) if is_text(array) else np.asarray(array)
        if not is_text(array) and (data.dtype.kind not in "fiubcV" or data.dtype.hasobject):
            raise self._error(path, f"type {data.dtype}", "numbers or text")
        attrs = {} if is_text(array) else self._unit(unit, path)
        if comment:
            attrs["comment"] = storable(comment, key=path, file=self.path)
        self._put(path, data, attrs)

    def declare_extension_series(
        self,
        distribution: str,
        name: str,
        row_shape: Sequence[int],
        *,
        unit: str = "1",
        dtype: Literal["f8", "f4", "i8", "i4", "u1"] = "f4",
        comment: str = "",
    ) -> None:
        """Declare an array of the plugin's own subtree that grows with time, (T, ...).

        Parameters
        ----------
        distribution : str
            Of `declare_extension`.
        name : str
        row_shape : sequence of int
            Shape of what append() gives for one frame; ``()`` for one number.
        unit : str
        dtype : {"f8", "f4", "i8", "i4", "u1"}
            NaN marks what is missing in the types with a fraction.
        comment : str
        """
        self._open_for("declare_extension_series")
        owner = f"/extensions/{distribution}"
        if owner not in self.group_attrs:
            raise self._error(owner, "not declared", "declare_extension() first")
        path = f"{owner}/{self._name(name, owner)}"
        if dtype not in ("f8", "f4", "i8", "i4", "u1"):
            raise self._error(path, f"dtype {dtype!r}", "'f8', 'f4', 'i8', 'i4' or 'u1'")
        row = tuple(int(size) for size in row_shape)
        if min(row, default=1) < 1:
            raise self._error(path, f"a row of shape {row}", "sizes of 1 or more")
        if path in self.static:
            raise self._error(path, "declared twice", "one declaration")
        attrs: dict[str, Any] = {**self._unit(unit, path), TIME_AXIS: 0}
        if comment:
            attrs["comment"] = storable(comment, key=path, file=self.path)
        self._stream(path, row, dtype, attrs)

    # --- bookkeeping ---------------------------------------------------------------------------

    def freeze(self) -> None:
        """End the declaring and check that there is something to record.

        Raises
        ------
        SchemaError
            When neither nodes nor channels were declared.
        """
        recorded = [p for p in self.streams if p.startswith("/time_series/channels/")]
        if not self.dims and not recorded:
            raise self._error(
                "/time_series", "neither nodes nor channels were declared", "one of them"
            )
        unit, kind = self._time or ("s", "physical")
        time = Stream("/time_series/time", (), np.dtype("f8"), {"unit": unit, "kind": kind})
        self.streams = {"/time_series/time": time, **self.streams}
        self._frozen = True

    def _stream(self, path: str, row: tuple[int, ...], dtype: str, attrs: dict[str, Any]) -> None:
        if path in self.streams:
            raise self._error(path, "declared twice", "one declaration")
        self.streams[path] = Stream(path, row, np.dtype(dtype), attrs)

    def _put(self, path: str, data: Any, attrs: dict[str, Any]) -> None:
        if path in self.static or path in self.streams:
            raise self._error(path, "declared twice", "one declaration")
        self.static[path] = (data, attrs)

    def _open_for(self, method: str) -> None:
        if self._frozen:
            raise self._error("", f"{method}() after the first append()", "declarations first")
