"""What every task tells about itself, and the three kinds of tasks.

An `ImitationTask` computes a target from the input that drove the body. A `SourcedTask` brings
an input of its own. A `GenerationTask` brings a movement that the body makes by itself once
its readout is fed back.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.tasks.scoring import Metric, score
from openprc.analysis.tasks.series import TargetSeries, TaskData
from openprc.errors import TaskError

Kind = Literal["imitation", "own-input", "generation"]
#: A seed that can be written down, or a generator.
Randomness = int | np.random.Generator

#: The pairing that all tasks share.
ALIGNMENT = "row k is paired with the state that has seen input symbol k and none after it"


class Task(ABC):
    """A frozen description of something to compute.

    Attributes
    ----------
    name : str
        Fit for a file name.
    formula : str
        What the target is, in words that fit on a line or two.
    source : str
        Where the definition comes from, with its DOI.
    metric : {"nrmse", "ser", "accuracy", "corr2"}
        The figure that this task is judged by; see `openprc.analysis.tasks.scoring`.
    kind : {"imitation", "own-input", "generation"}
    levels : tuple of float, optional
        The values that the target takes, where it is one of a few.
    n_warmup, n_tail : int
        Rows at the start and at the end whose target the data do not define.
    """

    name: str
    formula: str
    source: str
    metric: Metric
    kind: ClassVar[Kind]
    levels: ClassVar[tuple[float, ...] | None] = None
    alignment: ClassVar[str] = ALIGNMENT
    n_warmup: int = 0
    n_tail: int = 0

    @property
    def parameters(self) -> dict[str, Any]:
        """What was chosen, as plain values; of an array its shape."""
        names = [field.name for field in fields(self)] if is_dataclass(self) else []
        return {name: _plain(getattr(self, name)) for name in names}

    def metadata(self) -> dict[str, Any]:
        """Return formula, source, metric, alignment and parameters, as plain values."""
        told = {
            "task": self.name,
            "kind": self.kind,
            "formula": self.formula,
            "source": self.source,
            "metric": self.metric,
            "alignment": self.alignment,
            "n_warmup": self.n_warmup,
            "n_tail": self.n_tail,
        }
        own = {f"task_{key}": value for key, value in self.parameters.items() if key not in told}
        return {**told, **own}

    def score(self, target: ArrayLike, prediction: ArrayLike) -> NDArray[np.float64]:
        """Return the figure of `metric`, one per output, (O,).

        Parameters
        ----------
        target, prediction : (n, O) or (n,)
            On the rows that count: defined, and not trained on.

        Raises
        ------
        TaskError
            When shapes differ, something is not finite, or the target does not vary.
        """
        return score(self.metric, target, prediction, levels=self.levels)


class ImitationTask(Task):
    """A target that is a function of the input that drives the body."""

    kind: ClassVar[Kind] = "imitation"

    @abstractmethod
    def target(self, u: ArrayLike) -> TargetSeries:
        """Return the target (K, O) of the input symbols `u`, (K,) or (K, C).

        Raises
        ------
        TaskError
            When the task is not defined on this input.
        """


class SourcedTask(Task):
    """A task that brings the input to drive the body with."""

    kind: ClassVar[Kind] = "own-input"

    @abstractmethod
    def generate(self, n: int, *, rng: Randomness) -> TaskData:
        """Return `n` input symbols and their target.

        Parameters
        ----------
        n : int
        rng : int or numpy.random.Generator
            An integer seed is kept with the data, so that they can be made again.
        """


class GenerationTask(Task):
    """A movement that goes on by itself: the teacher of a closed loop."""

    kind: ClassVar[Kind] = "generation"

    @abstractmethod
    def trajectory(self, n: int, dt: float) -> NDArray[np.float64]:
        """Return `n` samples, `dt` [s] apart, of the movement after it has settled, (n, O)."""

    def teacher(self, n: int, dt: float) -> TaskData:
        """Return `n` pairs of what is fed back and what the readout has to give next."""
        path = self.trajectory(positive_count(n, "n") + 1, dt)
        return TaskData(
            input=path[:-1],
            target=TargetSeries(path[1:]),
            metadata={**self.metadata(), "dt": float(dt)},
        )


def input_symbols(u: ArrayLike, *, n_columns: int | None = None) -> NDArray[np.float64]:
    """Return the input as (K, C) float64.

    Raises
    ------
    TaskError
        When it is empty, not finite, of more than two dimensions, or has not `n_columns`.
    """
    values = np.asarray(u, dtype=np.float64)
    values = values[:, None] if values.ndim == 1 else values
    wanted = "(K,) or (K, C)" if n_columns is None else f"(K, {n_columns})"
    if n_columns == 1:
        wanted = "(K,) or (K, 1)"
    wrong = values.ndim != 2 or not values.size
    if wrong or (n_columns is not None and values.shape[1] != n_columns):
        raise TaskError(
            f"the input has shape {np.shape(u)}",
            expected=f"{wanted}, at least one row",
            fix="choose the columns of the input that the task is about",
            key="u",
        )
    bad = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
    if bad:
        raise TaskError(
            f"{bad} of {len(values)} input symbols are NaN or infinite",
            expected="finite numbers",
            fix="check where the input comes from",
            key="u",
        )
    return values


def generator_of(rng: Randomness) -> tuple[np.random.Generator, int | None]:
    """Return a generator, and the seed that makes it again where one was given.

    Raises
    ------
    TaskError
        For anything else; None too, since nobody could repeat what it draws.
    """
    if isinstance(rng, np.random.Generator):
        return rng, None
    if isinstance(rng, int | np.integer) and not isinstance(rng, bool) and rng >= 0:
        return np.random.default_rng(int(rng)), int(rng)
    raise TaskError(
        f"rng is {rng!r}",
        expected="a seed from 0 on or a numpy.random.Generator",
        fix="pass rng=0, or numpy.random.default_rng(0)",
        key="rng",
    )


def positive_count(n: int, key: str, *, least: int = 1) -> int:
    """Return `n` as int.

    Raises
    ------
    TaskError
        When it is not a whole number from `least` on.
    """
    if isinstance(n, int | np.integer) and not isinstance(n, bool) and n >= least:
        return int(n)
    raise TaskError(
        f"{key} is {n!r}", expected=f"a whole number from {least} on", fix="change it", key=key
    )


def positive_number(value: float, key: str, *, zero: bool = False) -> float:
    """Return `value` as float.

    Raises
    ------
    TaskError
        When it is not a finite number above 0, or from 0 on with `zero`.
    """
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if is_number and np.isfinite(value) and (value > 0 or (zero and value == 0)):
        return float(value)
    wanted = "a finite number from 0 on" if zero else "a finite number above 0"
    raise TaskError(f"{key} is {value!r}", expected=wanted, fix="change it", key=key)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if value is None or isinstance(value, bool | int | float | str | list):
        return value
    return repr(value)
