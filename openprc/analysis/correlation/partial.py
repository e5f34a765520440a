"""Correlation of two channels after the influence of all others has been removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A smallest over largest eigenvalue below which quotients of the inverse have lost four digits
#: and more.
SINGULAR = 1e-12
#: Added then to the diagonal, in units of the largest eigenvalue: rounding errors, magnified by
#: its inverse, and the change that it makes are alike there.
RIDGE = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True)
class PartialCorrelation:
    """Partial correlations and the series that they correlate.

    Attributes
    ----------
    values : (N, N) float64
        With ones on the diagonal.
    residuals : (N, T) float64
        Each channel less its regression on all others.
    rank : int
        Numerical rank of the correlation matrix.
    regularized : bool
        Whether `RIDGE` was added because the matrix has no inverse.
    """

    values: Array
    residuals: Array
    rank: int
    regularized: bool


def partial_correlation(rows: Array) -> PartialCorrelation:
    """Return ``rho_ij = -P_ij / sqrt(P_ii P_jj)`` with the precision matrix P.

    P is the inverse of the correlation matrix (Whittaker 1990, Graphical Models in Applied
    Multivariate Statistics, corollary 5.8.2). A matrix without an inverse (duplicated channels,
    or fewer rows than channels) gets a ridge, so small that the result is the limit of none: two
    copies of a channel have a partial correlation of 1 with each other and of 0 with the rest.

    Parameters
    ----------
    rows : (N, T) float64
        Centred, none of them constant.
    """
    n_channels, n = rows.shape
    unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    eigenvalues, vectors = np.linalg.eigh(unit @ unit.T)
    largest = eigenvalues[-1]
    cut = max(n_channels, n) * np.finfo(np.float64).eps * largest
    rank = int(np.count_nonzero(eigenvalues > cut))
    regularized = bool(eigenvalues[0] < SINGULAR * largest)
    shifted = np.maximum(eigenvalues, 0.0) + (RIDGE * largest if regularized else 0.0)
    precision = (vectors / shifted) @ vectors.T
    precision = 0.5 * (precision + precision.T)  # rounded alike on both sides
    scale = np.sqrt(np.diag(precision))
    values = np.clip(-precision / np.outer(scale, scale), -1.0, 1.0)
    np.fill_diagonal(values, 1.0)
    residuals = (precision / np.diag(precision)[:, None]) @ unit
    return PartialCorrelation(values, residuals, rank, regularized)
