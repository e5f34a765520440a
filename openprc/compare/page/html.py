"""The report as one HTML file: tables and pictures inside it, nothing from elsewhere."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from openprc import __version__
from openprc.compare.page import pictures
from openprc.compare.page.curves import energy_curves, spectrum_curves
from openprc.compare.runs.producers import COST_TEXT
from openprc.schema.atomic import atomic_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from openprc.compare.report import Report

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 68em; padding: 0 1em;
  color: #1a1a1a; background: #fff }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em }
table { border-collapse: collapse; font-size: 14px; display: block; overflow-x: auto }
th, td { padding: .3em .7em; border-bottom: 1px solid #ddd; text-align: left;
  vertical-align: top }
th { border-bottom: 2px solid #888 }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
img { max-width: 100%; height: auto } figure { margin: 0 }
figcaption, .small { color: #555; font-size: 13px }
.bad { color: #a40000 } .good { color: #00600f }
</style>
</head>
<body>
<h1>$title</h1>
<p>$what</p>
$body
<p class="small">OpenPRC $version. All numbers are in comparison.json.</p>
</body>
</html>
""")
#: Picture, heading, caption; each is left out where there is nothing to draw.
_PICTURES = (
    (
        pictures.error_over_time,
        "Difference over time",
        "Root mean square over nodes of the distance to the reference. Dotted: where it reaches"
        " 1 % of the scale.",
    ),
    (
        pictures.worst_traces,
        "Where runs differ most",
        "The node with the largest difference, along the axis on which it differs most.",
    ),
    (
        pictures.error_map,
        "Difference on the body",
        "Places of the reference when the difference is largest; open circles do not differ.",
    ),
    (spectrum_curves, "Spectra", "Summed over nodes and axes."),
    (energy_curves, "Energy", "As the runs recorded it."),
)


def save_page(report: Report, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the report as one HTML file, whole or not at all.

    Raises
    ------
    ResultExists
        When there is such a file and `overwrite` is false.
    MissingDependency
        When matplotlib is not installed.
    """
    target = Path(path)
    text = page_text(report)
    with atomic_file(target, overwrite=overwrite) as draft:
        draft.write_text(text, encoding="utf-8")
    return target


def page_text(report: Report) -> str:
    """Return the page; the files of the report have to be there still."""
    return _PAGE.substitute(
        title=_text(report.title),
        what=_text(report.what),
        body="\n".join(_sections(report)),
        version=_text(__version__),
    )


def _sections(report: Report) -> Iterator[str]:
    yield "<h2>Runs</h2>"
    yield _runs(report)
    if report.divergences:
        yield "<h2>What the differences mean</h2>"
        rows = [
            [name, judged.verdict, judged.text, judged.rms_before]
            for name, judged in report.divergences.items()
        ]
        yield _table(["run", "verdict", "why", f"rms up to then [{report.unit}]"], rows)
    if report.probes:
        yield "<h2>Known figures</h2>"
        yield _probes(report)
    if any(scores.figures for scores in report.scores.values()):
        yield "<h2>What the runs compute</h2>"
        yield _scores(report)
    for draw, heading, caption in _PICTURES:
        figure = draw(report)
        if figure is not None:
            yield f"<h2>{heading}</h2>"
            yield _picture(figure, caption)
    if report.runs:
        yield "<h2>What was modelled</h2>"
        yield _modelled(report)
    remarks = [f"{name}: {said}" for name in report.files for said in report.remarks(name)]
    if remarks or report.notes:
        yield "<h2>Notes</h2>"
        yield _list([*remarks, *report.notes])


def _runs(report: Report) -> str:
    columns = [
        "run",
        "what",
        f"rms [{report.unit}]",
        "of motion",
        f"largest [{report.unit}]",
        "where",
        "matched nodes",
    ]
    if report.runs:
        columns += ["CPU [s]", "of it for two steps [s]"]
    rows = []
    for name in report.names:
        run, pair = report.run(name), report.pair(name)
        what = "reference" if name == report.reference else "compared" if pair else "not compared"
        if run is not None and run.path is None:
            what = f"{run.status}: {run.reason}"
        row: list[Any] = [name, what]
        if pair is None:
            row += [None] * 5
        else:
            node, time = pair.largest_at
            row += [pair.rms, pair.relative_rms, pair.largest, f"{node} at {time:.4g}"]
            row.append(f"{pair.n_nodes} by {pair.matched_by}")
        if report.runs:
            row += [None, None] if run is None else [run.cpu_seconds, run.fixed_seconds]
        rows.append(row)
    told = _table(columns, rows)
    return f'{told}<p class="small">{_text(COST_TEXT)}</p>' if report.runs else told


def _probes(report: Report) -> str:
    rows = [
        [
            name, one.name, f"{one.expected:.8g} {one.unit}",
            one.reason if one.measured is None else f"{one.measured:.8g}",
            one.deviation, one.tolerance,
            {True: "within", False: "outside", None: "-"}[one.within],
        ]
        for name, results in report.probes.items()
        for one in results
    ]  # fmt: skip
    return _table(["run", "figure", "known", "measured", "deviation", "tolerance", ""], rows)


def _scores(report: Report) -> str:
    keys = list(dict.fromkeys(key for one in report.scores.values() for key in one.figures))
    differences = report.score_differences
    rows = []
    for name, scores in report.scores.items():
        row: list[Any] = [name]
        for key in keys:
            row += [scores.figures.get(key), differences.get(name, {}).get(key)]
        rows.append(row)
    columns = ["run"]
    for key in keys:
        columns += [key.replace("_", " "), "difference"]
    return _table(columns, rows)


def _modelled(report: Report) -> str:
    parts = []
    if report.physics:
        rows = [[item.name, item.count, item.text] for item in report.physics]
        parts.append(_table(["the scene has", "how many", ""], rows))
    for run in report.runs:
        parts.append(f"<h3>{_text(run.name)}</h3>")
        if run.settings:
            said = ", ".join(f"{key} = {value}" for key, value in run.settings.items())
            parts.append(f"<p>With {_text(said)}.</p>")
        lines = [f"leaves out: {item}" for item in run.leaves_out]
        lines += [f"adds: {item}" for item in run.adds]
        if run.path is not None and not lines:
            lines = ["models all of the scene, and nothing else"]
        if run.path is None:
            lines = [f"{run.status}: {run.reason}", *lines]
        parts.append(_list([*lines, *run.notes]))
    return "\n".join(parts)


def _picture(figure: Figure, caption: str) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    said = _text(caption)
    return (
        f'<figure><img alt="{said}" src="data:image/png;base64,{data}">'
        f"<figcaption>{said}</figcaption></figure>"
    )


def _table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    head = "".join(f"<th>{_text(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(_cell(value) for value in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: Any) -> str:
    if value is None:
        return "<td>-</td>"
    if isinstance(value, int | float) and not isinstance(value, bool):
        shown = f"{value:.4g}" if isinstance(value, float) else f"{value:,}"
        return f'<td class="number">{shown}</td>'
    style = {"within": ' class="good"', "outside": ' class="bad"'}.get(str(value), "")
    return f"<td{style}>{_text(value)}</td>"


def _list(items: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{_text(item)}</li>' for item in items)}</ul>"


def _text(value: Any) -> str:
    """Return text that a browser shows as it is: file names and labels are strangers' words."""
    return escape(str(value), quote=True)


__all__ = ["page_text", "save_page"]
