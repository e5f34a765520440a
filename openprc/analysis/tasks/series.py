"""Targets with the rows that they are defined on, and the input that goes with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

#: How far stored symbols may be from the input of a task, over its standard deviation.
_DRIVE_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class TargetSeries:
    """A target, one row per input symbol.

    Where the data do not define the target, such as what the input was before its first
    symbol, the values are NaN. These rows lie at the start and at the end only.

    Parameters
    ----------
    values : (K, O) float64
        Row k is paired with the state that has seen input symbol k.
    n_warmup, n_tail : int
        Undefined rows at the start and at the end.
    names : tuple of str
        One per output.

    Raises
    ------
    TaskError
        When the other rows are not finite, or no row is left.
    """

    values: NDArray[np.float64]
    n_warmup: int = 0
    n_tail: int = 0
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = np.asarray(self.values, dtype=np.float64)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or not values.shape[1]:
            raise TaskError(
                f"the target has shape {values.shape}",
                expected="(K,) or (K, O)",
                fix="pass one column per output",
                key="values",
            )
        n_undefined = self.n_warmup + self.n_tail
        if len(values) <= n_undefined:
            raise TaskError(
                f"there are {len(values)} symbols and the task leaves {n_undefined} of them "
                "without a target",
                expected=f"at least {n_undefined + 1} symbols",
                fix="use a longer input, or a task of shorter memory",
                key="u",
            )
        values = values.copy()
        values[: self.n_warmup] = np.nan
        values[len(values) - self.n_tail :] = np.nan
        object.__setattr__(self, "values", values)
        if not np.isfinite(values[self.usable]).all():
            bad = int(np.count_nonzero(~np.isfinite(values[self.usable]).all(axis=1)))
            raise TaskError(
                f"{bad} of {len(values)} target rows are NaN or infinite",
                expected="finite numbers from row n_warmup on",
                fix="check what the target was computed from",
                key="values",
            )
        names = self.names or _output_names(values.shape[1])
        if len(names) != values.shape[1] or len(set(names)) != len(names):
            raise TaskError(
                f"the names are {names!r} for {values.shape[1]} outputs",
                expected="one name per output, each once",
                fix="name every column",
                key="names",
            )
        object.__setattr__(self, "names", tuple(names))

    def __len__(self) -> int:
        return len(self.values)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Rows whose target is defined, (K,)."""
        rows = np.arange(len(self.values))
        return (rows >= self.n_warmup) & (rows < len(self.values) - self.n_tail)

    def for_rows(self, rows: ArrayLike) -> NDArray[np.float64]:
        """Return the target (K, O) for a trainer that reads nothing but `rows`.

        A trainer takes finite targets only. The undefined rows repeat the nearest defined one
        here, which is harmless because `rows` may not contain them.

        Parameters
        ----------
        rows : (n,) int or (K,) bool
            Every row that is trained or tested on.

        Raises
        ------
        TaskError
            When one of them has no target.
        """
        chosen = np.zeros(len(self.values), dtype=bool)
        chosen[np.asarray(rows)] = True
        missing = int(np.count_nonzero(chosen & ~self.usable))
        if missing:
            last = len(self.values) - self.n_tail
            raise TaskError(
                f"{missing} rows of training or test have no target",
                expected=f"rows from {self.n_warmup} to {last - 1}",
                fix="let the washout cover the first rows, and end the test before the last",
                key="rows",
            )
        nearest = np.clip(
            np.arange(len(self.values)), self.n_warmup, len(self.values) - self.n_tail - 1
        )
        return self.values[nearest]


@dataclass(frozen=True, eq=False)
class TaskData:
    """An input to drive a body with, and what to train its readout on.

    Parameters
    ----------
    input : (K, C) float64
        One row per symbol. Scale and shift it as the body needs: `target_for` allows that.
    target : TargetSeries
        (K, O).
    metadata : mapping
        Plain values: those of the task, and how these data were made.
    seed : int, optional
        Makes the same data again.
    """

    input: NDArray[np.float64]
    target: TargetSeries
    metadata: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None

    def __post_init__(self) -> None:
        values = np.asarray(self.input, dtype=np.float64)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != len(self.target):
            raise TaskError(
                f"the input has shape {values.shape} and the target {self.target.values.shape}",
                expected="one target row per input symbol",
                fix="make both equally long",
                key="input",
            )
        object.__setattr__(self, "input", values)

    def target_for(self, u: ArrayLike) -> TargetSeries:
        """Return the target, once it is sure that `u` is the input of these data.

        Parameters
        ----------
        u : (K,) or (K, C)
            The symbols that a file stores. Each column may be scaled and shifted.

        Raises
        ------
        TaskError
            When they are other symbols.
        """
        stored = np.asarray(u, dtype=np.float64)
        stored = stored[:, None] if stored.ndim == 1 else stored
        if stored.shape != self.input.shape:
            raise TaskError(
                f"the stored input has shape {stored.shape}",
                expected=f"{self.input.shape}, as the input of the task",
                fix="choose the columns that the task drove, and the same number of symbols",
                key="u",
            )
        for column in range(stored.shape[1]):
            residual = _affine_residual(self.input[:, column], stored[:, column])
            if not residual <= _DRIVE_TOLERANCE:
                raise TaskError(
                    f"column {column} of the stored input is not the input of this task: "
                    f"{residual:.3g} of its standard deviation is something else",
                    expected="the same symbols, scaled and shifted at most",
                    fix="generate the data with the seed that the body was driven with",
                    key="u",
                )
        return self.target


def _affine_residual(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return std(y - (a x + b)) / std(y) of the best a and b."""
    dx, dy = x - x.mean(), y - y.mean()
    size = float(np.sqrt(dy @ dy))
    power = float(dx @ dx)
    if not power or not size:
        return 0.0 if power == size == 0.0 else np.inf
    rest = dy - (dx @ dy) / power * dx
    return float(np.sqrt(rest @ rest)) / size


def _output_names(count: int) -> tuple[str, ...]:
    return ("y",) if count == 1 else tuple(f"y{k}" for k in range(count))
