"""Pictures of results: bars, matrices, profiles over lags, and trees of channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation.export import peak_columns
from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.errors import TaskError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from openprc.analysis.correlation.result import PlotKind, Result

Array = NDArray[np.float64]

_ALPHA = 0.05
#: Profiles beyond this number are drawn as rows of an image.
_MOST_LINES = 8
#: Names beyond this number are thinned.
_MOST_NAMES = 60
#: Width of a letter of a name [inch].
_LETTER = 0.085
#: Lags to either side that are drawn in any case [rows].
_LEAST_REACH = 20
_STRONG, _WEAK = "tab:blue", "0.75"


def draw(result: Result, *, kind: PlotKind | None, alpha: float | None) -> Plot:
    """Draw a result; see `Result.plot`."""
    suitable = _suitable(result)
    if kind is not None and kind not in suitable:
        raise TaskError(
            f"{result.method} with values of shape {result.shape} cannot be drawn as {kind!r}",
            expected=" or ".join(suitable),
            fix="leave kind out",
            key="kind",
        )
    if alpha is None and result.has_test and not result.is_costly:
        alpha = _ALPHA
    marked = None if alpha is None else result.significant(alpha)
    chosen = kind or suitable[0]
    if chosen == "bar":
        figure = _bars(result, marked, alpha)
    elif chosen == "lag_profile" and len(result.names) - len(result.dropped) <= _MOST_LINES:
        figure = _lines(result, _span(result))
    elif result.is_profile:
        figure = _profile_image(result, _span(result))
    else:
        figure = _matrix_image(result, marked, alpha)
    return Plot(figure, Path(f"{result.method}_{chosen}.png"))


def draw_dendrogram(linkage: Array, names: Sequence[str], *, threshold: float) -> Plot:
    """Draw the tree of channels; see `Redundancy.dendrogram`."""
    from scipy.cluster import hierarchy

    n = len(names)
    figure, axes = _figure(6.5, min(1.2 + 0.17 * n, 14.0))
    # matplotlib draws; scipy only lays the tree out, and leaves the global state alone.
    cut = 1.0 - threshold + 1e-12
    tree = hierarchy.dendrogram(linkage, no_plot=True, color_threshold=cut)
    colors: dict[str, str] = {}
    loose = "0.45"
    for heights, places, name in zip(
        tree["dcoord"], tree["icoord"], tree["color_list"], strict=True
    ):
        joined = max(heights) <= cut
        color = colors.setdefault(name, f"C{len(colors) % 10}") if joined else loose
        axes.plot([1.0 - h for h in heights], places, color=color, linewidth=1.3)
    axes.axvline(threshold, color="tab:red", linestyle="--", linewidth=1.0)
    groups = len(np.unique(hierarchy.fcluster(linkage, cut, criterion="distance")))
    axes.set_title(
        f"{n} channels, {groups} groups at |r| ≥ {threshold:g} (dashed)",
        loc="left",
        fontsize="medium",
    )
    axes.set_xlabel("|r| at which channels join (single linkage)")
    order = [names[k] for k in tree["leaves"]]
    _name_ticks(axes, order, along="y", places=5.0 + 10.0 * np.arange(n))
    if n <= _MOST_NAMES:
        for text, name in zip(axes.get_yticklabels(), tree["leaves_color_list"], strict=True):
            text.set_color(colors.get(name, "black"))
    axes.set_ylim(0, 10 * n)
    axes.set_xlim(1.02, min(-0.02 + 1.0 - linkage[:, 2].max(), threshold - 0.05))
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return Plot(figure, Path("dendrogram.png"))


def _suitable(result: Result) -> tuple[PlotKind, ...]:
    if result.is_profile:
        return ("lag_profile", "heatmap")
    return ("heatmap",) if result.is_matrix else ("bar",)


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = new_figure((width, height))
    return figure, figure.add_subplot()


def _bars(result: Result, marked: NDArray[np.bool_] | None, alpha: float | None) -> Figure:
    n = len(result.names)
    width = float(np.clip(2.0 + 0.2 * n, 5.5, 14.0))
    figure, axes = _figure(width, 3.6)
    places = np.arange(n)
    strong = np.ones(n, dtype=bool) if marked is None else marked
    for chosen, color, words in (
        (strong, _STRONG, f"significant (FDR {alpha:g})" if alpha else ""),
        (~strong, _WEAK, "not significant"),
    ):
        # Constant channels have no bar, and none counts as not significant.
        shown = chosen & np.isfinite(result.values)
        label = words if marked is not None and shown.any() else None
        axes.bar(places[shown], result.values[shown], width=0.75, color=color, label=label)
    constant = np.isnan(result.values)
    if constant.any():
        where = np.flatnonzero(constant)
        axes.plot(where, 0.0 * where, "x", color="tab:red", markersize=6, label="constant")
    if result.threshold is not None:
        style = {"colors": "black", "linewidth": 1.0, "linestyle": ":"}
        axes.hlines(
            result.threshold, places - 0.45, places + 0.45, label="p = 0.05, one channel", **style
        )
        if result.bounds[0] < 0:
            axes.hlines(-result.threshold, places - 0.45, places + 0.45, **style)
    if result.lags is not None:
        _lag_labels(axes, result.values, result.lags)
    axes.axhline(0.0, color="0.2", linewidth=0.8)
    axes.set_ylabel(_wrapped(result.label))
    _name_ticks(axes, result.names, along="x", places=places)
    rim = 0.6 + max(0.0, 0.5 * (6 - n))  # few bars stay slim
    axes.set_xlim(-rim, n - 1 + rim)
    axes.margins(y=0.12)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(
            loc="outside upper right", ncols=int(width // 2), frameon=False, fontsize="small"
        )
    return figure


def _lag_labels(axes: Axes, values: Array, lags: NDArray[np.int64]) -> None:
    """Write the lag of each value at the end of its bar."""
    for place, (value, lag) in enumerate(zip(values, lags, strict=True)):
        if np.isfinite(value):
            axes.annotate(
                f"{lag:+d}",
                (place, value),
                xytext=(0, 2 if value >= 0 else -2),
                textcoords="offset points",
                ha="center",
                va="bottom" if value >= 0 else "top",
                fontsize=7,
            )
    axes.set_title("numbers: lag [rows]", loc="left", fontsize="small")


def _lines(result: Result, span: slice) -> Figure:
    figure, axes = _figure(7.5, 3.6)
    lags, unit = _lag_axis(result)
    best = peak_columns(result)
    certain = _certain(result)
    number = 0
    for k, name in enumerate(result.names):
        if name in result.dropped:
            continue
        color = f"C{number}"
        number += 1
        peak = certain is None or certain[k, best[k]]
        at = (lags[best[k]], result.values[k, best[k]])
        label = f"{name}: {at[0]:+.4g}" if peak else f"{name}: none"
        axes.plot(lags, result.values[k], color=color, linewidth=1.2, label=label)
        if peak:
            axes.plot(*at, "o", color=color, markersize=5)
    if result.threshold is not None:
        # One level for all: of the slowest channel, which is the highest.
        level = float(np.nanmax(result.threshold))
        style = {"color": "0.3", "linewidth": 0.9, "linestyle": ":"}
        axes.axhline(level, label="p = 0.05, one lag", **style)
        if result.bounds[0] < 0:
            axes.axhline(-level, **style)
    axes.axhline(0.0, color="0.2", linewidth=0.8)
    axes.axvline(0.0, color="0.2", linewidth=0.8)
    axes.set_xlabel(f"lag of the channel behind the input [{unit}]")
    axes.set_ylabel(_wrapped(result.label))
    axes.set_xlim(lags[span][0], lags[span][-1])
    figure.legend(
        loc="outside right upper",
        frameon=False,
        fontsize="small",
        title=f"lag of the peak [{unit}]" if number else None,
    )
    return figure


def _profile_image(result: Result, span: slice) -> Figure:
    n = len(result.names)
    figure, axes = _figure(8.0, float(np.clip(1.6 + 0.17 * n, 2.8, 12.0)))
    lags, unit = _lag_axis(result)
    step = 0.5 * float(lags[1] - lags[0]) if len(lags) > 1 else 0.5
    found = np.abs(result.values[np.isfinite(result.values)])
    top = float(found.max()) if len(found) else 1.0
    shown = lags[span]
    _colored(
        figure,
        axes,
        result,
        result.values[:, span],
        top=top,
        extent=(float(shown[0]) - step, float(shown[-1]) + step, n - 0.5, -0.5),
    )
    best = peak_columns(result)
    certain = _certain(result)
    words = "circles: peaks"
    for k, name in enumerate(result.names):
        inside = shown[0] <= lags[best[k]] <= shown[-1]
        if name in result.dropped or not inside:
            continue
        if certain is None or certain[k, best[k]]:
            axes.plot(lags[best[k]], k, "o", markersize=4, color="black", markerfacecolor="white")
    if certain is not None:
        words += f" that are significant (Bonferroni {_ALPHA:g}, all lags)"
    axes.axvline(0.0, color="0.2", linewidth=0.8)
    axes.set_xlabel(f"lag of the channel behind the input [{unit}]")
    axes.set_title(_with_constant(result, words), loc="left", fontsize="small")
    _name_ticks(axes, result.names, along="y", places=np.arange(n))
    axes.set_ylim(n - 0.5, -0.5)
    return figure


def _matrix_image(result: Result, marked: NDArray[np.bool_] | None, alpha: float | None) -> Figure:
    n = len(result.names)
    side = float(np.clip(1.4 + 0.17 * n, 3.6, 12.0))
    figure, axes = _figure(side + 1.6, side + 0.3)
    _colored(
        figure,
        axes,
        result,
        result.values,
        top=result.bounds[1],
        extent=(-0.5, n - 0.5, n - 0.5, -0.5),
    )
    words = ""
    if marked is not None and alpha is not None and n <= _MOST_NAMES:
        # Significant pairs are the rule: the others are struck out.
        weak = np.argwhere(~marked & np.isfinite(result.values) & ~np.eye(n, dtype=bool))
        size = float(np.clip(160.0 / n, 2.0, 7.0))
        axes.plot(weak[:, 1], weak[:, 0], "x", color="0.35", markersize=size, mew=0.7)
        if len(weak):
            words = f"×: not significant (FDR {alpha:g})"
    axes.set_title(_with_constant(result, words), loc="left", fontsize="small")
    for along in ("x", "y"):
        _name_ticks(axes, result.names, along=along, places=np.arange(n))
    axes.set_ylim(n - 0.5, -0.5)
    return figure


def _colored(
    figure: Figure,
    axes: Axes,
    result: Result,
    values: Array,
    *,
    top: float,
    extent: tuple[float, float, float, float],
) -> None:
    """Draw values as colours: red and blue around a white zero, or from white upwards."""
    signed = result.bounds[0] < 0
    axes.set_facecolor("0.8")  # where there is no value
    image = axes.imshow(
        values,
        cmap="RdBu_r" if signed else "Blues",
        vmin=-top if signed else 0.0,
        vmax=top,
        extent=extent,
        aspect="auto" if result.is_profile else "equal",
        interpolation="nearest",
    )
    figure.colorbar(image, ax=axes, label=result.label, shrink=0.9)


def _with_constant(result: Result, words: str) -> str:
    return "; ".join(filter(None, (words, "grey: constant" if result.dropped else "")))


def _certain(result: Result) -> NDArray[np.bool_] | None:
    """Return what is significant, allowing for all lags of all channels.

    A peak is the largest of many values.
    """
    if not result.has_test:
        return None
    return result.significant(_ALPHA, correction="bonferroni")


def _span(result: Result) -> slice:
    """Return the lags to draw: a range around all that is significant, or all of them.

    Far lags at which nothing happens would squeeze the rest into a line.
    """
    whole = slice(0, result.values.shape[1])
    certain = _certain(result)
    if certain is None or result.lags is None or not certain.any():
        return whole
    reach = max(_LEAST_REACH, int(1.3 * np.abs(result.lags[certain.any(axis=0)]).max()))
    inside = np.flatnonzero(np.abs(result.lags) <= reach)
    return slice(int(inside[0]), int(inside[-1]) + 1)


def _lag_axis(result: Result) -> tuple[Array, str]:
    lags = np.asarray(result.lags, dtype=np.float64)
    return (lags, "rows") if result.dt is None else (lags * result.dt, "s")


def _wrapped(label: str) -> str:
    """Break a long label, so that it fits beside a low picture."""
    if len(label) <= 26:
        return label
    words = label.split()
    half = (len(words) + 1) // 2
    return " ".join(words[:half]) + "\n" + " ".join(words[half:])


def _name_ticks(axes: Axes, names: Sequence[str], *, along: str, places: Array) -> None:
    every = -(-len(names) // _MOST_NAMES)
    axis = axes.xaxis if along == "x" else axes.yaxis
    shown = list(names)[::every]
    small = "small" if len(shown) <= 30 else "x-small"
    width = axes.get_figure().get_figwidth()
    turned = along == "x" and len(shown) * max(map(len, shown)) * _LETTER > 0.7 * width
    axis.set_ticks(
        np.asarray(places)[::every],
        shown,
        fontsize=small,
        rotation=90 if turned else 0,
    )
