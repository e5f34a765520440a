"""Ridge regression: the linear readout with the least to tune."""
# ruff: noqa: TID253 - this file is a scikit-learn estimator, and nothing imports it early

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.linear_model import Ridge as _SklearnRidge
from sklearn.utils.validation import check_is_fitted, validate_data

from openprc.errors import TaskError
from openprc.reservoir.readout.normal_equations import (
    REFINED_BELOW,
    REFINED_TWICE_BELOW,
    NormalEquations,
    Solution,
)
from openprc.reservoir.training.moments import Moments, Precision, row_moments
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.standardizer import Standardizer

AlphaScaling = Literal["none", "n", "trace"]


class Ridge(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Least squares with a penalty on the weights and none on the intercept.

    Minimises ``|y - X w - b|^2 + penalty |w|^2`` over w and b. States and targets are centred
    before products are formed: positions in metres that move by micrometres would otherwise
    cancel away. The penalty is meant for states of unit variance, which is what
    `openprc.reservoir.training.trainer.Trainer` passes on.

    Parameters
    ----------
    regularization : float or (O,) array
        Weight of the penalty, at least 0; one for all outputs, or one for each.
    alpha_scaling : {"none", "n", "trace"}
        What `regularization` is multiplied by. ``none`` leaves it absolute, as scikit-learn
        does: ten times the data weakens it tenfold. ``n`` is the number of rows, so that the
        penalty keeps its strength; ``trace`` is the mean over states of their sum of squares
        about the mean, so that it also keeps it when the states are rescaled. On states
        of unit variance the last two agree.
    precision : {"float64", "float32"}
        In which products of states are formed. ``float32`` is faster on many rows (see
        benchmarks/readout_cost.py) and leaves relative errors of 1e-7 in them, which small
        penalties on collinear states enlarge.

    Attributes
    ----------
    coef_ : (F,) or (O, F) float64
    intercept_ : float or (O,) float64
    n_features_in_ : int
    reciprocal_condition_ : float
        Of the penalised Gram matrix with unit diagonal.
    remarks_ : tuple of str
        What should be known of the solution, such as a singular Gram matrix.

    Notes
    -----
    Hoerl and Kennard 1970, doi:10.1080/00401706.1970.10488634. Solved by Cholesky factorisation
    of the Gram matrix; with a correction from the residual where that is ill-conditioned; and by
    its eigenvalues, without those that are rounding errors, where it is singular.
    """

    def __init__(
        self,
        regularization: float | ArrayLike = 1e-6,
        *,
        alpha_scaling: AlphaScaling = "none",
        precision: Precision = "float64",
    ) -> None:
        self.regularization = regularization
        self.alpha_scaling = alpha_scaling
        self.precision = precision

    def fit(self, X: ArrayLike, y: ArrayLike) -> Ridge:
        """Fit weights and intercept.

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
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        target = np.asarray(y, dtype=np.float64)
        blocks = RowBlocks.all_of(X)
        self.fit_blocks(blocks, target.reshape(len(X), -1), standardize=False)
        if target.ndim == 1:
            self.coef_, self.intercept_ = self.coef_[0], float(self.intercept_[0])
        return self

    def fit_blocks(
        self, blocks: RowBlocks, target: NDArray[np.float64], *, standardize: bool
    ) -> Standardizer:
        """Fit to chosen rows of a state matrix without copying it.

        Parameters
        ----------
        blocks : RowBlocks of n rows
        target : (n, O) float64
        standardize : bool
            Penalise, and give, the weights of states of zero mean and unit variance.

        Returns
        -------
        Standardizer
            Of the states that `coef_` (O, F) and `intercept_` (O,) act on.
        """
        moments = row_moments(blocks, target, precision=self.precision)
        return self.fit_moments(moments, standardize=standardize, rows=(blocks, target))

    def fit_moments(
        self,
        moments: Moments,
        *,
        standardize: bool,
        rows: tuple[RowBlocks, NDArray[np.float64]] | None = None,
    ) -> Standardizer:
        """Fit to second moments; see `fit_blocks`.

        Parameters
        ----------
        rows : (RowBlocks, (n, O) float64), optional
            States and targets that the moments were computed from, to correct a solution with.
        """
        standardizer = Standardizer.from_moments(moments, scaled=standardize)
        equations = NormalEquations(moments, standardizer, precision=self.precision)
        penalties = self._penalties(moments, equations)
        solution = equations.solve(penalties)
        doubtful = solution.reciprocal_condition < REFINED_BELOW or self.precision == "float32"
        if rows is not None and doubtful and solution.method == "cholesky":
            for _ in range(1 + (solution.reciprocal_condition < REFINED_TWICE_BELOW)):
                solution = equations.refine(solution, penalties, blocks=rows[0], target=rows[1])
        self._keep(solution, moments, standardizer)
        return standardizer

    def _penalties(self, moments: Moments, equations: NormalEquations) -> NDArray[np.float64]:
        given = np.asarray(self.regularization, dtype=np.float64)
        n_outputs = len(moments.mean_y)
        if not (np.isfinite(given).all() and (given >= 0).all()) or given.ndim > 1:
            raise TaskError(
                f"regularization is {self.regularization!r}",
                expected="a finite number of at least 0, or one for each output",
                fix="correct it",
                key="regularization",
            )
        if given.ndim == 1 and len(given) != n_outputs:
            raise TaskError(
                f"there are {len(given)} penalties and {n_outputs} outputs",
                expected="one penalty, or as many as outputs",
                fix="pass a single number, or one for each output",
                key="regularization",
            )
        n_active = max(1, len(equations.active))
        factors = {"none": 1.0, "n": float(moments.n), "trace": equations.trace / n_active}
        if self.alpha_scaling not in factors:
            raise TaskError(
                f"alpha_scaling is {self.alpha_scaling!r}",
                expected="one of " + ", ".join(factors),
                fix="choose one of these",
                key="alpha_scaling",
            )
        return np.broadcast_to(given * factors[self.alpha_scaling], (n_outputs,))

    def _keep(self, solution: Solution, moments: Moments, standardizer: Standardizer) -> None:
        weights = solution.weights * standardizer.scale[:, None]
        self.coef_ = np.ascontiguousarray(weights.T)
        shift = (moments.mean_x - standardizer.mean) @ solution.weights
        self.intercept_ = moments.mean_y - shift
        self.n_features_in_ = moments.n_states
        self.reciprocal_condition_ = solution.reciprocal_condition
        self.remarks_: tuple[str, ...] = ()
        if solution.method != "cholesky":
            n_active = int(np.count_nonzero(~standardizer.constant))
            self.remarks_ = (
                f"readout: the Gram matrix is singular to working precision (reciprocal condition "
                f"number {solution.reciprocal_condition:.1e}): {solution.rank} of {n_active} "
                "directions were used; raise the regularization, or drop copied states",
            )

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return predictions, (n,) or (n, O) as `y` was."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(X @ self.coef_.T + self.intercept_)

    def __sklearn_is_fitted__(self) -> bool:
        """Say whether `fit` was called."""
        return hasattr(self, "coef_")


def penalty_of(estimator: Any) -> float | None:
    """Return the absolute ridge penalty of an estimator of ours or of scikit-learn, else None.

    None also where it depends on the number of rows, or differs from output to output.
    """
    if isinstance(estimator, Ridge) and estimator.alpha_scaling == "none":
        penalty = estimator.regularization
    elif isinstance(estimator, _SklearnRidge):
        penalty = estimator.alpha
    else:
        return None
    return float(penalty) if np.isscalar(penalty) else None
