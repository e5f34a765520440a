"""Normalised errors. One definition, named wherever a number is stored."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

#: What is written beside every score.
NMSE_DEFINITION = "mean((y - p)^2) / var(y), ddof 0, over the test rows"
NRMSE_DEFINITION = "sqrt(mean((y - p)^2)) / std(y), ddof 0, over the test rows"


def nmse(target: NDArray[np.float64], prediction: NDArray[np.float64]) -> NDArray[np.float64]:
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
    return np.asarray(np.mean((target - prediction) ** 2, axis=0) / variance)
