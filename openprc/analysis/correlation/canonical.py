"""Canonical correlations: the most alike combinations of inputs and of channels."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation.result import Result

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CCAResult(Result):
    """Canonical correlations, and the combinations that have them.

    Attributes
    ----------
    input_weights : (C, K) float64
        Combination of the centred inputs with unit variance, one column a pair.
    channel_weights : (N, K) float64
        The same of the channels, in the order of `channel_names`; NaN for constant ones. Where
        channels repeat each other the shortest of the possible weights.
    channel_names : tuple of str
    rank : int
        Number of independent directions among the channels.
    adjusted : (K,) float64
        Squared correlations less what unrelated channels reach by fitting,
        ``1 - (1 - R^2) (T - 1)/(T - 1 - rank)`` (Ezekiel 1930); for a single input only, and
        exact for one that is white. NaN otherwise.
    """

    input_weights: Array = field(repr=False)
    channel_weights: Array = field(repr=False)
    channel_names: tuple[str, ...] = field(repr=False)
    rank: int
    adjusted: Array


@dataclass(frozen=True)
class Basis:
    """An orthonormal basis of what some series span.

    Attributes
    ----------
    vectors : (T, r) float64
    back : (N, r) float64
        Weights of the series that make up each vector.
    """

    vectors: Array
    back: Array

    @property
    def rank(self) -> int:
        """Number of independent directions."""
        return self.vectors.shape[1]


def orthonormal_basis(rows: Array) -> Basis:
    """Return the basis of the centred rows (N, T), by singular values above rounding errors."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    left, values, right = np.linalg.svd(rows / size, full_matrices=False)
    rank = int(np.count_nonzero(values > values[0] * max(rows.shape) * np.finfo(np.float64).eps))
    return Basis(right[:rank].T, left[:, :rank] / values[:rank] / size)


def canonical_correlations(inputs: Basis, channels: Basis) -> tuple[Array, Array, Array]:
    """Return correlations (K,) in descending order, and weights (C, K) and (N, K).

    They are the singular values of the product of two orthonormal bases, which loses no digits
    (Bjorck & Golub 1973, https://doi.org/10.1090/S0025-5718-1973-0348991-3). With one input,
    the only one is the multiple correlation R.
    """
    left, values, right = np.linalg.svd(inputs.vectors.T @ channels.vectors, full_matrices=False)
    unit = np.sqrt(len(inputs.vectors))
    into, out = inputs.back @ left * unit, channels.back @ right.T * unit
    # The sign of a pair is free: let its largest input weight be positive.
    sign = np.sign(into[np.argmax(np.abs(into), axis=0), np.arange(into.shape[1])])
    return np.clip(values, 0.0, 1.0), into * sign, out * sign


def total_under(inputs: Basis, channels: Basis, orders: NDArray[np.int64]) -> Array:
    """Return the sum of squared correlations with the rows of the inputs reordered, (S,).

    Parameters
    ----------
    orders : (S, T) int64
        New orders of the rows.
    """
    totals = np.empty(len(orders))
    for k, order in enumerate(orders):
        product = channels.vectors.T @ inputs.vectors[order]
        totals[k] = np.sum(product**2)
    return totals
