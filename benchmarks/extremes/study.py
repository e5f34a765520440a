"""What becomes of extreme scenes: every integrator, to which error, and what a user is told.

    python benchmarks/extremes/study.py [--only NAME ...] [--quick] [--json FILE] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import fold_rows
import linear_rows
import motion_rows
import rigid_rows
import step_rows
from cells import Cell, Extreme, run_cell
from rich.console import Console

PAGES = (linear_rows, fold_rows, step_rows, motion_rows, rigid_rows)


def every_row() -> list[Extreme]:
    """Return all rows."""
    return [row for page in PAGES for row in page.rows()]


def main() -> None:
    """Run the study and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[])
    parser.add_argument("--ways", nargs="+", default=[])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    rows = [r for r in every_row() if not options.quick or r.quick]
    if options.only:
        rows = [r for r in rows if any(word in r.name for word in options.only)]
    console = Console(width=200)
    cells: list[Cell] = []
    for row in rows:
        for way in row.ways:
            if options.ways and way.integrator not in options.ways:
                continue
            cell = run_cell(row, way)
            cells.append(cell)
            console.print(
                f"{row.name:28} {row.level:16} {way.integrator:15} {way.precision} {cell.text:34}"
                f" {'' if cell.error is None else format(cell.error, '.1e'):8} {cell.seconds:6.2f} s"
            )
            for message in cell.messages:
                print("      ", message[:300])
            sys.stdout.flush()
    if options.json:
        options.json.write_text(json.dumps([cell.as_dict() for cell in cells], indent=1))


if __name__ == "__main__":
    main()
