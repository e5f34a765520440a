"""Scores of labels: accuracy, symbol error rate, confusion matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError


@dataclass(frozen=True)
class Classification:
    """How often predicted labels are right.

    Parameters
    ----------
    labels : (C,)
        All labels that occur, sorted.
    confusion : (C, C) int
        Number of rows with the label of the matrix row that were given that of the column.
    majority : float
        Accuracy of always naming the commonest label of the training rows: what a score has
        to be above.
    """

    labels: NDArray[Any]
    confusion: NDArray[np.int64]
    majority: float

    @property
    def accuracy(self) -> float:
        """Share of rows that were given their label."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    @property
    def symbol_error_rate(self) -> float:
        """Share of rows that were given another label: one less the accuracy."""
        return 1.0 - self.accuracy


def classification(
    target: NDArray[Any], prediction: NDArray[Any], *, commonest: Any
) -> Classification:
    """Compare labels (n,) with predicted ones; `commonest` is that of the training rows."""
    labels, codes = np.unique(np.concatenate([target, prediction]), return_inverse=True)
    true, named = codes[: len(target)], codes[len(target) :]
    size = len(labels)
    counts = np.bincount(true * size + named, minlength=size * size).reshape(size, size)
    return Classification(labels, counts, float(np.mean(target == commonest)))


def commonest_label(labels: NDArray[Any]) -> Any:
    """Return the label that occurs most often, the first in order among equals."""
    values, counts = np.unique(labels, return_counts=True)
    return values[counts.argmax()]


def symbol_error_rate(
    target: ArrayLike, prediction: ArrayLike, *, alphabet: ArrayLike | None = None
) -> float:
    """Return the share of symbols that are decided wrongly when the nearest one is taken.

    This is for a readout that is a regressor; a classifier decides for itself.

    Parameters
    ----------
    target : (n,)
        Symbols, such as -3, -1, 1, 3.
    prediction : (n,)
        Real numbers.
    alphabet : (C,), optional
        The symbols there are; those of the target by default.

    Raises
    ------
    TaskError
        When the lengths differ.
    """
    y, p = np.ravel(np.asarray(target, float)), np.ravel(np.asarray(prediction, float))
    if len(y) != len(p) or not len(y):
        raise TaskError(
            f"there are {len(y)} symbols and {len(p)} predictions",
            expected="as many of each, and at least one",
            fix="compare predictions with the symbols of the same rows",
            key="prediction",
        )
    symbols = np.unique(y if alphabet is None else np.asarray(alphabet, float))
    decided = np.searchsorted(0.5 * (symbols[1:] + symbols[:-1]), p)
    return float(np.mean(symbols[decided] != y))
