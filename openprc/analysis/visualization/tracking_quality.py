"""One picture that tells whether tracks can be trusted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.errors import MissingData
from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from openprc.vision.tracking.result import TrackingResult

_SEEN = (Status.TRACKED, Status.REFERENCE)
#: Instants of a track, and samples of a histogram, that are drawn at most.
_INSTANTS, _SAMPLES = 400, 500_000
#: Okabe and Ito's colours, told apart with any common colour blindness.
_COLOURS = {
    "lost": "#d55e00",
    "out of bounds": "#cc79a7",
    "drift": "#f0e442",
    "interpolated": "#56b4e9",
}
_CODES = {
    "lost": Status.LOST,
    "out of bounds": Status.OOB,
    "drift": Status.DRIFT,
    "interpolated": Status.INTERPOLATED,
}
_GREEN = "#009e73"


def plot_tracking_quality(
    image: ArrayLike,
    result: TrackingResult,
    *,
    title: str = "",
    unit_per_px: float | None = None,
    unit: str = "",
) -> Plot:
    """Draw tracks over the reference frame, the fraction found, quality, and sigma.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
        The reference frame; colour in the order blue, green, red.
    result : TrackingResult
        Its arrays may be mapped from a file: of long runs every so-manieth frame is drawn.
    title : str
    unit_per_px, unit : float, str, optional
        Length of a pixel, to tell the median sigma in that unit as well.

    Raises
    ------
    MissingData
        There is no frame or no point.
    MissingDependency
        When matplotlib is not installed.
    """
    if not result.n_frames or not result.n_features:
        raise MissingData(
            "there are no tracks",
            expected="at least one point in one frame",
            fix="track the video first",
            key="result",
        )
    picture = np.asarray(image)
    grey = picture if picture.ndim == 2 else picture[..., :3] @ (0.114, 0.587, 0.299)
    height, width = grey.shape
    # A strip as high-speed cameras film it wants the whole width for itself.
    wide = width > 2.5 * height
    if wide:
        figure = new_figure((11.0, 6.4 + 10.0 * height / width))
        grid = figure.add_gridspec(3, 2, height_ratios=(1.2 + 10.0 * height / width, 2.4, 2.4))
        tracks = figure.add_subplot(grid[0, :])
        places = (grid[1, :], grid[2, 0], grid[2, 1])
    else:
        tall = float(np.clip(6.6 * height / width + 1.6, 6.2, 9.0))
        figure = new_figure((11.5, tall))
        grid = figure.add_gridspec(3, 2, width_ratios=(1.6, 1.0))
        tracks = figure.add_subplot(grid[:, 0])
        places = (grid[0, 1], grid[1, 1], grid[2, 1])
    alive, quality, sigma = (figure.add_subplot(place) for place in places)
    _draw_tracks(figure, tracks, grey, result, wide=wide)
    _draw_alive(alive, result)
    stride = max(1, -(-result.n_frames * result.n_features // _SAMPLES))
    tracked = np.asarray(result.status[::stride]) == Status.TRACKED
    _draw_quality(quality, np.asarray(result.quality[::stride])[tracked])
    worst = np.asarray(result.sigma[::stride])[tracked].max(axis=-1)
    _draw_sigma(sigma, worst, unit_per_px, unit)
    if title:
        figure.suptitle(title, fontsize=12)
    return Plot(figure, Path("tracking_quality.png"))


def _draw_tracks(
    figure: Figure, axes: Axes, grey: NDArray[Any], result: TrackingResult, *, wide: bool
) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    height, width = grey.shape
    low, high = np.percentile(grey, (1, 99))
    # Pale, so that tracks stand out on black and on white.
    axes.imshow(
        grey, cmap="gray", vmin=low - 0.6 * (high - low), vmax=high + 0.2 * (high - low + 1e-9),
        extent=(-0.5, width - 0.5, height - 0.5, -0.5), interpolation="nearest",
    )  # fmt: skip
    stride = max(1, -(-result.n_frames // _INSTANTS))
    places = np.asarray(result.positions[::stride])
    times = np.asarray(result.timestamps[::stride])
    starts = np.asarray(result.positions[result.reference_frame])
    if len(places) > 1:
        segments = np.stack([places[:-1], places[1:]], axis=2)
        drawn = np.isfinite(segments).all(axis=(2, 3))
        frame, _ = np.nonzero(drawn)
        lines = LineCollection(
            list(segments[drawn]), cmap="plasma", linewidths=1.6, array=times[frame + 1], zorder=3
        )
        lines.set_clim(float(times[0]), float(times[-1]))
        axes.add_collection(lines)
        figure.colorbar(
            lines, ax=axes, label="time along the tracks [s]",
            location="right" if wide else "bottom", fraction=0.04, pad=0.02,
            aspect=12 if wide else 40,
        )  # fmt: skip
    ratio = result.track_ratios() if stride == 1 else _ratios(result, stride)
    groups = (
        (ratio >= 1.0, _GREEN, "found in every frame"),
        ((ratio < 1.0) & (ratio >= 0.6), "#e69f00", "in 60 % or more"),
        (ratio < 0.6, "#d55e00", "in less"),
    )
    handles = []
    for members, colour, label in groups:
        if members.any():
            axes.plot(
                *starts[members].T, "o", color=colour, markersize=4.0, markeredgecolor="white",
                markeredgewidth=0.6, zorder=2,
            )  # fmt: skip
            handles.append(
                Line2D([], [], marker="o", linestyle="", color=colour, markeredgecolor="white",
                       label=f"{label}: {int(members.sum())}")
            )  # fmt: skip
    if len(starts) <= 40:
        # Beside the points, away from the edge.
        for number, (x, y) in zip(result.feature_ids, starts, strict=True):
            axes.annotate(
                str(int(number)), (x, y), xytext=(4, 3), textcoords="offset points", fontsize=6.5,
                color="white", bbox={"boxstyle": "round,pad=0.1", "fc": "black", "alpha": 0.55,
                                     "lw": 0},
            )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x [px]", ylabel="y [px]")
    axes.set_title(f"tracks over frame {result.reference_frame}", fontsize=10, pad=20)
    # Above the image, which it would hide.
    axes.legend(
        handles=handles, fontsize=8.5, frameon=False, ncols=len(handles), loc="lower center",
        bbox_to_anchor=(0.5, 1.0), borderaxespad=0.2, handletextpad=0.1, columnspacing=1.2,
    )  # fmt: skip


def _ratios(result: TrackingResult, stride: int) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.isin(result.status[::stride], _SEEN).mean(axis=0)
    return found


def _draw_alive(axes: Axes, result: TrackingResult) -> None:
    stride = max(1, -(-result.n_frames * result.n_features // (8 * _SAMPLES)))
    status = np.asarray(result.status[::stride])
    times = np.asarray(result.timestamps[::stride])
    found = 100.0 * np.isin(status, _SEEN).mean(axis=1)
    axes.fill_between(times, found, color=_GREEN, alpha=0.25, linewidth=0)
    axes.plot(times, found, color=_GREEN, linewidth=1.6, label="found")
    for label, code in _CODES.items():
        share = 100.0 * (status == code).mean(axis=1)
        if share.any():
            axes.plot(times, share, color=_COLOURS[label], linewidth=1.3, label=label)
    axes.set(xlabel="time [s]", ylabel="points [%]", ylim=(0.0, 104.0))
    if len(times) > 1:
        axes.set_xlim(times[0], times[-1])
    axes.set_title(f"found at the end: {found[-1]:.0f} % of {status.shape[1]}", fontsize=10)
    if len(axes.lines) > 1:
        axes.legend(fontsize=8, loc="best", framealpha=0.85)
    axes.grid(alpha=0.25)


def _draw_quality(axes: Axes, values: NDArray[Any]) -> None:
    known = values[np.isfinite(values)]
    axes.set(xlabel="correlation with the template (ZNCC)", ylabel="positions [%]")
    if not known.size:
        _say_none(axes, "no correlation: refine is none")
        return
    # What is below the lowest thousandth is counted into the first bin.
    low = 1.0 - 1.05 * max(1.0 - float(np.percentile(known, 0.1)), 1e-4)
    weights = np.full(known.size, 100.0 / known.size)
    bins = np.linspace(low, 1.0, 41)
    axes.hist(np.clip(known, low, 1.0), bins=bins, weights=weights, color="#0072b2")
    axes.set_xlim(low, 1.0)
    axes.locator_params(axis="x", nbins=5)
    axes.ticklabel_format(axis="x", useOffset=False)
    middle = float(np.median(known))
    axes.axvline(middle, color="black", linewidth=1.0, linestyle="--")
    axes.set_title(f"quality: median {middle:.4f}", fontsize=10)
    axes.grid(alpha=0.25)


def _draw_sigma(axes: Axes, values: NDArray[Any], scale: float | None, unit: str) -> None:
    known = values[np.isfinite(values) & (values > 0)]
    axes.set(xlabel="one-sigma of the position, worse axis [px]", ylabel="positions [%]")
    if not known.size:
        _say_none(axes, "no sigma: refine is none, or the image has no noise")
        return
    low, high = np.percentile(known, (0.1, 99.9))
    low, high = low / 1.15, high * 1.15
    weights = np.full(known.size, 100.0 / known.size)
    bins = np.geomspace(low, high, 51)
    axes.hist(np.clip(known, low, high), bins=bins, weights=weights, color="#cc79a7")
    axes.set_xscale("log")
    _few_ticks(axes.xaxis, low, high)
    middle = float(np.median(known))
    axes.axvline(middle, color="black", linewidth=1.0, linestyle="--")
    words = f"sigma: median {middle:.2g} px"
    if scale:
        words += f" = {middle * scale:.2g} {unit}"
    axes.set_title(words, fontsize=10)
    axes.grid(alpha=0.25)


def _few_ticks(axis: Any, low: float, high: float) -> None:
    """Label a logarithmic axis with plain numbers, also where it spans less than a decade."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        ticks = [step * 10.0**decade for decade in decades for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) >= 3:
            break
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _say_none(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, fontsize=9)
    axes.set(xticks=[], yticks=[])
