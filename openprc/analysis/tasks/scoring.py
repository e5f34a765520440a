"""The figures that tasks are judged by."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.training.scores import NRMSE_DEFINITION, nmse

Metric = Literal["nrmse", "ser", "accuracy", "corr2"]

#: Name to definition, as it is written beside a number.
METRICS: dict[str, str] = {
    "nrmse": NRMSE_DEFINITION,
    "ser": "share of rows whose nearest level is not the target's",
    "accuracy": "share of rows whose nearest level is the target's",
    "corr2": "squared Pearson correlation of target and prediction",
}


def score(
    metric: Metric,
    target: ArrayLike,
    prediction: ArrayLike,
    *,
    levels: tuple[float, ...] | None = None,
) -> NDArray[np.float64]:
    """Return one figure per output, (O,); see `METRICS`.

    Parameters
    ----------
    metric : {"nrmse", "ser", "accuracy", "corr2"}
    target, prediction : (n, O) or (n,)
    levels : tuple of float
        The values that the target takes; for "ser" and "accuracy".

    Raises
    ------
    TaskError
        When shapes differ, something is not finite, the metric is unknown or lacks its
        levels, or a correlation or a variance does not exist.
    """
    y, p = _columns(target, "target"), _columns(prediction, "prediction")
    if y.shape != p.shape:
        raise TaskError(
            f"the target has shape {y.shape} and the prediction {p.shape}",
            expected="one prediction per target",
            fix="predict the same rows and outputs",
            key="prediction",
        )
    if metric == "nrmse":
        return np.sqrt(nmse(y, p))
    if metric == "corr2":
        return squared_correlation(y, p)
    if metric not in get_args(Metric):
        raise TaskError(
            f"the metric is {metric!r}",
            expected=", ".join(get_args(Metric)),
            fix="choose one of these",
            key="metric",
        )
    if not levels:
        raise TaskError(
            f"{metric!r} without levels",
            expected="the values that the target takes",
            fix="name them, or choose another metric",
            key="levels",
        )
    right = (nearest_level(p, levels) == nearest_level(y, levels)).mean(axis=0)
    return np.asarray(right if metric == "accuracy" else 1.0 - right)


def nearest_level(values: ArrayLike, levels: tuple[float, ...]) -> NDArray[np.float64]:
    """Decide: return the level next to each value; the lower one halfway between two."""
    ordered = np.sort(np.asarray(levels, dtype=np.float64))
    midpoints = 0.5 * (ordered[1:] + ordered[:-1])
    return ordered[np.searchsorted(midpoints, np.asarray(values, dtype=np.float64))]


def squared_correlation(
    target: NDArray[np.float64], prediction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return r^2 of the columns of two (n, O) arrays, (O,).

    A prediction that does not vary explains nothing and scores 0.

    Raises
    ------
    TaskError
        When a target does not vary.
    """
    y, p = target - target.mean(axis=0), prediction - prediction.mean(axis=0)
    power_y, power_p = (y**2).sum(axis=0), (p**2).sum(axis=0)
    floor = (8.0 * np.finfo(np.float64).eps * np.abs(target).max(axis=0)) ** 2 * len(target)
    if (power_y <= floor).any():
        raise TaskError(
            f"output {int(np.flatnonzero(power_y <= floor)[0])} of the target is constant",
            expected="a target that varies",
            fix="choose another target, or longer spans",
            key="target",
        )
    shared = (y * p).sum(axis=0) ** 2
    varies = power_p > 0.0
    return np.where(varies, shared / np.where(varies, power_y * power_p, 1.0), 0.0)


def _columns(values: ArrayLike, key: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or not array.size or not np.isfinite(array).all():
        raise TaskError(
            f"the {key} has shape {array.shape} or holds NaN or infinite values",
            expected="(n,) or (n, O) finite numbers",
            fix="leave out the rows that are not defined",
            key=key,
        )
    return array
