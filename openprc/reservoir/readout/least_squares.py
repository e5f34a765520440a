"""Least squares by orthogonal triangles: the readout that keeps every digit of the states."""
# ruff: noqa: TID253 - this file is a scikit-learn estimator, and nothing imports it early

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from openprc.errors import TaskError
from openprc.reservoir.training.moments import row_moments
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.standardizer import Standardizer

Reals = NDArray[np.float64]

#: Rows that are reflected into the triangle at once, and columns gathered into one reflection.
_ROWS, _PANEL = 1024, 16


@dataclass(frozen=True)
class TriangleSolution:
    """What a triangle says of the weights.

    Parameters
    ----------
    weights : (F, O)
    bias : (O,)
    rank : int
        Directions of the states that were used.
    reciprocal_condition : float
        Least over largest singular value of the penalised states.
    """

    weights: Reals
    bias: Reals
    rank: int
    reciprocal_condition: float


class LeastSquares(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Least squares by QR factorisation, of least norm where the states do not decide.

    Normal equations square the condition number: of states whose useful directions are 1e-9 of
    the largest, as those of a body that is nearly linear, nothing is left in double precision.
    A triangle of the states themselves keeps these directions down to 1e-14.

    Minimises ``|y - X w - b|^2 + regularization |w|^2`` over w and b. Meant for states of unit
    variance, which is what `openprc.reservoir.training.trainer.Trainer` passes on.

    Parameters
    ----------
    regularization : float
        Weight of the penalty, at least 0 and absolute, as in
        `openprc.reservoir.readout.ridge.Ridge`.
    rank_tolerance : float, optional
        Directions whose singular value is below this fraction of the largest are left out; by
        default F rounding errors, so that only what is copied is.

    Attributes
    ----------
    coef_ : (F,) or (O, F) float64
    intercept_ : float or (O,) float64
    n_features_in_ : int
    rank_ : int
    reciprocal_condition_ : float
    remarks_ : tuple of str

    Notes
    -----
    Householder triangles of blocks of rows, stacked and reduced again (Demmel, Grigori, Hoemmen
    and Langou 2012, doi:10.1137/080731992), with a column of ones in front: the mean is
    explained before the states meet each other. The triangle takes twice the operations of a Gram
    matrix, and no copy of the states.
    """

    def __init__(self, regularization: float = 0.0, *, rank_tolerance: float | None = None) -> None:
        self.regularization = regularization
        self.rank_tolerance = rank_tolerance

    def fit(self, X: ArrayLike, y: ArrayLike) -> LeastSquares:
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
        self.fit_blocks(RowBlocks.all_of(X), target.reshape(len(X), -1), standardize=False)
        if target.ndim == 1:
            self.coef_, self.intercept_ = self.coef_[0], float(self.intercept_[0])
        return self

    def fit_blocks(self, blocks: RowBlocks, target: Reals, *, standardize: bool) -> Standardizer:
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
        self._check()
        moments = row_moments(blocks, target)
        standardizer = Standardizer.from_moments(moments, scaled=standardize)
        active = np.flatnonzero(~standardizer.constant)
        # The columns are brought near zero mean either way: offsets cost digits and say nothing.
        mean = moments.mean_x
        triangle = row_triangle(
            blocks, target - moments.mean_y, mean=mean, scale=standardizer.scale, columns=active
        )
        found = solve_triangle(
            triangle,
            n_columns=len(active),
            regularization=float(self.regularization),
            rank_tolerance=self.rank_tolerance,
        )
        weights = np.zeros((moments.n_states, target.shape[1]))
        weights[active] = found.weights
        shift = (mean - standardizer.mean) / standardizer.scale
        self.coef_ = np.ascontiguousarray(weights.T)
        self.intercept_ = moments.mean_y + found.bias - shift @ weights
        self.n_features_in_ = moments.n_states
        self.rank_, self.reciprocal_condition_ = found.rank, found.reciprocal_condition
        self.remarks_: tuple[str, ...] = ()
        if found.rank < len(active):
            self.remarks_ = (
                f"readout: {found.rank} of {len(active)} directions of the states were used; the "
                "others are copies to working precision",
            )
        return standardizer

    def _check(self) -> None:
        tolerance = self.rank_tolerance
        for key, value, expected, fine in (
            ("regularization", self.regularization, "at least 0", _at_least(self.regularization)),
            (
                "rank_tolerance",
                tolerance,
                "at least 0 and below 1",
                tolerance is None or (_at_least(tolerance) and tolerance < 1),
            ),
        ):
            if not fine:
                raise TaskError(
                    f"{key} is {value!r}",
                    expected=f"a finite number, {expected}",
                    fix="correct it",
                    key=key,
                )

    def predict(self, X: ArrayLike) -> Reals:
        """Return predictions, (n,) or (n, O) as `y` was."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(X @ self.coef_.T + self.intercept_)

    def __sklearn_is_fitted__(self) -> bool:
        """Say whether `fit` was called."""
        return hasattr(self, "coef_")


def row_triangle(
    blocks: RowBlocks,
    target: Reals,
    *,
    mean: Reals,
    scale: Reals,
    columns: NDArray[np.intp],
) -> Reals:
    """Return the triangle R of ``[1, (X - mean) / scale, y]`` on chosen rows and columns.

    Parameters
    ----------
    blocks : RowBlocks of n rows
    target : (n, O)
    mean, scale : (F,)
    columns : (A,) int
        The states that count.

    Returns
    -------
    (1 + A + O, 1 + A + O)
        Upper triangular, up to the signs of its rows.
    """
    from scipy.linalg.lapack import dtpqrt

    width = 1 + len(columns) + target.shape[1]
    last = 1 + len(columns)
    triangle = np.zeros((width, width), order="F")
    everything = len(columns) == len(mean)
    mean, scale = mean[columns], scale[columns]
    panel = min(_PANEL, width)
    for start in range(0, len(blocks), _ROWS):
        stop = min(start + _ROWS, len(blocks))
        states = blocks.take(start, stop)
        rows = np.empty((stop - start, width), order="F")
        rows[:, 0] = 1.0
        np.subtract(states if everything else states[:, columns], mean, out=rows[:, 1:last])
        rows[:, 1:last] /= scale
        rows[:, last:] = target[start:stop]
        # A triangle above a block of rows becomes a triangle above zeros.
        triangle = dtpqrt(0, panel, triangle, rows, overwrite_a=True, overwrite_b=True)[0]
    return triangle


def solve_triangle(
    triangle: Reals,
    *,
    n_columns: int,
    regularization: float = 0.0,
    rank_tolerance: float | None = None,
) -> TriangleSolution:
    """Return bias and weights from the triangle of `row_triangle`.

    Back substitution where all directions count; otherwise by singular values of the triangle
    of the states, without those that do not, which gives the weights of least norm.

    Parameters
    ----------
    triangle : (1 + F + O, 1 + F + O)
    n_columns : int
        F.
    """
    from scipy.linalg import solve_triangular

    last = 1 + n_columns
    states, sought = triangle[1:last, 1:last], triangle[:, last:]
    known = sought[1:last]
    if regularization:
        added = np.zeros((n_columns, triangle.shape[1] - 1))
        added[:, :n_columns] = np.sqrt(regularization) * np.eye(n_columns)
        joined = np.linalg.qr(np.vstack([triangle[1:, 1:], added]), mode="r")
        states, known = joined[:n_columns, :n_columns], joined[:n_columns, n_columns:]
    if not n_columns:
        return TriangleSolution(known, sought[0] / triangle[0, 0], 0, 1.0)
    left, values, right = np.linalg.svd(states)
    tolerance = n_columns * np.finfo(np.float64).eps if rank_tolerance is None else rank_tolerance
    rank = int(np.count_nonzero(values > tolerance * values[0]))
    if rank == n_columns:
        weights = solve_triangular(states, known)
    else:
        coordinates = left[:, :rank].T @ known / values[:rank, None]
        weights = right[:rank].T @ coordinates
    bias = (sought[0] - triangle[0, 1:last] @ weights) / triangle[0, 0]
    return TriangleSolution(np.asarray(weights), bias, rank, float(values[-1] / values[0]))


def _at_least(value: float) -> bool:
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return bool(number and np.isfinite(value) and value >= 0)
