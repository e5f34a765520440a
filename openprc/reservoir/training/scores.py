"""Errors and scores of predictions. One definition, named wherever a number is stored."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

Reals = NDArray[np.float64]

#: What is written beside every score.
NMSE_DEFINITION = "mean((y - p)^2) / var(y), ddof 0, over the test rows"
NRMSE_DEFINITION = "sqrt(mean((y - p)^2)) / std(y), ddof 0, over the test rows"

ScoreName = Literal[
    "nrmse",
    "nmse",
    "mse",
    "rmse",
    "r2",
    "corr2",
    "nrmse_range",
    "nrmse_mean",
    "nrmse_ddof1",
    "nmse_power",
]

#: What each score is, in words that can be stored. The literature calls several of them NRMSE.
DEFINITIONS: dict[str, str] = {
    "nrmse": "sqrt(mean((y - p)^2)) / std(y), ddof 0",
    "nmse": "mean((y - p)^2) / var(y), ddof 0",
    "mse": "mean((y - p)^2)",
    "rmse": "sqrt(mean((y - p)^2))",
    "r2": "1 - sum((y - p)^2) / sum((y - mean(y))^2)",
    "corr2": "squared Pearson correlation of y and p",
    "nrmse_range": "sqrt(mean((y - p)^2)) / (max(y) - min(y))",
    "nrmse_mean": "sqrt(mean((y - p)^2)) / |mean(y)|",
    "nrmse_ddof1": "sqrt(mean((y - p)^2)) / std(y), ddof 1",
    "nmse_power": "sum((y - p)^2) / sum(y^2)",
}


def nmse(target: Reals, prediction: Reals) -> Reals:
    """Return the mean squared error over the target's variance (ddof 0), one per output.

    The square root of it is the NRMSE; 1 is what the mean of the target scores.

    Parameters
    ----------
    target, prediction : (n, O) float64

    Raises
    ------
    TaskError
        When a target does not vary.
    """
    return _mse(target, prediction) / varying(target)


def varying(target: Reals) -> Reals:
    """Return the variances (ddof 0) of targets (n, O), and refuse one that does not vary.

    Raises
    ------
    TaskError
        When a target does not vary.
    """
    variance = target.var(axis=0)
    size = np.abs(target).max(axis=0)
    flat = variance <= (8.0 * np.finfo(np.float64).eps * size) ** 2
    if flat.any():
        raise TaskError(
            f"output {int(np.flatnonzero(flat)[0])} of the target is constant over these rows",
            expected="a target that varies, since errors are divided by its variance",
            fix="choose another target, or longer training and test spans",
            key="y",
        )
    return np.asarray(variance)


def score(target: ArrayLike, prediction: ArrayLike, *, name: ScoreName = "nrmse") -> Reals:
    """Return a score, one per output; `DEFINITIONS` says what each name means.

    Parameters
    ----------
    target, prediction : (n,) or (n, O)
    name : str
        ``nrmse`` by default: what is called NRMSE in every file of this package.

    Raises
    ------
    TaskError
        When the shapes differ, the name is unknown, or what errors are divided by is zero.

    Examples
    --------
    >>> float(score([1, 2, 3, 4], [1.1, 1.9, 3.2, 3.8])[0].round(6))
    0.141421
    """
    y, p = _columns(target), _columns(prediction)
    if y.shape != p.shape or not len(y):
        raise TaskError(
            f"the target has shape {np.shape(target)} and the prediction {np.shape(prediction)}",
            expected="the same shape, with at least one row",
            fix="compare predictions with the target of the same rows",
            key="prediction",
        )
    if name not in _SCORES:
        raise TaskError(
            f"the score is {name!r}",
            expected="one of " + ", ".join(get_args(ScoreName)),
            fix="choose one of these",
            key="name",
        )
    return np.asarray(_SCORES[name](y, p))


def _columns(values: ArrayLike) -> Reals:
    array = np.asarray(values, dtype=np.float64)
    return array[:, None] if array.ndim == 1 else array


def _mse(y: Reals, p: Reals) -> Reals:
    return np.asarray(np.mean((y - p) ** 2, axis=0))


def _divided(error: Reals, by: Reals, what: str) -> Reals:
    if (by == 0).any():
        raise TaskError(
            f"{what} of output {int(np.flatnonzero(by == 0)[0])} is zero",
            expected="a number that errors can be divided by",
            fix="use another score, such as nrmse",
            key="name",
        )
    return error / by


def _corr2(y: Reals, p: Reals) -> Reals:
    a, b = y - y.mean(axis=0), p - p.mean(axis=0)
    # A constant prediction is correlated with nothing.
    power = np.sum(b * b, axis=0)
    product = np.sum(a * b, axis=0) ** 2 / (varying(y) * len(y))
    return np.where(power > 0, product / np.where(power > 0, power, 1.0), 0.0)


def _ddof1(y: Reals, p: Reals) -> Reals:
    varying(y)
    return np.sqrt(_mse(y, p)) / y.std(axis=0, ddof=1)


_SCORES: dict[str, Callable[[Reals, Reals], Reals]] = {
    "nrmse": lambda y, p: np.sqrt(nmse(y, p)),
    "nmse": nmse,
    "mse": _mse,
    "rmse": lambda y, p: np.sqrt(_mse(y, p)),
    "r2": lambda y, p: 1.0 - nmse(y, p),
    "corr2": _corr2,
    "nrmse_range": lambda y, p: _divided(np.sqrt(_mse(y, p)), np.ptp(y, axis=0), "the range"),
    "nrmse_mean": lambda y, p: _divided(np.sqrt(_mse(y, p)), np.abs(y.mean(axis=0)), "the mean"),
    "nrmse_ddof1": _ddof1,
    "nmse_power": lambda y, p: _divided(
        np.sum((y - p) ** 2, axis=0), np.sum(y * y, axis=0), "the power"
    ),
}
