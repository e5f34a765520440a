"""Bodies that run freely in a loop with their readout.

A body that was taught a series (see `openprc.reservoir.training.teacher_forcing`) is driven with
the beginning of one, and then with what its readout says. A recording cannot be part of a loop:
a readout that was trained on one is read back and run with the body itself, stepped (for the
native engine `openprc.demlat.stepping.SteppedExperiment`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import Diverged, TaskError
from openprc.reservoir.readout.fitting import FittedReadout
from openprc.reservoir.readout.saved import Readout
from openprc.reservoir.training.teacher_forcing import (
    Feedback,
    SteppedBody,
    as_series,
    fit_generator,
    teacher_forced_states,
)

__all__ = [
    "ClosedLoopRun",
    "Feedback",
    "SteppedBody",
    "fit_generator",
    "predictor",
    "run_closed_loop",
    "teacher_forced_states",
]

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoopRun:
    """What a body did on its own.

    Attributes
    ----------
    outputs : (K, O)
        ``outputs[k]`` continues the warm-up after its last row by k + 1 symbols. Fewer rows than
        were asked for when the run diverged.
    states : (K, F)
        What `outputs` were read from.
    warm_up_outputs : (W - 1, O)
        What the readout said during the warm-up, for its rows from the second one on.
    diverged_at : int, optional
        The step at which the guard stopped the run.
    reason : str
        What the guard saw; empty when nothing.
    """

    outputs: Reals
    states: Reals
    warm_up_outputs: Reals
    diverged_at: int | None = None
    reason: str = ""

    @property
    def diverged(self) -> bool:
        """Whether the guard stopped the run."""
        return self.diverged_at is not None


def run_closed_loop(
    body: SteppedBody,
    readout: Any,
    *,
    n_steps: int,
    warm_up: ArrayLike,
    feedback: Callable[[Reals], Reals] | None = None,
    limit: float = 10.0,
    on_divergence: Literal["raise", "mark"] = "raise",
    reset: bool = True,
) -> ClosedLoopRun:
    """Drive a body with a series, then with what its readout says.

    Parameters
    ----------
    body : SteppedBody
    readout : fitted estimator, `FittedReadout` or `Readout`
        Its outputs, as many as the warm-up has columns, are the next row of the series.
    n_steps : int
        Rows to be generated.
    warm_up : (W,) or (W, O)
        The series up to where the body is on its own; at least one row.
    feedback : callable, optional
        As in training.
    limit : float
        The guard stops a run whose output is farther from the middle of the warm-up's range
        than this many times half that range (of a constant: than this many times its size).
    on_divergence : {"raise", "mark"}
        "mark" returns what there was until then.
    reset : bool
        Begin the warm-up at the body's start.

    Raises
    ------
    Diverged
        When the guard stops the run, or the body itself blows up, unless ``"mark"``.
    TaskError
        When the readout has another number of outputs than the warm-up, and as
        `teacher_forced_states` does.
    """
    if n_steps < 1:
        raise TaskError(
            f"{n_steps} steps", expected="at least 1", fix="ask for some", key="n_steps"
        )
    if on_divergence not in ("raise", "mark"):
        raise TaskError(
            f"on_divergence is {on_divergence!r}",
            expected="'raise' or 'mark'",
            fix="choose one of these",
            key="on_divergence",
        )
    series = as_series(warm_up, "warm_up")
    warm = teacher_forced_states(body, series, feedback=feedback, reset=reset)
    predict = predictor(readout, n_states=warm.shape[1], n_outputs=series.shape[1])
    guard = _Guard(series, limit)
    said = np.array([predict(row) for row in warm])
    outputs, states = np.empty((n_steps, series.shape[1])), np.empty((n_steps, warm.shape[1]))
    outputs[0], states[0] = said[-1], warm[-1]
    reason = guard.objection(outputs[0])
    done = 1
    while done < n_steps and not reason:
        symbol = outputs[done - 1 : done]
        symbol = symbol if feedback is None else feedback(symbol)
        try:
            states[done] = body.step(symbol[0])
        except Diverged as blow_up:
            reason = blow_up.found
            break
        outputs[done] = predict(states[done])
        reason = guard.objection(outputs[done])
        done += 1
    if reason and on_divergence == "raise":
        raise Diverged(
            f"the loop left the range of the warm-up at step {done} of {n_steps}: {reason}",
            expected=f"outputs within {limit:g} times the half range of the warm-up",
            fix="train with noise on what is fed in, with a stronger penalty or a longer series;"
            " on_divergence='mark' keeps what there was",
            key="limit",
        )
    kept = slice(0, done)
    at = done if reason else None
    return ClosedLoopRun(outputs[kept], states[kept], said[:-1], at, reason)


class _Guard:
    """Says what is wrong with an output that is far from what the body was warmed up with."""

    def __init__(self, series: Reals, limit: float) -> None:
        if not limit > 0.0:
            raise TaskError(
                f"a limit of {limit:g}", expected="a number above 0", fix="leave 10", key="limit"
            )
        low, high = series.min(axis=0), series.max(axis=0)
        self.middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        size = np.where(half > 0.0, half, np.abs(self.middle))
        self.room = limit * np.where(size > 0.0, size, 1.0)

    def objection(self, output: Reals) -> str:
        inside = np.abs(output - self.middle) <= self.room  # False for NaN
        if inside.all():
            return ""
        column = int(np.argmin(inside))
        return f"output {column} is {output[column]:.4g}"


def predictor(readout: Any, *, n_states: int, n_outputs: int) -> Callable[[Reals], Reals]:
    """Return a readout as a function from states (F,) to outputs (O,).

    Linear readouts that say their weights are applied as such: validation of a single row by an
    estimator takes longer than a body's step.

    Raises
    ------
    TaskError
        When the readout cannot predict from such states, or gives another number of outputs.
    """
    if not callable(getattr(readout, "predict", None)):
        raise TaskError(
            f"the readout is a {type(readout).__name__} without predict",
            expected="a fitted estimator, or a readout that was saved",
            fix="fit it first, for example with fit_generator()",
            key="readout",
        )

    def general(row: Reals) -> Reals:
        return np.asarray(readout.predict(row[np.newaxis]), dtype=np.float64).reshape(-1)

    parts = _linear_parts(readout)
    found = parts[0].shape if parts else (n_states, len(general(np.zeros(n_states))))
    if found != (n_states, n_outputs):
        raise TaskError(
            f"the readout maps {found[0]} states to {found[1]} outputs",
            expected=f"{n_states} states, and {n_outputs} outputs as the series has",
            fix="train it on states of this body and on this series",
            key="readout",
        )
    if parts is None:
        return general
    weights, bias, mean, scale = parts

    def linear(row: Reals) -> Reals:
        out: Reals = ((row - mean) / scale) @ weights + bias
        return out

    return linear


def _linear_parts(readout: Any) -> tuple[Reals, Reals, Reals, Reals] | None:
    """Return weights (F, O), bias (O,), mean and scale (F,) of a readout that has them."""
    if not isinstance(readout, FittedReadout | Readout):
        return None
    if readout.weights is None or readout.bias is None or readout.classes is not None:
        return None
    scaling = readout.standardizer if isinstance(readout, FittedReadout) else readout
    return readout.weights, readout.bias, scaling.mean, scaling.scale
