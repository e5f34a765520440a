"""Memory profile, capacities by delay and degree, and capacity by degree."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.errors import TaskError
from openprc.schema import results

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from openprc.analysis.benchmarks.base import Score
    from openprc.analysis.capacity.capacities import Capacities

_COUNTED, _CHANCE = "tab:blue", "0.75"
#: Delays that are labelled at most, or the labels would touch.
_MOST_TICKS = 16


@dataclass(frozen=True)
class CapacityPlots:
    """The pictures of one measurement of capacities.

    Parameters
    ----------
    capacities, threshold : (K,)
    degrees, delays : (K,) int
        Total degree and largest delay [rows] of each target.
    rank : int
        Upper bound of the sum.
    title : str
    folder : path-like
        Where pictures go by default.
    """

    capacities: NDArray[np.float64]
    threshold: NDArray[np.float64]
    degrees: NDArray[np.int64]
    delays: NDArray[np.int64]
    rank: int
    title: str = ""
    folder: Path = Path()

    @classmethod
    def of(cls, found: Score | Capacities, *, title: str = "") -> Self:
        """Take a score of `MemoryBenchmark`, or what a function of capacities returned.

        Raises
        ------
        TaskError
            When the score holds no capacities.
        """
        metrics = getattr(found, "metrics", None)
        if metrics is not None:
            return cls._from(metrics, where="the score", title=title)
        return cls(
            found.raw, found.thresholds, found.degrees, found.delays, found.rank, title=title
        )

    @classmethod
    def from_file(
        cls, path: str | Path, group: str = "memory_benchmark", *, title: str = ""
    ) -> Self:
        """Take a group of a metrics.h5.

        Raises
        ------
        TaskError
            When that group holds no capacities.
        UnreadableFile, SchemaError
            When it is no results file.
        """
        path = Path(path)
        stored = results.read_result(path)
        prefix = f"{group}/"
        metrics = {
            name.removeprefix(prefix): value
            for name, value in stored.arrays.items()
            if name.startswith(prefix)
        }
        return cls._from(metrics, where=f"group {group!r}", title=title, file=path)

    @classmethod
    def _from(cls, metrics: Any, *, where: str, title: str, file: Path | None = None) -> Self:
        names = ("capacities", "threshold", "degrees", "delays", "rank")
        missing = [name for name in names if name not in metrics]
        if missing:
            raise TaskError(
                f"{where} holds no {', '.join(missing)}",
                expected="what MemoryBenchmark stores",
                fix="name its group",
                file=file,
                key="group",
            )
        *arrays, rank = (np.asarray(metrics[name]) for name in names)
        return cls(*arrays, int(rank), title=title, folder=file.parent if file else Path())

    @property
    def counted(self) -> NDArray[np.float64]:
        """Capacities above threshold, 0 otherwise, (K,)."""
        return np.where(self.capacities > self.threshold, self.capacities, 0.0)

    def memory_profile(self) -> Plot:
        """Draw the capacity of the input of k rows before, over k, with its threshold.

        Of several inputs the sum is drawn, and the threshold is that of each.

        Raises
        ------
        TaskError
            When there are no targets of degree 1.
        MissingDependency
            When matplotlib is not installed.
        """
        linear = self.degrees == 1
        if not linear.any():
            raise TaskError(
                "there are no targets of degree 1",
                expected="capacities of delayed inputs",
                fix="measure with degree 1 in the budget",
                key="delays",
            )
        lags = np.unique(self.delays[linear])
        sums = {
            name: np.array([values[linear & (self.delays == lag)].sum() for lag in lags])
            for name, values in (("all", self.capacities), ("counted", self.counted))
        }
        figure = new_figure((7.0, 3.4))
        axes = figure.add_subplot()
        width = 0.8 * (np.diff(lags).min() if len(lags) > 1 else 1.0)
        axes.bar(lags, sums["all"], width=width, color=_CHANCE, label="not above chance")
        axes.bar(lags, sums["counted"], width=width, color=_COUNTED, label="counted")
        level = float(self.threshold[linear].max())
        axes.axhline(
            level, color="tab:red", linestyle="--", linewidth=1.0, label=f"threshold {level:.3g}"
        )
        memory = float(sums["counted"][lags >= 1].sum())
        _finish(
            axes,
            title=self.title or f"memory capacity {memory:.2f} (delays from 1), rank {self.rank}",
            x_label="delay k [rows]",
            y_label="capacity C(k)",
        )
        axes.set_ylim(bottom=min(0.0, float(sums["all"].min())))
        return Plot(figure, self.folder / "memory_profile.png")

    def heat_map(self) -> Plot:
        """Draw the capacity above threshold by delay and degree.

        A product counts at the largest delay among its factors. Where no target was asked for
        there is no cell.

        Raises
        ------
        MissingDependency
            When matplotlib is not installed.
        """
        degrees, row = np.unique(self.degrees, return_inverse=True)
        delays, column = np.unique(self.delays, return_inverse=True)
        values = np.zeros((len(degrees), len(delays)))
        np.add.at(values, (row, column), self.counted)
        asked = np.zeros(values.shape, dtype=bool)
        asked[row, column] = True
        figure = new_figure((8.0, 1.8 + 0.5 * len(degrees)))
        axes = figure.add_subplot()
        image = axes.imshow(
            np.ma.masked_array(values, ~asked),
            aspect="auto",
            cmap="viridis",
            vmin=0.0,
            interpolation="nearest",
        )
        axes.set_facecolor("0.9")
        axes.set_yticks(range(len(degrees)), [str(degree) for degree in degrees])
        shown = np.arange(0, len(delays), max(1, -(-len(delays) // _MOST_TICKS)))
        axes.set_xticks(shown, [str(delays[k]) for k in shown])
        axes.set_xlabel("largest delay [rows]")
        axes.set_ylabel("total degree")
        total = float(self.counted.sum())
        axes.set_title(
            self.title or f"information processing capacity {total:.2f}, rank {self.rank}",
            fontsize="medium",
            loc="left",
        )
        bar = figure.colorbar(image, ax=axes, pad=0.08)
        bar.set_label("capacity")
        for k, sum_of_degree in enumerate(values.sum(axis=1)):
            axes.annotate(
                f"{sum_of_degree:.2f}", (1.0, k), xycoords=("axes fraction", "data"),
                xytext=(6, 0), textcoords="offset points", va="center", fontsize="small",
            )  # fmt: skip
        axes.annotate(
            "sum", (1.0, 1.0), xycoords="axes fraction", xytext=(6, 4),
            textcoords="offset points", fontsize="small", color="0.4",
        )  # fmt: skip
        return Plot(figure, self.folder / "capacity_heat_map.png")

    def by_degree(self) -> Plot:
        """Draw the capacity above threshold as one bar, stacked by degree, beside the rank.

        Raises
        ------
        MissingDependency
            When matplotlib is not installed.
        """
        figure = new_figure((7.0, 2.2))
        axes = figure.add_subplot()
        from matplotlib import colormaps

        degrees = np.unique(self.degrees)
        colours = colormaps["viridis"](np.linspace(0.1, 0.85, len(degrees)))
        left = 0.0
        for degree, colour in zip(degrees, colours, strict=True):
            value = float(self.counted[self.degrees == degree].sum())
            axes.barh(0, value, left=left, color=colour, label=f"degree {degree}: {value:.2f}")
            left += value
        axes.axvline(self.rank, color="tab:red", linestyle="--", linewidth=1.0, label="rank")
        axes.set_yticks([])
        axes.set_ylim(-0.6, 0.6)
        axes.set_xlim(0.0, 1.05 * max(self.rank, left))
        axes.set_xlabel("capacity above threshold")
        axes.set_title(
            self.title or f"total {left:.2f} of {self.rank}", fontsize="medium", loc="left", pad=22
        )
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), ncols=len(degrees) + 1, frameon=False,
            fontsize="small", borderaxespad=0.1, handlelength=1.2, columnspacing=1.2,
        )  # fmt: skip
        return Plot(figure, self.folder / "capacity_by_degree.png")


def _finish(axes: Axes, *, title: str, x_label: str, y_label: str) -> None:
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title, fontsize="medium", loc="left", pad=22)
    # Above the axes, where it hides nothing.
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize="small",
        borderaxespad=0.1,
    )  # fmt: skip
    axes.margins(x=0.01)
