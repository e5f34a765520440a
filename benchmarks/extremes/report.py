"""The table of the study: rows are extremes, columns integrators, and what users are told."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from cells import Cell, Extreme
from rich.table import Table

#: Short words for the cells.
SHORT = {
    "exact": "exact",
    "accurate": "{error:.0e}",
    "inaccurate, told": "{error:.0e} told",
    "refused": "refused",
    "diverged, told": "diverged {at:.2g} s",
    "SILENT": "SILENT {error:.0e}",
}
_NUMBER = re.compile(r"(?<![\w'])-?\d[\d,]*\.?\d*(?:e[+-]?\d+)?(?![\w'])")


def short(cell: Cell | None) -> str:
    """Return what stands in the table; a dash where the row does not have the column."""
    if cell is None:
        return "-"
    nan = float("nan")
    error = nan if cell.error is None else cell.error
    return SHORT[cell.kind].format(error=error, at=nan if cell.at is None else cell.at)


def columns_of(cells: Iterable[Cell]) -> list[tuple[str, str]]:
    """Return (integrator, precision) of all columns, in the order of the cells."""
    found = dict.fromkeys((cell.precision, cell.integrator) for cell in cells)
    return [(integrator, precision) for precision, integrator in sorted(found, key=_is_single)]


def _is_single(column: tuple[str, str]) -> bool:
    return column[0] == "float32"


def lines_of(
    rows: Sequence[Extreme], cells: Sequence[Cell], columns: Sequence[tuple[str, str]]
) -> list[list[str]]:
    """Return the lines of the table, each with the row's name and level first."""
    by_place = {(c.name, c.level, c.integrator, c.precision): c for c in cells}
    return [
        [row.name, row.level, *(short(by_place.get((row.name, row.level, *c))) for c in columns)]
        for row in rows
        if any((row.name, row.level, *c) in by_place for c in columns)
    ]


def tables(rows: Sequence[Extreme], cells: Sequence[Cell]) -> list[Table]:
    """Return a table for each precision."""
    made = []
    for precision in ("float64", "float32"):
        columns = [c for c in columns_of(cells) if c[1] == precision]
        lines = lines_of(rows, cells, columns)
        if not lines:
            continue
        table = Table(title=f"extremes in {precision}", title_justify="left")
        for name in ("extreme", "level", *(integrator for integrator, _ in columns)):
            table.add_column(name, overflow="fold")
        for line in lines:
            table.add_row(*line)
        made.append(table)
    return made


def markdown(rows: Sequence[Extreme], cells: Sequence[Cell]) -> str:
    """Return tables, measures and messages."""
    parts = [
        'A number is the error that the row\'s measure says; "exact" is an error of at most 1e-9.'
        ' "told" stands where the user was warned of it in words, "refused" where nothing was run,'
        ' "diverged" where the run was stopped at that time and left no result.'
        ' "SILENT" would be a wrong result without a word.'
    ]
    for precision in ("float64", "float32"):
        columns = [c for c in columns_of(cells) if c[1] == precision]
        lines = lines_of(rows, cells, columns)
        if not lines:
            continue
        head = ["extreme", "level", *(integrator for integrator, _ in columns)]
        parts.append(f"## {precision}\n\n" + _grid([head, *lines]))
    measures: dict[str, list[str]] = {}
    for row in rows:
        measures.setdefault(row.measure, []).append(row.name)
    parts.append(
        "## What the error is\n\n"
        + "\n".join(
            f"- {', '.join(dict.fromkeys(names))}: {measure}" for measure, names in measures.items()
        )
    )
    parts.append(
        "## What users are told\n\n"
        + "\n".join(
            f"- {kind} ({count} cells; {where}): {text}"
            for kind, text, count, where in messages(cells)
        )
    )
    return "\n\n".join(parts) + "\n"


def _grid(lines: Sequence[Sequence[str]]) -> str:
    rule = ["---"] * len(lines[0])
    return "\n".join("| " + " | ".join(line) + " |" for line in (lines[0], rule, *lines[1:]))


def messages(cells: Iterable[Cell]) -> list[tuple[str, str, int, str]]:
    """Return messages that differ in more than numbers: kind, an example, how often, where."""
    found: dict[tuple[str, str], list[tuple[str, Cell]]] = {}
    for cell in cells:
        for text in cell.messages:
            kind = cell.kind if cell.kind in ("refused", "diverged, told") else "remark"
            words = re.sub(r"'[a-z0-9-]+'", "''", _NUMBER.sub("#", text))
            found.setdefault((kind, words), []).append((text, cell))
    return sorted(
        (kind, uses[0][0], len(uses), f"{uses[0][1].name}, {uses[0][1].level}")
        for (kind, _), uses in found.items()
    )


def summary(cells: Sequence[Cell]) -> dict[str, int]:
    """Return how many cells ended with each of the closed words."""
    counts = dict.fromkeys(SHORT, 0)
    for cell in cells:
        counts[cell.kind] += 1
    return counts
