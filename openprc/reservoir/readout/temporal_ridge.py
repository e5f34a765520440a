"""A ridge that chooses its penalty on folds of time."""
# ruff: noqa: TID253 - this file is a scikit-learn estimator, and nothing imports it early

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.cross_validation import (
    DEFAULT_PENALTIES,
    Scheme,
    cross_validate,
    temporal_folds,
)
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.standardizer import Standardizer

#: A target is taken to be forgotten where its autocorrelation stays below this.
_FORGOTTEN = 0.1


class TemporalRidgeCV(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Ridge regression whose penalty is chosen by cross-validation on folds of time.

    Parameters
    ----------
    penalties : (P,)
        To choose from; absolute, on states of unit variance.
    n_folds : int
    gap : int or "auto"
        Rows left out on either side of a tested fold. It should be at least as long as the body
        remembers; ``auto`` takes the lag beyond which the target's autocorrelation stays
        below 0.1, and a tenth of a fold at most.
    scheme : {"blocked", "forward"}
        See `openprc.reservoir.training.cross_validation.temporal_folds`.
    per_output : bool
        Choose a penalty for each output, rather than one for all.

    Attributes
    ----------
    regularization_ : float or (O,) float64
    cv_ : CrossValidation
    gap_ : int
    coef_, intercept_, remarks_
        As of `openprc.reservoir.Ridge`.

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(400, 3))
    >>> TemporalRidgeCV().fit(x, x @ [1.0, 2.0, 3.0]).regularization_
    1e-08
    """

    def __init__(
        self,
        penalties: ArrayLike = DEFAULT_PENALTIES,
        *,
        n_folds: int = 5,
        gap: int | Literal["auto"] = "auto",
        scheme: Scheme = "blocked",
        per_output: bool = False,
    ) -> None:
        self.penalties = penalties
        self.n_folds = n_folds
        self.gap = gap
        self.scheme = scheme
        self.per_output = per_output

    def fit(self, X: ArrayLike, y: ArrayLike) -> TemporalRidgeCV:
        """Choose the penalty and fit to all rows, which are in order of time.

        Parameters
        ----------
        X : (n, F)
        y : (n,) or (n, O)

        Raises
        ------
        TaskError
            When rows do not suffice for the folds and their gaps.
        ValueError
            As scikit-learn does: shapes that do not match, NaN.
        """
        X, y = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=2
        )
        target = np.asarray(y, dtype=np.float64)
        self.fit_blocks(RowBlocks.all_of(X), target.reshape(len(X), -1), standardize=False)
        if target.ndim == 1:
            self.coef_, self.intercept_ = self.coef_[0], float(self.intercept_[0])
        return self

    def fit_blocks(
        self, blocks: RowBlocks, target: NDArray[np.float64], *, standardize: bool
    ) -> Standardizer:
        """Fit to chosen rows of a state matrix; see `openprc.reservoir.Ridge.fit_blocks`."""
        self.gap_ = self._gap(target)
        folds = temporal_folds(blocks.rows, n_folds=self.n_folds, gap=self.gap_, scheme=self.scheme)
        self.cv_ = cross_validate(
            blocks,
            target,
            penalties=np.asarray(self.penalties, dtype=np.float64),
            folds=folds,
            standardize=standardize,
        )
        chosen = self.cv_.best if self.per_output else self.cv_.best_overall
        self.regularization_ = chosen
        ridge = Ridge(chosen)
        # The pieces of the folds add up to all rows: nothing is read again.
        standardizer = ridge.fit_moments(
            self.cv_.moments, standardize=standardize, rows=(blocks, target)
        )
        self.coef_, self.intercept_ = ridge.coef_, ridge.intercept_
        self.n_features_in_ = ridge.n_features_in_
        self.remarks_ = ridge.remarks_
        return standardizer

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return predictions, (n,) or (n, O) as `y` was."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(X @ self.coef_.T + self.intercept_)

    def _gap(self, target: NDArray[np.float64]) -> int:
        if self.gap != "auto":
            return int(self.gap)
        longest = max(1, len(target) // (10 * self.n_folds))
        return min(forgetting_lag(target), longest)


def forgetting_lag(target: NDArray[np.float64]) -> int:
    """Return the lag beyond which no column (n, O) has an autocorrelation of 0.1 or more."""
    n = len(target)
    centred = target - target.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(centred, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[: max(1, n // 2)]
    power = np.where(correlation[0] > 0, correlation[0], 1.0)
    # What n white values reach by chance does not count either.
    limit = max(_FORGOTTEN, 4.0 / np.sqrt(n))
    remembered = np.flatnonzero((np.abs(correlation / power) >= limit).any(axis=1))
    return int(remembered[-1]) + 1 if remembered.size else 1
