"""Pictures of a comparison: when runs part, where on the body, and how they move there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.analysis.visualization.figure import new_figure
from openprc.compare.chaos.judgement import SHARE
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from openprc.compare.comparison import PairComparison
    from openprc.compare.report import Report

    Reals = NDArray[np.float64]

_WIDTH = 8.0
#: More runs than this have error maps of the worst of them only.
_MAPS = 4
_TRACES = 3


def run_colours(report: Report) -> Mapping[str, str]:
    """Return a colour for every run: black for the reference."""
    others = [name for name in report.names if name != report.reference]
    return {report.reference: "black"} | {name: f"C{k % 10}" for k, name in enumerate(others)}


def _pairs(report: Report) -> dict[str, PairComparison]:
    found = {name: report.pair(name) for name in report.files}
    return {name: pair for name, pair in found.items() if pair is not None}


def error_over_time(report: Report) -> Figure | None:
    """Draw the rms difference of every run from the reference, on a logarithmic scale."""
    pairs, colours = _pairs(report), run_colours(report)
    shown = {name: pair for name, pair in pairs.items() if np.nanmax(pair.rms_over_time) > 0.0}
    if not shown:
        return None
    figure = new_figure((_WIDTH, 4.0))
    axes = figure.add_subplot()
    for name, pair in shown.items():
        axes.semilogy(
            pair.times, _positive(pair.rms_over_time), color=colours[name], lw=1.2, label=name
        )
        judged = report.divergences.get(name)
        if judged is not None and judged.horizon is not None:
            axes.axvline(judged.horizon, color=colours[name], lw=0.8, ls=":")
    if report.twins is not None:
        twins = report.twins
        for k, size in enumerate(twins.sizes):
            axes.semilogy(
                twins.times, _positive(twins.separations[k] * twins.scale),
                color="0.6", lw=0.8, ls=("-", "--")[k],
                label=f"twins begun {size:.0e} of the scale apart",
            )  # fmt: skip
    if report.scale is not None:
        axes.axhline(SHARE * report.scale, color="0.3", lw=0.8, ls="-.")
        axes.annotate(
            "1 % of the scale", (0.995, SHARE * report.scale), (0, -2),
            xycoords=("axes fraction", "data"), textcoords="offset points",
            ha="right", va="top", fontsize=8, color="0.3",
        )  # fmt: skip
    axes.set(xlabel=_clock_label(report), ylabel=f"rms difference [{report.unit}]")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def worst_traces(report: Report) -> Figure | None:
    """Draw, for the worst pairs, the worst node along the axis on which it differs most."""
    pairs = sorted(_pairs(report).items(), key=lambda item: -item[1].rms)[:_TRACES]
    pairs = [item for item in pairs if item[1].rms > 0.0 and item[1].traces]
    if not pairs:
        return None
    colours = run_colours(report)
    columns = max(len(pair.traces) for _, pair in pairs)
    figure = new_figure((_WIDTH, 2.5 * len(pairs) + 0.5))
    grid = figure.subplots(len(pairs), columns, squeeze=False)
    for row, (name, pair) in zip(grid, pairs, strict=True):
        for axes in row[len(pair.traces) :]:
            axes.set_axis_off()
        for axes, trace in zip(row, pair.traces, strict=False):
            axis = int(np.nansum((trace.reference - trace.other) ** 2, axis=0).argmax())
            axes.plot(
                trace.times, trace.reference[:, axis], color="black", lw=2.4, alpha=0.4,
                label=report.reference,
            )  # fmt: skip
            axes.plot(trace.times, trace.other[:, axis], color=colours[name], lw=1.1, label=name)
            part = "" if trace.kind == "whole" else ", around the largest difference"
            axes.set_title(f"node {trace.node}{part}", fontsize=9)
            axes.grid(alpha=0.3)
            axes.set_ylabel(f"{'xyz'[axis]}, moved [{pair.unit}]")
        row[0].legend(fontsize=8, loc="best")
    for axes in grid[-1]:
        axes.set_xlabel(_clock_label(report))
    return figure


def error_map(report: Report) -> Figure | None:
    """Draw the body of the reference, its nodes coloured by their rms difference."""
    pairs = sorted(_pairs(report).items(), key=lambda item: -item[1].rms)[:_MAPS]
    pairs = [item for item in pairs if item[1].rms > 0.0]
    if not pairs:
        return None
    with Trajectory(report.files[report.reference]) as run:
        at = int(np.abs(run.time - pairs[0][1].largest_time).argmin())
        places = run.positions(slice(at, at + 1))[0]
        names, stored = _labels(run), run.position_unit
        bars = run.indices("bars") if "bars" in run.element_kinds else np.empty((0, 2), int)
    across, up = _widest_axes(places)
    figure = new_figure((_WIDTH, 3.4 * (1 + (len(pairs) - 1) // 2)))
    panels = figure.subplots(1 + (len(pairs) - 1) // 2, min(2, len(pairs)), squeeze=False).ravel()  # type: ignore[union-attr]
    for axes in panels[len(pairs) :]:
        axes.set_axis_off()
    for axes, (name, pair) in zip(panels, pairs, strict=False):
        _draw_map(
            axes,
            places[:, [across, up]],
            bars,
            _by_label(pair, names),
            figure=figure,
            unit=pair.unit,
        )
        axes.set(title=name, xlabel=f"{'xyz'[across]} [{stored}]", ylabel=f"{'xyz'[up]} [{stored}]")
        axes.title.set_fontsize(9)
    return figure


def _draw_map(
    axes: Axes, flat: Reals, bars: Any, errors: Reals, *, figure: Figure, unit: str
) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm

    axes.add_collection(LineCollection(list(flat[bars]), colors="0.8", linewidths=0.8, zorder=1))
    known = np.isfinite(errors) & (errors > 0.0)
    axes.scatter(*flat[~known].T, s=14, facecolors="none", edgecolors="0.5", zorder=2)
    low, high = errors[known].min(), errors[known].max()
    shown = axes.scatter(
        *flat[known].T, c=errors[known], s=18, zorder=3, cmap="viridis",
        norm=LogNorm(max(low, high * 1e-4) if low < high else low / 2.0, high),
    )  # fmt: skip
    figure.colorbar(shown, ax=axes, label=f"rms difference [{unit}]")
    spans, middle = np.ptp(flat, axis=0), 0.5 * (flat.max(axis=0) + flat.min(axis=0))
    if spans.min() > 0.05 * spans.max():
        axes.margins(0.08)
        axes.set_aspect("equal", adjustable="datalim")
        return
    half = 0.58 * np.maximum(spans, 0.2 * (spans.max() or 1.0))
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])


def _labels(run: Trajectory) -> list[str]:
    if run.has("/topology/nodes/label"):
        return [str(label) for label in run.node("label")]
    return [str(number) for number in range(run.n_nodes)]


def _by_label(pair: PairComparison, names: list[str]) -> Reals:
    known = dict(zip((str(label) for label in pair.node_labels), pair.node_rms, strict=True))
    return np.array([known.get(name, np.nan) for name in names])


def _widest_axes(places: Reals) -> tuple[int, int]:
    order = np.argsort(-np.ptp(places, axis=0), kind="stable")[:2]
    across, up = sorted(int(axis) for axis in order)
    return across, up


def _positive(values: Reals) -> Reals:
    """Return values for a logarithmic axis: a gap where there is no difference at all."""
    shown: Reals = np.where(values > 0.0, values, np.nan)
    return shown


def _clock_label(report: Report) -> str:
    with Trajectory(report.files[report.reference]) as run:
        return "time [s]" if run.time_kind == "physical" else "load step"


__all__ = ["error_map", "error_over_time", "run_colours", "worst_traces"]
