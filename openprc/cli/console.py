"""Printing: tables and progress for people, JSON for programs."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from openprc.hooks.protocols import Progress as Report
from openprc.schema.findings import Finding

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
force_option = click.option("--force", is_flag=True, help="Replace an existing result.")

_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
_STYLE = {"error": "bold red", "warning": "yellow", "hint": "cyan"}


def console() -> Console:
    """Return a console for standard output; plain when that is not a terminal."""
    # A pipe has no width; 80 columns would cut tables that a log can hold.
    width = None if sys.stdout.isatty() else 160
    return Console(width=width, highlight=False, soft_wrap=False, emoji=False)


def print_json(data: Any) -> None:
    """Print plain values as JSON; NaN and infinity become null."""
    click.echo(json_text(data))


def json_text(data: Any) -> str:
    """Return plain values as JSON; NaN and infinity become null."""
    return json.dumps(_finite(data), indent=2)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, np.generic):
        return _finite(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, str | int | float | bool):
        return value
    return str(value)


def table(columns: Sequence[str], rows: Sequence[Sequence[Any]], *, title: str = "") -> Table:
    """Return a table; numbers stand on the right."""
    made = Table(title=title or None, title_justify="left", header_style="bold", pad_edge=False)
    for index, name in enumerate(columns):
        numeric = bool(rows) and all(_is_number(row[index]) for row in rows)
        made.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        # Text, because rich would take "[mm]" in a plain string for a style and drop it.
        made.add_row(*[Text(_cell(value)) for value in row])
    return made


def _is_number(value: Any) -> bool:
    return value in (None, "") or (isinstance(value, int | float) and not isinstance(value, bool))


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else printable(str(value))


def printable(text: str) -> str:
    """Return text from a file without what a terminal would obey or could not encode."""
    return _UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text)


def print_findings(out: Console, findings: Sequence[Finding]) -> None:
    """Print findings, one block each."""
    for item in findings:
        where = escape(printable(item.path))
        head = f"[{_STYLE[item.level]}]{item.level}[/] {item.code} [bold]{where}[/]: "
        out.print(head, end="")
        out.print(printable(item.found), markup=False)
        if item.expected:
            out.print(f"  expected: {item.expected}", markup=False)
        if item.fix:
            out.print(f"  to do: {item.fix}", markup=False)


@contextmanager
def progress_bar(title: str, *, hidden: bool) -> Iterator[Report]:
    """Show a progress bar on standard error; yield the function that moves it."""
    out = Console(stderr=True)
    if hidden or not out.is_terminal:
        yield lambda fraction, message: None
        return
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TimeRemainingColumn(), console=out, transient=True,
    )  # fmt: skip
    with bar:
        task = bar.add_task(title, total=1.0)
        yield lambda fraction, message: bar.update(
            task, completed=fraction, description=f"{title} {message}".strip()
        )


@contextmanager
def spinner(title: str, *, hidden: bool) -> Iterator[None]:
    """Show that something is going on, on standard error."""
    out = Console(stderr=True)
    if hidden or not out.is_terminal:
        yield
        return
    with out.status(title):
        yield
