"""The work-precision picture: error against CPU time, and against evaluations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.tradeoff.pareto import Cost, cpu_seconds, evaluations, pareto_front, usable
from openprc.tradeoff.pareto import trajectory_error as error

if TYPE_CHECKING:
    from openprc.tradeoff.point import Point
    from openprc.tradeoff.study import Study

NAME = "work_precision.png"
#: Errors above this are no answers, and would squeeze those that are.
LARGEST = 3.0
#: Groups whose costs are comparable: runs in memory, by this engine.
_DRAWN = ("integrator", "constraints", "precision", "backend", "model")
_DASHES = {
    "integrator": "-",
    "constraints": ":",
    "precision": "--",
    "backend": "-.",
    "model": (0, (3, 1, 1, 1, 1, 1)),
}
_MARKERS = "osD^v<>pPXhd*"


def draw_study(study: Study, folder: Path) -> Plot:
    """Draw every ladder of a study, the front, the target, and the floor of the reference.

    Raises
    ------
    MissingDependency
        When matplotlib is not installed.
    """
    ladders = {
        label: points
        for label, points in study.ladders().items()
        if points[0].group in _DRAWN and usable(points, cpu_seconds, error)
    }
    rows = -(-(len(ladders) + 3) // 4)
    figure = new_figure((10.5, 4.6 + 0.24 * rows))
    left, right = figure.subplots(1, 2, sharey=True)
    groups = {points[0].group for points in ladders.values()}
    for number, (label, points) in enumerate(ladders.items()):
        group = points[0].group
        style: dict[str, Any] = {
            "color": f"C{number % 10}",
            "marker": _MARKERS[number % len(_MARKERS)],
            "markersize": 4,
            "linewidth": 1.1,
            "linestyle": _DASHES[group],
            "label": points[0].label if len(groups) == 1 else label.replace("integrator: ", ""),
        }
        _line(left, points, cpu_seconds, 1e3, style)
        _line(right, points, evaluations, 1.0, style)
    _front(left, study.advisable, cpu_seconds, 1e3)
    _front(right, study.advisable, evaluations, 1.0)
    for axes in (left, right):
        if study.choices.target is not None and study.choices.metric == "trajectory":
            axes.axhline(study.choices.target, color="k", linewidth=1, label="target")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.grid(which="major", alpha=0.35)
    lowest = min(
        [
            error(p) or 1.0
            for points in ladders.values()
            for p in usable(points, cpu_seconds, error)
        ],
        default=1e-12,
    )
    least = max(0.3 * min(lowest, study.choices.target or 1.0), 1e-16)
    left.set_ylim(least, LARGEST)
    if study.reference.floor > least:
        for axes in (left, right):
            axes.axhspan(
                least,
                study.reference.floor,
                color="0.88",
                zorder=0,
                label="floor: 10 x what the reference is wrong by",
            )
    for axes in (left, right):
        _whole_decades(axes)
    left.set_xlabel("CPU time of one thread [ms]")
    right.set_xlabel("evaluations of all forces [1]")
    left.set_ylabel("largest rms error / rms displacement [1]")
    known = f"reference good to {study.reference.uncertainty:.1e}"
    figure.suptitle(
        f"{study.scene.name}, {study.reference.horizon:g} s of motion; {known}", fontsize=11
    )
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    return Plot(figure, folder / NAME)


def _whole_decades(axes: Any) -> None:
    """Let the axis of costs begin and end at a power of ten: labels between them collide."""
    costs = [x for line in axes.lines if line.get_marker() != "None" for x in line.get_xdata()]
    low = math.floor(math.log10(min(costs, default=1.0)) + 1e-9)
    high = math.ceil(math.log10(max(costs, default=10.0)) - 1e-9)
    axes.set_xlim(0.8 * 10.0**low, 1.25 * 10.0 ** max(high, low + 1))


def _line(
    axes: Any, points: Sequence[Point], cost: Cost, factor: float, style: dict[str, Any]
) -> None:
    good = [p for p in usable(points, cost, error) if 0.0 < (error(p) or 0.0) < LARGEST]
    # Refined rungs were measured last, and lie in between.
    good.sort(key=lambda p: -(error(p) or 0.0))
    if good:
        axes.plot([factor * (cost(p) or 0.0) for p in good], [error(p) for p in good], **style)


def _front(axes: Any, points: Sequence[Point], cost: Cost, factor: float) -> None:
    front = [p for p in pareto_front(points, cost=cost) if 0.0 < (error(p) or 0.0) < LARGEST]
    if front:
        axes.plot(
            [factor * (cost(p) or 0.0) for p in front],
            [error(p) for p in front],
            linestyle="none",
            marker="o",
            markersize=10,
            markerfacecolor="none",
            markeredgecolor="k",
            markeredgewidth=0.9,
            label="on the Pareto front",
        )
