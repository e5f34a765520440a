"""Penalised least squares from second moments: Cholesky, and what to do where it fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.training.moments import Moments, Precision
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.standardizer import Standardizer

#: Below this reciprocal condition number a solution is corrected once with its residual.
REFINED_BELOW = 1e-7
#: And below this one, twice.
REFINED_TWICE_BELOW = 1e-13


@dataclass(frozen=True)
class Solution:
    """Weights of ridge regression.

    Parameters
    ----------
    weights : (F, O) float64
        On the raw states, which are centred first.
    method : {"cholesky", "eigenvalues"}
    reciprocal_condition : float
        Of the penalised Gram matrix with unit diagonal, least over the penalties; estimated in
        the 1-norm by Cholesky, of the spectrum otherwise.
    rank : int
        Directions used.
    """

    weights: NDArray[np.float64]
    method: str
    reciprocal_condition: float
    rank: int


class NormalEquations:
    """``(G + diag(p)) w = g`` for centred moments, one column of g per output.

    The matrix is brought to unit diagonal first, which costs nothing and takes the units of the
    states out of its condition number (van der Sluis 1969, doi:10.1007/BF02165096).

    Parameters
    ----------
    moments : Moments
    standardizer : Standardizer
        Penalties act on weights of states divided by its scale. Its constant columns get no
        weight at all.
    precision : {"float64", "float32"}
        In which the products were formed: directions below its rounding errors are not used.
    """

    def __init__(
        self, moments: Moments, standardizer: Standardizer, *, precision: Precision = "float64"
    ) -> None:
        self.moments = moments
        self.eps = float(np.finfo(precision).eps)
        self.scale = standardizer.scale
        self.active = np.flatnonzero(~standardizer.constant)
        whole = len(self.active) == moments.n_states
        self.gram = moments.gxx if whole else moments.gxx[np.ix_(self.active, self.active)]
        self.products = moments.gxy if whole else moments.gxy[self.active]
        self._factors: dict[float, _Factor] = {}

    @property
    def trace(self) -> float:
        """Sum of squares of the centred states, divided by their scales."""
        return float(np.sum(np.diagonal(self.gram) / self.scale[self.active] ** 2))

    def solve(self, penalties: NDArray[np.float64]) -> Solution:
        """Return the weights for penalties (O,) on standardised weights, one per output."""
        return self._solve(penalties, self.products)

    def refine(
        self,
        solution: Solution,
        penalties: NDArray[np.float64],
        *,
        blocks: RowBlocks,
        target: NDArray[np.float64],
    ) -> Solution:
        """Return a solution corrected with its residual on the rows themselves.

        One such step undoes most of what squaring the condition number in the Gram matrix
        costs: the corrected seminormal equations, Björck 1987, doi:10.1016/0024-3795(87)90101-7.

        Parameters
        ----------
        blocks : RowBlocks
            The rows that the moments were computed from.
        target : (n, O)
        """
        mean_x, mean_y = self.moments.mean_x, self.moments.mean_y
        gradient = np.zeros_like(solution.weights)
        for place, states in blocks:
            centred = states - mean_x
            gradient += centred.T @ (target[place] - mean_y - centred @ solution.weights)
        gradient -= np.outer(self.scale**2, penalties) * solution.weights
        step = self._solve(penalties, gradient[self.active])
        return Solution(
            solution.weights + step.weights,
            solution.method,
            solution.reciprocal_condition,
            solution.rank,
        )

    def _solve(self, penalties: NDArray[np.float64], products: NDArray[np.float64]) -> Solution:
        weights = np.zeros((self.moments.n_states, products.shape[1]))
        used: list[_Factor] = []
        for penalty in np.unique(penalties):
            outputs = np.flatnonzero(penalties == penalty)
            factor = self._factor(float(penalty))
            weights[np.ix_(self.active, outputs)] = factor.solve(products[:, outputs])
            used.append(factor)
        worst = min(used, key=lambda factor: (factor.rank, factor.reciprocal_condition))
        return Solution(weights, worst.method, worst.reciprocal_condition, worst.rank)

    def _factor(self, penalty: float) -> _Factor:
        if penalty not in self._factors:
            added = penalty * self.scale[self.active] ** 2
            self._factors[penalty] = _Factor(self.gram, added, self.eps)
        return self._factors[penalty]


class _Factor:
    """One factored matrix G + diag(p), brought to unit diagonal."""

    def __init__(self, gram: NDArray[np.float64], added: NDArray[np.float64], eps: float) -> None:
        from scipy.linalg.lapack import dpocon, dpotrf

        size = len(gram)
        diagonal = np.diagonal(gram) + added
        self.unit = 1.0 / np.sqrt(diagonal)
        matrix = gram * self.unit[:, None]
        matrix *= self.unit
        np.fill_diagonal(matrix, 1.0)
        norm = float(np.abs(matrix).sum(axis=0).max(initial=0.0))
        self.method, self.rank, self.reciprocal_condition = "cholesky", size, 1.0
        if not size:
            return
        # The matrix is symmetric, so its transpose is the same matrix in Fortran's order.
        self.triangle, failed = dpotrf(matrix.T, lower=1, clean=0)
        if not failed:
            self.reciprocal_condition = float(dpocon(self.triangle, norm, uplo="L")[0])
        if failed or self.reciprocal_condition < size * eps:
            self._use_eigenvalues(matrix, size * eps)

    def _use_eigenvalues(self, matrix: NDArray[np.float64], smallest: float) -> None:
        values, self.vectors = np.linalg.eigh(matrix)
        kept = values > smallest * values[-1]
        self.inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
        self.method, self.rank = "eigenvalues", int(np.count_nonzero(kept))
        self.reciprocal_condition = max(float(values[0] / values[-1]), 0.0)

    def solve(self, products: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the solution for right-hand sides (F, O)."""
        from scipy.linalg.lapack import dpotrs

        if not len(products):
            return products
        scaled = products * self.unit[:, None]
        if self.method == "cholesky":
            solved, _ = dpotrs(self.triangle, scaled, lower=1)
        else:
            solved = self.vectors @ (self.inverse[:, None] * (self.vectors.T @ scaled))
        return np.asarray(solved * self.unit[:, None])
