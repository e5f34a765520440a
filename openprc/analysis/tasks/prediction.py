"""Prediction: the value of a series some steps ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.chaotic_series import Henon, Lorenz, MackeyGlass, SeriesSystem
from openprc.analysis.tasks.scoring import Metric
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.analysis.tasks.task import (
    ImitationTask,
    Kind,
    Randomness,
    generator_of,
    input_symbols,
    positive_count,
)
from openprc.errors import TaskError

Normalization = Literal["none", "zscore", "range"]
_DEFAULT_SOURCE = "the user's own series"


@dataclass(frozen=True, eq=False)
class PredictionTask(ImitationTask):
    """Drive the body with a series and read its future out of it.

    ``y_s(k) = x(k + s)``, one output for every step and column. Since the target is the input
    itself some symbols later, it can be had from stored symbols alone (`target`), as well as
    together with the series to drive the body with (`generate`).

    Parameters
    ----------
    series : (K,) or (K, C) array, or a system with ``series(n, rng=...)``
        Such as `MackeyGlass`, `Lorenz`, `Henon`, or what `load_series` returns.
    steps : int or sequence of int
        How far ahead, from 1 on.
    normalization : {"none", "zscore", "range"}
        "zscore" gives every column of the generated input mean 0 and standard deviation 1
        (ddof 0), "range" the interval [0, 1], both over the symbols and the steps ahead
        together. Errors that are divided by the standard deviation of the target, and
        correlations, do not notice.
    label, origin : str, optional
        Name and source of an array.

    Notes
    -----
    The Santa Fe laser record (set A of the competition; Weigend and Gershenfeld 1993) is
    usually predicted one step ahead. It is not part of this package: it is handed on by the
    archives of the competition. Read your copy with `load_series`.
    """

    series: Any
    steps: int | Sequence[int] = 1
    normalization: Normalization = "none"
    label: str | None = None
    origin: str | None = None
    kind: ClassVar[Kind] = "own-input"
    metric: ClassVar[Metric] = "nrmse"

    def __post_init__(self) -> None:
        given = list(self.steps) if np.ndim(self.steps) else [self.steps]  # type: ignore[arg-type]
        steps = tuple(positive_count(step, "steps") for step in given)
        if not steps or len(set(steps)) != len(steps):
            raise TaskError(
                f"the steps are {self.steps!r}",
                expected="at least one, each once",
                fix="name other steps",
                key="steps",
            )
        object.__setattr__(self, "steps", steps)
        if self.normalization not in ("none", "zscore", "range"):
            raise TaskError(
                f"the normalization is {self.normalization!r}",
                expected="none, zscore or range",
                fix="choose one of these",
                key="normalization",
            )
        if not hasattr(self.series, "series"):
            object.__setattr__(self, "series", input_symbols(self.series))

    @property
    def _system(self) -> SeriesSystem | None:
        return None if isinstance(self.series, np.ndarray) else self.series

    @property
    def _steps(self) -> tuple[int, ...]:
        return tuple(self.steps)  # type: ignore[arg-type]

    @property
    def name(self) -> str:
        """Name of the series and the steps ahead."""
        base = self.label or (self._system.name if self._system else "series")
        steps = self._steps
        ahead = f"{steps[0]}" if len(steps) == 1 else f"{min(steps)}to{max(steps)}"
        return f"{base}-ahead{ahead}"

    @property
    def formula(self) -> str:
        """What is predicted, and the equation of the series where it has one."""
        ahead = "; ".join(f"y(k) = x(k+{step})" for step in self._steps)
        return f"{ahead}; {self._system.formula}" if self._system else ahead

    @property
    def source(self) -> str:
        """Where the series comes from."""
        return self.origin or (self._system.source if self._system else _DEFAULT_SOURCE)

    @property
    def n_tail(self) -> int:
        """Rows at the end of stored symbols whose future is not stored."""
        return max(self._steps)

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return the stored symbols some steps later, (K, steps C); the last rows are undefined.

        Raises
        ------
        TaskError
            When there are no more symbols than steps.
        """
        values = input_symbols(u)
        ahead = np.full((len(values), len(self._steps) * values.shape[1]), np.nan)
        for i, step in enumerate(self._steps):
            columns = slice(i * values.shape[1], (i + 1) * values.shape[1])
            ahead[: max(len(values) - step, 0), columns] = values[step:]
        return TargetSeries(ahead, n_tail=self.n_tail, names=self._names(values.shape[1]))

    def generate(self, n: int, *, rng: Randomness | None = None) -> TaskData:
        """Return `n` symbols of the series and their future; all rows are defined.

        Parameters
        ----------
        n : int
        rng : int or numpy.random.Generator, optional
            Moves the start of a system; an array has one start only.

        Raises
        ------
        TaskError
            When an array is too short.
        """
        total = positive_count(n, "n") + self.n_tail
        seed = None if rng is None else generator_of(rng)[1]
        if self._system is not None:
            values = self._system.series(total, rng=rng)
        else:
            values = self._first(total)
        values, offset, scale = _normalized(values, self.normalization)
        ahead = np.hstack([values[step : n + step] for step in self._steps])
        metadata = {**self.metadata(), "offset": offset.tolist(), "scale": scale.tolist()}
        return TaskData(
            input=values[:n],
            target=TargetSeries(ahead, names=self._names(values.shape[1])),
            # Here the future of the last symbols is known.
            metadata={**metadata, "n_tail": 0},
            seed=seed,
        )

    def _first(self, total: int) -> NDArray[np.float64]:
        if len(self.series) < total:
            raise TaskError(
                f"the series has {len(self.series)} values",
                expected=f"at least {total}: the symbols and the steps ahead",
                fix="ask for fewer symbols",
                key="n",
            )
        return np.asarray(self.series[:total])

    def _names(self, n_columns: int) -> tuple[str, ...]:
        return tuple(
            f"x(k+{step})" if n_columns == 1 else f"x{column}(k+{step})"
            for step in self._steps
            for column in range(n_columns)
        )


def mackey_glass_task(tau: float = 17.0, *, steps: int | Sequence[int] = 84) -> PredictionTask:
    """Return the prediction of Mackey-Glass; 84 steps ahead is the figure of Jaeger and Haas."""
    return PredictionTask(MackeyGlass(tau=tau), steps=steps)


def lorenz_task(steps: int | Sequence[int] = 1) -> PredictionTask:
    """Return the prediction of the first coordinate of Lorenz."""
    return PredictionTask(Lorenz(), steps=steps)


def henon_task(steps: int | Sequence[int] = 1) -> PredictionTask:
    """Return the prediction of Henon."""
    return PredictionTask(Henon(), steps=steps)


def _normalized(
    values: NDArray[np.float64], how: Normalization
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (values - offset) / scale, offset (C,) and scale (C,)."""
    offset, scale = np.zeros(values.shape[1]), np.ones(values.shape[1])
    if how == "zscore":
        offset, scale = values.mean(axis=0), values.std(axis=0)
    elif how == "range":
        offset, scale = values.min(axis=0), np.ptp(values, axis=0)
    if not (scale > 0.0).all():
        raise TaskError(
            f"column {int(np.flatnonzero(~(scale > 0.0))[0])} of the series does not vary",
            expected="values that can be normalised",
            fix="leave the column out",
            key="series",
        )
    return (values - offset) / scale, offset, scale
