"""How ``openprc compare`` shows a report: one table, and what there is to say about its rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from openprc.cli.console import console, printable, table

if TYPE_CHECKING:
    from openprc.compare.report import Report

_FIGURES = {
    "narma2_nrmse": "NARMA2",
    "narma10_nrmse": "NARMA10",
    "volterra2_nrmse": "Volterra",
    "memory_capacity": "memory",
    "ipc": "IPC",
}


def show_report(report: Report, *, unit: str, factor: float, written: Sequence[Path]) -> None:
    """Print a report.

    Parameters
    ----------
    unit : str
        Of the lengths in the table.
    factor : float
        How many of it are a metre.
    """
    out = console()
    if report.unit != "m":  # pixels, for instance, are no lengths to be converted
        unit, factor = report.unit, 1.0
    figures = [key for key in _FIGURES if any(key in one.figures for one in report.scores.values())]
    columns = [
        "run",
        escape(f"rms [{unit}]"),
        "of motion",
        escape(f"largest [{unit}]"),
        "at",
        "means",
    ]
    if report.probes:
        columns.append("known figures")
    columns += [_FIGURES[key] for key in figures]
    if report.runs:
        columns.append(escape("CPU [s]"))
    rows = [_row(report, name, figures, factor=factor) for name in report.names]
    out.print(table(columns, rows, title=escape(printable(report.title))))
    out.print(printable(report.what), markup=False)
    for line in _lines(report):
        out.print(line, markup=False)
    for path in written:
        out.print(f"written: {path}", markup=False)


def _row(report: Report, name: str, figures: Sequence[str], *, factor: float) -> list[Any]:
    run, pair = report.run(name), report.pair(name)
    row: list[Any] = [name]
    if pair is not None:
        node, time = pair.largest_at
        row += [factor * pair.rms, pair.relative_rms, factor * pair.largest, f"{node}, {time:.4g}"]
        judged = report.divergences.get(name)
        row.append("" if judged is None else _verdict(judged))
    elif run is not None and run.path is None:
        row += [None, None, None, "", run.status]
    else:
        row += [None, None, None, "", "reference" if name == report.reference else "not compared"]
    if report.probes:
        row.append(_probes(report, name))
    scores = report.scores.get(name)
    row += [None if scores is None else scores.figures.get(key) for key in figures]
    if report.runs:
        row.append(None if run is None else run.cpu_seconds)
    return row


def _verdict(judged: Any) -> str:
    if judged.horizon is None:
        return str(judged.verdict)
    return f"{judged.verdict} from {judged.horizon:.4g} s"


def _probes(report: Report, name: str) -> str:
    results = report.probes.get(name, ())
    told = [one for one in results if one.within is not None]
    if not told:
        return "-"
    within = sum(bool(one.within) for one in told)
    return f"{within} of {len(told)} within"


def _lines(report: Report) -> Iterator[str]:
    for run in report.runs:
        if run.path is None:
            yield f"{run.name}: {run.status}: {printable(run.reason)}"
    for name, judged in report.divergences.items():
        yield f"{name}: {judged.text}"
        if judged.horizon is not None:
            yield f"  up to then the rms difference is {judged.rms_before:.3g} {report.unit}"
    for name in report.files:
        for remark in report.remarks(name):
            yield f"{name}: {printable(remark)}"
    for name, results in report.probes.items():
        for one in results:
            if one.within:
                continue
            found = (
                one.reason
                if one.measured is None
                else f"{one.measured:.8g} {one.unit}, off by {one.deviation:.2g} of the"
                f" {one.tolerance:.2g} allowed"
            )
            yield f"{name}: {one.name} is {one.expected:.8g} {one.unit}; here {found}"
    for run in report.runs:
        for word, told in (("leaves out", run.leaves_out), ("adds", run.adds)):
            if told and run.status == "ok":
                yield f"{run.name} {word}: {printable('; '.join(told))}"
    reasons: dict[str, tuple[dict[str, None], dict[str, None]]] = {}
    for name, scores in report.scores.items():
        for figure, why in scores.skipped.items():
            names, figures = reasons.setdefault(why, ({}, {}))
            names[name], figures[_FIGURES.get(figure, figure)] = None, None
    for why, (names, figures) in reasons.items():
        yield f"{', '.join(names)}: not scored on {', '.join(figures)}: {printable(why)}"
    for note in report.notes:
        yield f"note: {printable(note)}"


__all__ = ["show_report"]
