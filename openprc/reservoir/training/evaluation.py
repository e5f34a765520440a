"""Fit on training rows, predict test rows, score: the same for bodies and for baselines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.readout.fitting import FittedReadout, fit_readout
from openprc.reservoir.training.classification import (
    Classification,
    classification,
    commonest_label,
)
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.row_split import RowSplit
from openprc.reservoir.training.scores import nmse


@dataclass(frozen=True)
class Evaluation:
    """A fitted readout and what it predicts.

    ``train_rows`` (n,) and ``test_rows`` (m,) number the rows used; ``prediction`` of the test
    rows is (m, O); ``nmse`` and ``train_nmse`` are (O,). Of a classifier the predictions are
    labels, (m,), its errors are empty, and ``classification`` and ``train_classification`` say
    how often it was right; they are None otherwise.
    """

    fitted: FittedReadout
    train_rows: NDArray[np.intp]
    test_rows: NDArray[np.intp]
    prediction: NDArray[Any]
    train_nmse: NDArray[np.float64]
    nmse: NDArray[np.float64]
    classification: Classification | None = None
    train_classification: Classification | None = None

    @property
    def mean_nmse(self) -> float:
        """NMSE on the test rows, mean over outputs.

        Raises
        ------
        TaskError
            When the readout is a classifier.
        """
        self._require_numbers()
        return float(self.nmse.mean())

    @property
    def mean_nrmse(self) -> float:
        """NRMSE on the test rows, mean over outputs; raises as `mean_nmse`."""
        self._require_numbers()
        return float(np.sqrt(self.nmse).mean())

    def _require_numbers(self) -> None:
        if self.classification is not None:
            raise TaskError(
                "the readout is a classifier, and labels have no mean squared error",
                expected="a regressor",
                fix="ask for accuracy, symbol_error_rate or confusion instead",
                key="nmse",
            )


def evaluate(
    readout: Any,
    states: NDArray[np.float64],
    target: NDArray[Any],
    *,
    split: RowSplit,
    usable: NDArray[np.bool_] | None = None,
    standardize: bool = True,
) -> Evaluation:
    """Fit a copy of `readout` on the training rows and score it on the test rows.

    Parameters
    ----------
    states : (R, F) float64
    target : (R, O) float64, or labels (R,) for a classifier
    usable : (R,) bool, optional
        Rows that were measured completely.

    Raises
    ------
    TaskError
        When the split does not fit the rows, or the target is constant on a span.
    """
    if split.n_rows > len(states):
        raise TaskError(
            f"the split needs {split.n_rows} rows and there are {len(states)}",
            expected=f"at most {len(states)} rows",
            fix="shorten the spans",
            key="split",
        )
    if usable is None:
        usable = np.ones(len(states), dtype=bool)
    train, test = split.masks(usable)
    fitted = fit_readout(readout, states, target[train], rows=train, standardize=standardize)
    prediction = fitted.predict_rows(RowBlocks(states, test))
    return scored(fitted, target, train=train, test=test, prediction=prediction)


def scored(
    fitted: FittedReadout,
    target: NDArray[Any],
    *,
    train: NDArray[np.intp],
    test: NDArray[np.intp],
    prediction: NDArray[Any],
) -> Evaluation:
    """Compare what a readout predicts with targets (R, O), or labels (R,), of all rows."""
    if fitted.classes is None:
        return Evaluation(
            fitted=fitted,
            train_rows=train,
            test_rows=test,
            prediction=prediction,
            train_nmse=nmse(target[train], fitted.train_prediction),
            nmse=nmse(target[test], prediction),
        )
    commonest = commonest_label(target[train])
    return Evaluation(
        fitted=fitted,
        train_rows=train,
        test_rows=test,
        prediction=prediction,
        train_nmse=np.empty(0),
        nmse=np.empty(0),
        classification=classification(target[test], prediction, commonest=commonest),
        train_classification=classification(
            target[train], fitted.train_prediction, commonest=commonest
        ),
    )
