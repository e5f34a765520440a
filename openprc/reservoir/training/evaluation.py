"""Fit on training rows, predict test rows, score: the same for bodies and for baselines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.readout.fitting import FittedReadout, fit_readout
from openprc.reservoir.training.scores import nmse
from openprc.reservoir.training.split import Split


@dataclass(frozen=True)
class Evaluation:
    """A fitted readout and what it predicts.

    ``train_rows`` (n,) and ``test_rows`` (m,) number the rows used; ``prediction`` of the test
    rows is (m, O); ``nmse`` and ``train_nmse`` are (O,).
    """

    fitted: FittedReadout
    train_rows: NDArray[np.intp]
    test_rows: NDArray[np.intp]
    prediction: NDArray[np.float64]
    train_nmse: NDArray[np.float64]
    nmse: NDArray[np.float64]

    @property
    def mean_nmse(self) -> float:
        """NMSE on the test rows, mean over outputs."""
        return float(self.nmse.mean())

    @property
    def mean_nrmse(self) -> float:
        """NRMSE on the test rows, mean over outputs."""
        return float(np.sqrt(self.nmse).mean())


def evaluate(
    readout: Any,
    states: NDArray[np.float64],
    target: NDArray[np.float64],
    *,
    split: Split,
    usable: NDArray[np.bool_] | None = None,
    standardize: bool = True,
) -> Evaluation:
    """Fit a copy of `readout` on the training rows and score it on the test rows.

    Parameters
    ----------
    states : (R, F) float64
    target : (R, O) float64
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
    fitted = fit_readout(readout, _take(states, train), target[train], standardize=standardize)
    prediction = fitted.predict(_take(states, test))
    return Evaluation(
        fitted=fitted,
        train_rows=train,
        test_rows=test,
        prediction=prediction,
        train_nmse=nmse(target[train], fitted.train_prediction),
        nmse=nmse(target[test], prediction),
    )


def _take(states: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return rows of a matrix: a view where they are consecutive, which they mostly are."""
    first, stop = int(rows[0]), int(rows[-1]) + 1
    return states[first:stop] if stop - first == len(rows) else states[rows]
