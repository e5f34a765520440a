"""What becomes of extreme scenes: every integrator, to which error, and what a user is told.

    python benchmarks/extremes/study.py [--only NAME ...] [--integrators NAME ...] [--quick]
                                        [--json FILE] [--markdown FILE]

Every cell is a run from an experiment folder to ``simulation.h5``. It ends with one of six
words: "exact", "accurate", "inaccurate, told", "refused", "diverged, told" and "SILENT", the last
of which is a defect: a wrong result, or one that is not finite, without a word. The program ends
with status 1 when there is such a cell.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import fold_rows
import linear_rows
import motion_rows
import producer_rows
import rigid_rows
import step_rows
from cells import COLUMNS, Cell, Extreme, run_cell
from report import markdown, short, summary, tables
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

PAGES = (linear_rows, fold_rows, step_rows, motion_rows, rigid_rows)


def chosen_rows(*, only: list[str], quick: bool) -> list[Extreme]:
    """Return the rows that were asked for; a word chooses all names that it is part of."""
    rows = [row for page in PAGES for row in page.rows()]
    return [
        row
        for row in rows
        if (row.quick or not quick) and (not only or any(word in row.name for word in only))
    ]


def main() -> None:
    """Run the study and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--integrators", nargs="+", choices=COLUMNS, default=list(COLUMNS))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--markdown", type=Path, metavar="FILE")
    options = parser.parse_args()
    rows = chosen_rows(only=options.only, quick=options.quick)
    todo = [(row, way) for row in rows for way in row.ways if way.integrator in options.integrators]
    producers = [] if options.only and "producers" not in options.only else producer_rows.todo()
    console = Console(width=None if sys.stdout.isatty() else 200)
    cells: list[Cell] = []
    columns = TextColumn("{task.description:60}"), BarColumn(), MofNCompleteColumn()
    with Progress(
        *columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task("", total=len(todo) + len(producers))
        for row, way in todo:
            bar.update(task, description=f"{row.name} {row.level}: {way.integrator}")
            cells.append(run_cell(row, way))
            bar.advance(task)
            if options.markdown:  # a long study can be read while it goes on
                options.markdown.write_text(markdown(rows, cells))
        others = []
        for place in producers:
            bar.update(task, description=f"{place.name} {place.level}: {place.producer}")
            others.append(producer_rows.run(place))
            bar.advance(task)
    for table in tables(rows, cells):
        console.print(table)
    if others:
        console.print(producer_rows.table(others))
    counts = summary([*cells, *others])
    console.print(", ".join(f"{count} {kind}" for kind, count in counts.items()))
    for cell in [cell for cell in [*cells, *others] if cell.kind == "SILENT"]:
        console.print(f"{cell.name}, {cell.level}, {cell.integrator}: {short(cell)}")
    data = {"counts": counts, "cells": [cell.as_dict() for cell in [*cells, *others]]}
    if options.json:
        options.json.write_text(json.dumps(data, indent=1))
    if options.markdown:
        options.markdown.write_text(markdown(rows, cells) + producer_rows.markdown(others))
    raise SystemExit(1 if counts["SILENT"] else 0)


if __name__ == "__main__":
    main()
