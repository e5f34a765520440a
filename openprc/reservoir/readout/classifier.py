"""Classifiers as readouts: labels in, labels out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.readout.affine_map import Affine, probed_map

Reals = NDArray[np.float64]


def is_classifier(readout: Any) -> bool:
    """Say whether an estimator, or the last step of a pipeline, tells classes apart."""
    if hasattr(readout, "__sklearn_tags__"):
        from sklearn.base import is_classifier as asked

        return bool(asked(readout))
    return getattr(readout, "_estimator_type", None) == "classifier"


def as_labels(y: ArrayLike) -> NDArray[Any]:
    """Return one label per row, (n,), as text or as whole numbers.

    Raises
    ------
    TaskError
        When there are several columns, or numbers that are not whole.
    """
    labels = np.asarray(y)
    if labels.ndim == 2 and labels.shape[1] == 1:
        labels = labels[:, 0]
    if labels.ndim != 1:
        raise TaskError(
            f"the labels have shape {labels.shape}",
            expected="one label per row, (n,)",
            fix="train one readout for each column",
            key="y",
        )
    if labels.dtype.kind == "O":
        labels = labels.astype(str)
    if labels.dtype.kind == "f":
        if not (np.isfinite(labels).all() and (labels == np.rint(labels)).all()):
            raise TaskError(
                "the readout is a classifier and the target has numbers that are not whole",
                expected="labels: text, or whole numbers",
                fix="pass labels, or a readout that is a regressor",
                key="y",
            )
        labels = labels.astype(np.int64)
    if labels.dtype.kind not in "USiub":
        raise TaskError(
            f"the labels are of type {labels.dtype}",
            expected="labels: text, or whole numbers",
            fix="convert them",
            key="y",
        )
    return labels


def linear_decision(estimator: Any, x: Reals, expected: NDArray[Any]) -> Affine | None:
    """Return weights (F, K) and bias (K,) of a linear classifier, or None for any other.

    K is 1 for two classes and the number of classes otherwise. What is found has to name the
    classes, `expected` (n,), that the estimator itself predicts for rows `x` (n, F).
    """
    decide = getattr(estimator, "decision_function", None)
    if decide is None:
        return None
    scores = np.asarray(decide(x), dtype=np.float64).reshape(len(x), -1)
    classes = np.asarray(estimator.classes_)
    if scores.shape[1] != (1 if len(classes) == 2 else len(classes)):
        return None
    found = probed_map(decide, x, scores)
    if found is None or (named(classes, x @ found[0] + found[1]) != expected).any():
        return None
    return found


def named(classes: NDArray[Any], scores: Reals) -> NDArray[Any]:
    """Return the class of each row of scores (n, K): the larger one, or that of the sign."""
    if scores.shape[1] == 1:
        return classes[(scores[:, 0] > 0).astype(np.intp)]
    return classes[scores.argmax(axis=1)]


SequenceSummary = Literal["mean", "last", "flatten"]


def sequence_states(
    states: Sequence[ArrayLike] | ArrayLike, *, summary: SequenceSummary = "mean", washout: int = 0
) -> Reals:
    """Turn one state matrix per sequence into one row per sequence, for any classifier.

    Parameters
    ----------
    states : sequence of (T_i, F), or (S, T, F)
        The states while each of S sequences was played.
    summary : {"mean", "last", "flatten"}
        Mean over time, last row, or all rows side by side, which needs equal lengths.
    washout : int
        Rows left out at the start of every sequence.

    Returns
    -------
    (S, F) float64, or (S, (T - washout) F) for ``flatten``

    Raises
    ------
    TaskError
        When a sequence has no rows left, or lengths differ where they must not, or the
        summary is unknown.
    """
    if summary not in ("mean", "last", "flatten"):
        raise TaskError(
            f"summary is {summary!r}",
            expected="mean, last or flatten",
            fix="choose one of these",
            key="summary",
        )
    parts = [np.asarray(part, dtype=np.float64)[washout:] for part in states]
    for number, part in enumerate(parts):
        if part.ndim != 2 or not len(part):
            raise TaskError(
                f"sequence {number} has states of shape {part.shape} after the washout",
                expected="(T, F) with at least one row",
                fix="shorten the washout, or leave that sequence out",
                key="states",
            )
    if summary == "mean":
        return np.stack([part.mean(axis=0) for part in parts])
    if summary == "last":
        return np.stack([part[-1] for part in parts])
    lengths = sorted({len(part) for part in parts})
    if len(lengths) > 1:
        raise TaskError(
            f"sequences have {lengths[0]} to {lengths[-1]} rows",
            expected="one length",
            fix='use summary="mean" or "last", or cut the sequences to one length',
            key="states",
        )
    return np.stack([part.ravel() for part in parts])
