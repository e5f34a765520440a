"""Teacher forcing: a body is driven with the series that it shall generate later.

After symbol ``y[k]`` it is in state ``x[k]``, from which a readout learns ``y[k + 1]`` (Jaeger
2001, GMD report 148; for mechanical bodies Hauser et al. 2012, doi:10.1007/s00422-012-0516-4).
Small noise on what is fed in makes the readout push the state back to the series instead of away
from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.readout.fitting import FittedReadout, fit_readout

Reals = NDArray[np.float64]


@runtime_checkable
class SteppedBody(Protocol):
    """A body that is advanced symbol by symbol, with symbols that are decided on the way.

    Where a body also has ``n_inputs``, the number of columns of a symbol, it is checked.
    """

    n_states: int

    def reset(self) -> None:
        """Go back to the state before the first symbol."""

    def step(self, u: Reals) -> Reals:
        """Apply one symbol, (C,), and return the states after it: (F,)."""


@dataclass(frozen=True)
class Feedback:
    """How outputs become the symbols that drive a body: ``u = y @ gain + offset``.

    Parameters
    ----------
    gain : float or (O, C) [unit of the input per unit of the output]
        A number scales each output into the input of the same column.
    offset : float or (C,) [unit of the input]
    limit : float, optional [unit of the input]
        Symbols are clipped to ``offset +- limit``, as an actuator saturates.
    """

    gain: float | ArrayLike = 1.0
    offset: float | ArrayLike = 0.0
    limit: float | None = None

    def __call__(self, outputs: Reals) -> Reals:
        """Return symbols for outputs: (C,) for (O,), or (K, C) for (K, O)."""
        gain = np.asarray(self.gain, dtype=np.float64)
        drive: Reals = outputs * gain if gain.ndim == 0 else outputs @ gain
        if self.limit is not None:
            drive = np.clip(drive, -self.limit, self.limit)
        return drive + np.asarray(self.offset, dtype=np.float64)


def as_series(values: ArrayLike, name: str, *, least: int = 1) -> Reals:
    """Return a series as finite rows: (K, O).

    Raises
    ------
    TaskError
        When it is no table of finite numbers, or has fewer than `least` rows.
    """
    series = np.asarray(values, dtype=np.float64)
    series = series[:, np.newaxis] if series.ndim == 1 else series
    if series.ndim != 2 or len(series) < least:
        raise TaskError(
            f"{name} of shape {np.shape(values)}",
            expected=f"(K,) or (K, O) with K of at least {least}",
            fix="pass a longer series, one row a symbol",
            key=name,
        )
    bad = np.flatnonzero(~np.isfinite(series).all(axis=1))
    if len(bad):
        raise TaskError(
            f"NaN or infinity in row {bad[0]}",
            expected="finite numbers",
            fix="cut the series where it has gaps",
            key=name,
        )
    return series


def teacher_forced_states(
    body: SteppedBody,
    teacher: ArrayLike,
    *,
    feedback: Callable[[Reals], Reals] | None = None,
    noise: float = 0.0,
    seed: int | np.random.Generator = 0,
    reset: bool = True,
) -> Reals:
    """Drive a body with a series and return its states: (K, F); row k has seen ``teacher[k]``.

    Parameters
    ----------
    body : SteppedBody
    teacher : (K,) or (K, O)
    feedback : callable, optional
        From outputs to symbols, such as a `Feedback`; without it the series itself is applied.
    noise : float [standard deviations of the teacher, column by column]
        Of the Gaussian noise that is added to the series before it is fed in.
    seed : int or Generator
        For the noise.
    reset : bool
        Begin at the body's start.

    Raises
    ------
    TaskError
        When the series is no table of finite numbers, or the body takes other symbols.
    """
    series = as_series(teacher, "teacher")
    if noise < 0.0:
        raise TaskError(
            f"noise of {noise:g}", expected="0 or more", fix="leave it at 0", key="noise"
        )
    if noise > 0.0:
        rng = np.random.default_rng(seed)
        series = series + noise * series.std(axis=0) * rng.standard_normal(series.shape)
    symbols = series if feedback is None else feedback(series)
    check_symbols(body, symbols)
    if reset:
        body.reset()
    states = np.empty((len(symbols), body.n_states))
    for row, symbol in zip(states, symbols, strict=True):
        row[:] = body.step(symbol)
    return states


def check_symbols(body: SteppedBody, symbols: Reals) -> None:
    """Refuse symbols (K, C) of a width that `body` does not take.

    Raises
    ------
    TaskError
    """
    wanted = getattr(body, "n_inputs", None)
    if symbols.ndim != 2 or (wanted is not None and symbols.shape[1] != wanted):
        raise TaskError(
            f"symbols of shape {symbols.shape}",
            expected="(K, C)" if wanted is None else f"(K, {wanted}): the body's inputs",
            fix="pass feedback=Feedback(gain) with a gain of shape (outputs, inputs)",
            key="feedback",
        )


def fit_generator(
    body: SteppedBody,
    teacher: ArrayLike | Sequence[Reals],
    readout: Any,
    *,
    washout: int,
    feedback: Callable[[Reals], Reals] | None = None,
    noise: float = 0.0,
    seed: int | np.random.Generator = 0,
    standardize: bool = True,
) -> FittedReadout:
    """Teach a readout to say the next row of a series from the states after the last one.

    Parameters
    ----------
    body : SteppedBody
        Left in the state after the last row.
    teacher : (K,) or (K, O), or a list of such arrays
        Several series each begin at the body's start. Where a cycle has to attract, some should
        approach it from elsewhere: what a readout has not seen it cannot lead back.
    readout : estimator
        Any with ``fit`` and ``predict``; a copy is fitted.
    washout : int
        Rows at the beginning of each series that are not learned from.
    feedback, noise, seed
        As for `teacher_forced_states`. Noise acts on what is fed in, not on what is learned.
    standardize : bool
        Bring states to zero mean and unit variance before the readout sees them.

    Raises
    ------
    TaskError
        When a series is shorter than the washout and three rows more, or otherwise unfit.
    """
    if washout < 0:
        raise TaskError(
            f"a washout of {washout}", expected="0 or more rows", fix="correct it", key="washout"
        )
    several = isinstance(teacher, list | tuple) and isinstance(teacher[0], np.ndarray)
    rng = np.random.default_rng(seed)
    states, targets = [], []
    for values in teacher if several else [teacher]:  # type: ignore[union-attr]
        series = as_series(values, "teacher", least=washout + 3)
        rows = teacher_forced_states(body, series, feedback=feedback, noise=noise, seed=rng)
        states.append(rows[washout:-1])
        targets.append(series[washout + 1 :])
    return fit_readout(
        readout, np.concatenate(states), np.concatenate(targets), standardize=standardize
    )
