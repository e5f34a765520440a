"""Tasks from what the user has: an array of targets, or a function of the input."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import METRICS, Metric
from openprc.analysis.tasks.series import TargetSeries
from openprc.analysis.tasks.task import ImitationTask, input_symbols, positive_count
from openprc.errors import TaskError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*\Z")
_OWN = "the user's own"


@dataclass(frozen=True, eq=False)
class ArrayTask(ImitationTask):
    """A target that was measured or computed elsewhere.

    Parameters
    ----------
    y : (K,) or (K, O)
        Row k belongs to input symbol k.
    name : str
        Fit for a file name.
    metric : {"nrmse", "ser", "accuracy", "corr2"}
    levels : tuple of float, optional
        The values that the target takes; for "ser" and "accuracy" read off the array if left
        out.
    n_warmup : int
        Rows at the start that are not defined, and may be NaN.
    names : tuple of str
        One per output.
    formula, source : str

    Raises
    ------
    TaskError
        When the array has the wrong shape or holds NaN, or a name does not fit.
    """

    y: Any
    name: str = "own"
    metric: Metric = "nrmse"
    levels: tuple[float, ...] | None = None  # type: ignore[misc]
    n_warmup: int = 0
    names: tuple[str, ...] = ()
    formula: str = f"{_OWN} array"
    source: str = _OWN

    def __post_init__(self) -> None:
        check_names(self.name, self.metric)
        positive_count(self.n_warmup, "n_warmup", least=0)
        series = TargetSeries(
            np.asarray(self.y, dtype=np.float64), n_warmup=self.n_warmup, names=tuple(self.names)
        )
        object.__setattr__(self, "y", series.values)
        object.__setattr__(self, "names", series.names)
        if self.metric in ("ser", "accuracy") and self.levels is None:
            found = np.unique(series.values[series.usable])
            object.__setattr__(self, "levels", tuple(found.tolist()))

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return the array, once it is as long as the input.

        Raises
        ------
        TaskError
            When it is not.
        """
        n_symbols = len(input_symbols(u))
        if n_symbols != len(self.y):
            raise TaskError(
                f"the target has {len(self.y)} rows and the input {n_symbols} symbols",
                expected="one target row per symbol",
                fix="bring the target to the clock of the symbols",
                key="y",
            )
        return TargetSeries(self.y, n_warmup=self.n_warmup, names=self.names)


def array_task(y: ArrayLike, **parameters: Any) -> ArrayTask:
    """Return an `ArrayTask`; see there."""
    return ArrayTask(y, **parameters)


@dataclass(frozen=True, eq=False)
class FunctionTask(ImitationTask):
    """A target that a function computes from the input symbols.

    Parameters
    ----------
    function : callable
        ``function(u) -> (K,) or (K, O)``; u is what `target` was given.
    name, metric, levels, n_warmup, formula, source
        As for `ArrayTask`.
    """

    function: Callable[..., Any]
    name: str = "own"
    metric: Metric = "nrmse"
    levels: tuple[float, ...] | None = None  # type: ignore[misc]
    n_warmup: int = 0
    formula: str = f"{_OWN} function of the input"
    source: str = _OWN

    def __post_init__(self) -> None:
        check_names(self.name, self.metric)
        positive_count(self.n_warmup, "n_warmup", least=0)

    def target(self, u: ArrayLike) -> TargetSeries:
        """Return what the function computes, (K, O).

        Raises
        ------
        TaskError
            When that is not one finite row per symbol.
        """
        values = input_symbols(u)
        given: NDArray[np.float64] = values[:, 0] if np.ndim(u) == 1 else values
        y = np.asarray(self.function(given), dtype=np.float64)
        if not y.ndim or len(y) != len(values):
            raise TaskError(
                f"the function gave shape {y.shape} for {len(values)} symbols",
                expected="one row per symbol",
                fix="keep the length of the input; name undefined rows by n_warmup",
                key="function",
            )
        return TargetSeries(y, n_warmup=self.n_warmup)


def check_names(name: str, metric: str) -> None:
    """Check a task's name and metric.

    Raises
    ------
    TaskError
        When the name cannot be part of a file name, or the metric is unknown.
    """
    if not isinstance(name, str) or not _NAME.match(name):
        raise TaskError(
            f"the task name is {name!r}",
            expected="letters, digits, '.', '_' or '-', since it is part of a file name",
            fix="choose such a name",
            key="name",
        )
    if metric not in METRICS:
        raise TaskError(
            f"the metric is {metric!r}",
            expected=", ".join(METRICS),
            fix="choose one of these",
            key="metric",
        )
