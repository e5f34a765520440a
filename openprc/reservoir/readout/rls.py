"""Recursive least squares: a linear readout that learns row by row."""
# ruff: noqa: TID253 - this file is a scikit-learn estimator, and nothing imports it early

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from openprc.errors import TaskError
from openprc.reservoir.readout.triangular import TriangularFactor


class RLS(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Recursive least squares with forgetting; the bias is one of the regressors.

    After n rows weights and bias minimise
    ``sum_i forgetting^(n - i) |y_i - x_i w - b|^2 + regularization |w|^2``: with
    ``forgetting=1`` that is `openprc.reservoir.Ridge` with the same penalty, however the rows
    were divided into calls. The penalty does not fade with the rows (see
    `openprc.reservoir.readout.triangular.TriangularFactor`, which also says how digits are kept),
    so that directions without excitation stay at rest.

    Parameters
    ----------
    regularization : float
        Penalty on the weights, above 0; none on the bias. In other notation the covariance
        starts as the identity divided by it.
    forgetting : float
        Factor in (0, 1] by which a row loses weight with each one that follows. The memory is
        ``1 / (1 - forgetting)`` rows.

    Attributes
    ----------
    coef_ : (F,) or (O, F) float64
    intercept_ : float or (O,) float64
    n_features_in_ : int
    n_samples_seen_ : int

    Notes
    -----
    Haykin, Adaptive Filter Theory, chapters on the RLS algorithm and its square-root forms. A row
    costs O(F^2).

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.reservoir.readout.rls import RLS
    >>> x = np.random.default_rng(0).normal(size=(200, 3))
    >>> readout = RLS(1e-9)
    >>> for block in np.split(x, 10):
    ...     readout = readout.partial_fit(block, block @ [1.0, 2.0, 3.0] + 12.0)
    >>> float(round(readout.intercept_, 6))
    12.0
    """

    def __init__(self, regularization: float = 1e-6, *, forgetting: float = 1.0) -> None:
        self.regularization = regularization
        self.forgetting = forgetting

    def fit(self, X: ArrayLike, y: ArrayLike) -> RLS:
        """Forget everything and learn from all rows.

        Parameters
        ----------
        X : (n, F)
        y : (n,) or (n, O)

        Raises
        ------
        TaskError
            When a parameter is out of its range.
        ValueError
            As scikit-learn does: shapes that do not match, NaN.
        """
        if hasattr(self, "_factor"):
            del self._factor
        return self.partial_fit(X, y)

    def partial_fit(self, X: ArrayLike, y: ArrayLike) -> RLS:
        """Learn from more rows, in their order; a single row is (1, F).

        Parameters
        ----------
        X : (n, F)
        y : (n,) or (n, O), as in the first call

        Raises
        ------
        TaskError, ValueError
            As `fit` does; also when the number of columns or targets has changed.
        """
        first = not hasattr(self, "_factor")
        if first or not self._is_plain(X, y):
            X, y = validate_data(
                self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, reset=first
            )
        targets = np.asarray(y, dtype=np.float64)
        flat = targets.ndim == 1
        targets = targets[:, np.newaxis] if flat else targets
        if first:
            self._factor = self._started(X.shape[1], targets.shape[1])
            self._flat = flat
        elif targets.shape[1] != self._factor.n_targets:
            raise TaskError(
                f"a target with {targets.shape[1]} columns",
                expected=f"{self._factor.n_targets}, as in the first call",
                fix="call fit() to begin anew",
                key="y",
            )
        self._factor.add_rows(X, targets)
        self._publish()
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return predictions, (n,) or (n, O) as `y` was."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(X @ self.coef_.T + self.intercept_)

    def __sklearn_is_fitted__(self) -> bool:
        """Say whether anything was learned."""
        return hasattr(self, "_factor")

    def _is_plain(self, X: ArrayLike, y: ArrayLike) -> bool:
        """Say whether rows need no validation, which takes longer than learning one of them."""
        return (
            type(X) is np.ndarray
            and type(y) is np.ndarray
            and X.dtype == y.dtype == np.float64
            and X.ndim == 2
            and X.shape[1] == self.n_features_in_
            and y.shape == (len(X),) + (() if self._flat else (self._factor.n_targets,))
            and len(X) > 0
            and not hasattr(self, "feature_names_in_")
            and bool(np.isfinite(X).all() and np.isfinite(y).all())
        )

    def _started(self, n_columns: int, n_targets: int) -> TriangularFactor:
        check_rls(self.regularization, self.forgetting)
        return TriangularFactor(
            n_columns, n_targets, penalty=self.regularization, forgetting=self.forgetting
        )

    def _publish(self) -> None:
        solution = self._factor.solution()
        self.n_samples_seen_ = self._factor.n_rows
        self.coef_ = solution[1:, 0].copy() if self._flat else solution[1:].T.copy()
        self.intercept_ = float(solution[0, 0]) if self._flat else solution[0].copy()


def check_rls(regularization: float, forgetting: float) -> None:
    """Refuse parameters that have no solution.

    Raises
    ------
    TaskError
        When `regularization` is not above 0, or `forgetting` not in (0, 1].
    """
    if not (np.isfinite(regularization) and regularization > 0.0):
        raise TaskError(
            f"a regularization of {regularization!r}",
            expected="a number above 0: the first rows alone determine no weights",
            fix="take a small one such as 1e-6",
            key="regularization",
        )
    if not 0.0 < forgetting <= 1.0:
        raise TaskError(
            f"a forgetting factor of {forgetting!r}",
            expected="a number above 0 and at most 1",
            fix="take 1 to forget nothing, or 1 - 1/n for a memory of n rows",
            key="forgetting",
        )
