"""Ridge regression: the linear readout with the least to tune."""
# ruff: noqa: TID253 - this file is a scikit-learn estimator, and nothing imports it early

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.linear_model import Ridge as _SklearnRidge
from sklearn.utils.validation import check_is_fitted, validate_data


class Ridge(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Least squares with a penalty on the weights and none on the intercept.

    Minimises ``|y - X w - b|^2 + regularization |w|^2`` over w and b. States and targets are
    centred before the Gram matrix is formed: positions in metres that move by micrometres
    would otherwise cancel away.

    The penalty is absolute. It is neither divided by the number of rows nor scaled by the
    trace, so ten times the data weakens it tenfold; and it is meant for states of unit
    variance, which is what `openprc.reservoir.training.trainer.Trainer` passes on.

    Parameters
    ----------
    regularization : float
        Weight of the penalty, at least 0.

    Attributes
    ----------
    coef_ : (F,) or (O, F) float64
    intercept_ : float or (O,) float64
    n_features_in_ : int

    Notes
    -----
    Hoerl and Kennard 1970, doi:10.1080/00401706.1970.10488634. The solver is scikit-learn's.
    """

    def __init__(self, regularization: float = 1e-6) -> None:
        self.regularization = regularization

    def fit(self, X: ArrayLike, y: ArrayLike) -> Ridge:
        """Fit weights and intercept.

        Parameters
        ----------
        X : (n, F)
        y : (n,) or (n, O)

        Raises
        ------
        ValueError
            As scikit-learn does: shapes that do not match, NaN, a negative penalty.
        """
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        self._model = _SklearnRidge(alpha=self.regularization).fit(X, y)
        self.coef_ = self._model.coef_
        self.intercept_ = self._model.intercept_
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return predictions, (n,) or (n, O) as `y` was."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(self._model.predict(X))

    def __sklearn_is_fitted__(self) -> bool:
        """Say whether `fit` was called."""
        return hasattr(self, "_model")


def penalty_of(estimator: Any) -> float | None:
    """Return the ridge penalty of an estimator of ours or of scikit-learn, else None."""
    if isinstance(estimator, Ridge):
        return float(estimator.regularization)
    if isinstance(estimator, _SklearnRidge) and np.isscalar(estimator.alpha):
        return float(estimator.alpha)
    return None
