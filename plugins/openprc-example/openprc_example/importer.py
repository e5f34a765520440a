"""CSV to simulation.h5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_example.columns import TIME_NAMES, Group, Layout, find_layout
from openprc_example.symbols import recover_symbols
from openprc_example.table import Table, parse_head, read_table

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_SNIFFED_BYTES = 1 << 16
#: A logged pose has a reader that knows what the quaternion means.
_POSE = {"qx", "qy", "qz", "qw"}
#: Rows handed to the writer at once.
_BLOCK = 4096


class CsvImporter:
    """Reads a table with a header, one row a frame."""

    def sniff(self, path: Path) -> float:
        """Return 0.7 for a header with a time column and numbers below it, 0.3 for the name."""
        path = Path(path)
        by_name = 0.3 if path.suffix.lower() in (".csv", ".tsv") else 0.0
        try:
            with path.open("rb") as stream:
                raw = stream.read(_SNIFFED_BYTES)
        except OSError:
            return 0.0
        if not raw:
            return by_name
        if b"\0" in raw:
            return 0.0
        lines = raw.decode("utf-8-sig", errors="replace").splitlines()
        head = parse_head(enumerate(lines, start=1))
        if head is None or len(lines) < head.first_line:
            return by_name
        names = [column.name.lower() for column in head.columns]
        cells = lines[head.first_line - 1].split(head.delimiter)
        try:
            time = [float(cells[names.index(name)]) for name in TIME_NAMES if name in names]
        except (ValueError, IndexError):
            return by_name
        if not time or len(names) < 2 or len(cells) != len(names):
            return by_name
        return 0.3 if _POSE.issubset(names) else 0.7

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the table at `path`.

        Raises
        ------
        UnreadableFile
            The table is damaged; the message names line and column.
        ConfigError
            An option is missing or contradicts the file.
        UnitError
            A unit is not one that the contract knows.
        """
        table = read_table(Path(path))
        layout = find_layout(table.columns, inputs=options.get("input") or (), path=table.path)
        time = _time(table, layout, writer, dt=options.get("dt"))
        kind = "pseudo" if layout.time_unit == "1" else "physical"
        writer.declare_time(unit=layout.time_unit, kind=kind)
        positions, observed = _nodes(table, layout, writer, unit=options.get("unit"))
        for name, group in layout.channels.items():
            writer.declare_channel(name, group.names, unit=group.unit or "arb")
        for name, group in layout.inputs.items():
            _declare_input(name, group, table, time, writer, hold=options.get("hold"))
        if options.get("hold") is not None and not layout.inputs:
            raise ConfigError(
                "a hold is given and the table has no input",
                expected="a column u, or the option input",
                fix="name the column that drove the body with the option input",
                file=table.path,
                key="hold",
            )
        for start in range(0, len(time), _BLOCK):
            rows = slice(start, start + _BLOCK)
            writer.append(
                time[rows],
                positions=None if positions is None else positions[rows],
                observed=None if observed is None else observed[rows],
                channels={n: table.values[rows, g.places] for n, g in layout.channels.items()},
                inputs={n: table.values[rows, g.places] for n, g in layout.inputs.items()},
            )


def _time(
    table: Table, layout: Layout, writer: TrajectoryWriter, *, dt: float | None
) -> NDArray[np.float64]:
    """Return the clock, (T,), from the time column, from `dt`, or checked against both."""
    index = np.arange(len(table.values), dtype=np.float64)
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise ConfigError(
            f"dt is {dt}", expected="a number above 0", fix="correct it", file=table.path, key="dt"
        )
    if layout.time is None:
        if dt is None:
            raise ConfigError(
                "the table has no column t or time",
                expected="a time column, or the time between two rows",
                fix="pass the option dt",
                file=table.path,
                key="dt",
            )
        return index * dt
    time: NDArray[np.float64] = table.values[:, layout.time]
    wrong = np.flatnonzero(~(np.diff(time, prepend=-np.inf) > 0))
    if len(wrong):
        row = int(wrong[0])
        before = f" after {float(time[row - 1])}" if row else ""
        table.fail(
            f"time is {float(time[row])}{before}",
            row=row,
            column=layout.time,
            expected="time that increases from row to row",
            fix="remove or sort the rows",
        )
    if dt is None:
        return time
    even: NDArray[np.float64] = time[0] + index * dt
    deviation = float(np.abs(time - even).max())
    if deviation > 0.1 * dt:
        row = int(np.argmax(np.abs(time - even) > 0.1 * dt))
        table.fail(
            f"time is {float(time[row])}, and {float(even[row])} with dt = {dt}",
            row=row,
            column=layout.time,
            expected="times that the option dt agrees with to a tenth of a step",
            fix="leave dt out to take the times as they are",
        )
    writer.note(
        f"the time column was replaced with an even one of dt = {dt} as asked; the two differ "
        f"by up to {deviation:.3g}"
    )
    return even


def _nodes(
    table: Table, layout: Layout, writer: TrajectoryWriter, *, unit: str | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.uint8] | None]:
    """Declare the nodes; return positions (T, N, D) and the mask (T, N), if there are any."""
    if not layout.coordinates:
        return None, None
    if unit is not None and layout.unit not in (None, unit):
        raise ConfigError(
            f"the option says {unit!r} and the header says {layout.unit!r}",
            expected="one unit",
            fix="leave the option out; it is for headers that do not say",
            file=table.path,
            key="unit",
        )
    unit = unit or layout.unit
    if unit is None:
        raise ConfigError(
            "nothing says which unit the coordinates have",
            expected="a header such as x0 [mm], or the option unit",
            fix="pass unit=m, mm, px, ... or arb if there is none",
            file=table.path,
            key="unit",
        )
    ids = list(layout.coordinates)
    positions = table.values[:, [layout.coordinates[node] for node in ids]]
    observed = np.asarray(np.isfinite(positions).all(axis=2), dtype=np.uint8)
    for node, place in layout.seen.items():
        _merge_seen(table, observed[:, ids.index(node)], place)
    partial = np.isfinite(positions).any(axis=2) & (observed == 0)
    if partial.any():
        writer.note(
            f"{int(partial.sum())} places have some coordinates only, or are marked as not "
            "seen; they count as missing"
        )
    positions[observed == 0] = np.nan
    gaps = bool((observed != 1).any())
    writer.declare_nodes(
        len(ids),
        layout.dims,
        unit=unit,
        frame="image" if unit == "px" else "world",
        observed=gaps,
        ids=None if ids == list(range(len(ids))) else ids,
    )
    return positions, observed if gaps else None


def _merge_seen(table: Table, observed: NDArray[np.uint8], place: int) -> None:
    marks = table.values[:, place]
    wrong = np.flatnonzero(~np.isin(marks, (0, 1, 2)) | ((marks > 0) & (observed == 0)))
    if len(wrong):
        table.fail(
            f"the mark is {float(marks[wrong[0]])}",
            row=int(wrong[0]),
            column=place,
            expected="0 missing, 1 measured, 2 filled in; 0 where a coordinate is missing",
            fix="correct the cell",
        )
    observed[:] = marks


def _declare_input(
    name: str,
    group: Group,
    table: Table,
    time: NDArray[np.float64],
    writer: TrajectoryWriter,
    *,
    hold: float | None,
) -> None:
    values = table.values[:, group.places]
    gaps = np.argwhere(~np.isfinite(values))
    if len(gaps):
        row, column = gaps[0]
        table.fail(
            "the input is missing",
            row=int(row),
            column=group.places[column],
            expected="what drove the body, in every row",
            fix="fill the cell in, or rename the column if it is a measurement with gaps",
        )
    symbols = None
    if hold is not None:
        symbols = recover_symbols(time, values, hold=hold, path=table.path, name=name)
        writer.note(f"input {name!r}: {len(symbols)} symbols held for {hold} each were recovered")
    writer.declare_input(
        name,
        group.names,
        quantity="drive",
        unit=group.unit or "arb",
        sequence=symbols,
        hold=hold,
        start=float(time[0]),
    )
