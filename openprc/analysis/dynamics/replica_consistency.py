"""Consistency: how much of the response is determined by the drive, by a replica test.

The same drive is applied twice, from different initial states or with whatever noise the
measurement has. What both responses share is what the drive determined, and no readout can
recover more than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dimension.spectra import checked_cut, checked_states
from openprc.errors import TaskError
from openprc.reservoir.features.base import is_constant


@dataclass(frozen=True)
class Consistency:
    """Shares of variance that replicas have in common, by direction of the state space.

    Parameters
    ----------
    spectrum : (r,) float64
        Consistency of the r directions that are retained, in descending order. 1: wholly
        determined by the drive; 0: not at all. Negative values are the scatter of a finite
        record about zero and are kept, so that sums are not biased.
    directions : (F, r) float64
        Unit vectors of these directions in the space of the standardised columns.
    per_component : (r,) float64
        Correlation between replicas of each principal component, in the order of `variance`.
    variance : (r,) float64
        Share of the variance that each principal component carries.
    per_channel : (F,) float64
        Correlation between replicas of each column that changes.
    mean_shift : (F,) float64
        Largest difference between the means of two replicas, in standard deviations. Means are
        subtracted before anything is compared; a body that settles in one of several states
        shows here.
    constant : tuple of int
        Positions of the columns that change in no replica; left out.
    n_rows, n_replicas : int
    """

    spectrum: NDArray[np.float64]
    directions: NDArray[np.float64]
    per_component: NDArray[np.float64]
    variance: NDArray[np.float64]
    per_channel: NDArray[np.float64]
    mean_shift: NDArray[np.float64]
    constant: tuple[int, ...]
    n_rows: int
    n_replicas: int

    @property
    def rank(self) -> int:
        """Directions that are retained, r."""
        return len(self.spectrum)

    @property
    def capacity(self) -> float:
        """Consistency capacity: the sum of the spectrum, at most the rank.

        An upper limit of the total information processing capacity (Jüngling et al. 2022,
        doi:10.1109/TNNLS.2021.3119548).
        """
        return float(self.spectrum.sum())

    @property
    def mean_level(self) -> float:
        """Consistency of a typical principal component, weighted by variance."""
        return float(self.per_component @ self.variance / self.variance.sum())


def consistency(replicas: Sequence[ArrayLike], *, relative: float | None = None) -> Consistency:
    """Compare the responses of a body to one drive, applied several times.

    With S the covariance of the states, averaged over replicas, and K the symmetric part of
    their cross-covariance, averaged over pairs, the spectrum are the eigenvalues of
    ``S^(-1/2) K S^(-1/2)`` (Lymburn et al. 2019, Chaos 29:023118, arXiv:1901.07729). Identical
    replicas have eigenvalues 1; independent noise of ``rho`` times the variance of the common
    part lowers them to ``1 / (1 + rho)``.

    Parameters
    ----------
    replicas : two or more arrays (T, N)
        Row by row the response to the same symbol or instant of the drive, washout left out.
        Columns are standardised.
    relative : float, optional
        Directions whose standard deviation is below this fraction of the largest are left out.
        Without it only those at rounding level are.

    Raises
    ------
    TaskError
        When there are fewer than two replicas, or their shapes differ, or no column changes,
        or there are not more rows than columns, so that every direction would be a fit.

    Examples
    --------
    >>> import numpy as np
    >>> response = np.random.default_rng(0).normal(size=(500, 6))
    >>> round(consistency([response, response]).capacity, 9)
    6.0
    """
    stack, constant = _standardised(replicas)
    centred, shift = stack.centred, stack.mean_shift
    n_rows, n_columns = centred[0].shape
    if n_rows <= n_columns:
        raise TaskError(
            f"there are {n_rows} rows and {n_columns} columns that change",
            expected="more rows than columns, several times as many for sharp figures",
            fix="record for longer, or choose fewer features",
            key="replicas",
        )
    # All replicas on top of each other: the right singular vectors are the axes of S.
    tall = np.concatenate(centred) / np.sqrt(len(centred) * n_rows)
    _, sigma, axes = np.linalg.svd(np.linalg.qr(tall, mode="r"))
    floor = max(float(sigma[0]) * max(tall.shape) * float(np.finfo(np.float64).eps), stack.rounding)
    if relative is not None:
        floor = max(floor, checked_cut(relative) * float(sigma[0]))
    kept = sigma > floor
    sigma, axes = sigma[kept], axes[kept]
    white = [rows @ (axes.T / sigma) for rows in centred]
    pairs = list(combinations(white, 2))
    shared = sum(a.T @ b + b.T @ a for a, b in pairs) / (2.0 * len(pairs) * n_rows)
    levels, turn = np.linalg.eigh(shared)
    order = np.argsort(-levels, kind="stable")
    # A direction of the whitened space is read out by these weights on the columns.
    weights = (axes.T / sigma) @ turn[:, order]
    return Consistency(
        spectrum=levels[order],
        directions=weights / np.linalg.norm(weights, axis=0),
        per_component=_correlations(white),
        variance=sigma**2 / np.sum(sigma**2),
        per_channel=_correlations(centred),
        mean_shift=shift,
        constant=constant,
        n_rows=n_rows,
        n_replicas=len(centred),
    )


@dataclass(frozen=True)
class _Stack:
    centred: list[NDArray[np.float64]]
    mean_shift: NDArray[np.float64]
    rounding: float


def _standardised(replicas: Sequence[ArrayLike]) -> tuple[_Stack, tuple[int, ...]]:
    """Centre each replica by itself, scale columns by their common standard deviation."""
    arrays = checked_replicas(replicas)
    flags = np.logical_and.reduce([is_constant(rows) for rows in arrays])
    if flags.all():
        raise TaskError(
            f"none of the {len(flags)} columns changes in any replica",
            expected="at least one column that changes",
            fix="leave out clamped nodes, or drive the body",
            key="replicas",
        )
    kept = [rows[:, ~flags] for rows in arrays]
    means = np.stack([rows.mean(axis=0) for rows in kept])
    centred = [rows - mean for rows, mean in zip(kept, means, strict=True)]
    for rows in centred:
        rows -= rows.mean(axis=0)
    scale = np.sqrt(np.mean([rows.var(axis=0) for rows in centred], axis=0))
    size = np.max([np.abs(rows).max(axis=0) for rows in kept], axis=0) / scale
    for rows in centred:
        rows /= scale
    stack = _Stack(
        centred=centred,
        mean_shift=np.ptp(means, axis=0) / scale,
        rounding=float(np.finfo(np.float64).eps * np.linalg.norm(size)),
    )
    return stack, tuple(np.flatnonzero(flags).tolist())


def checked_replicas(replicas: Sequence[ArrayLike]) -> list[NDArray[np.float64]]:
    """Return replicas as float64 matrices of one shape.

    Raises
    ------
    TaskError
        When there are fewer than two, or shapes differ.
    """
    arrays = [checked_states(rows, key=f"replica {number}") for number, rows in enumerate(replicas)]
    shapes = {rows.shape for rows in arrays}
    if len(arrays) < 2 or len(shapes) > 1:
        raise TaskError(
            f"there are {len(arrays)} replicas of shapes {', '.join(map(str, sorted(shapes)))}",
            expected="two or more of one shape (T, N)",
            fix="cut them to the same rows and read the same features",
            key="replicas",
        )
    return arrays


def _correlations(replicas: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the mean over pairs of the correlation of each column; 0 where one is flat."""
    found = []
    for a, b in combinations(replicas, 2):
        norm = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0)
        found.append(np.sum(a * b, axis=0) / np.where(norm > 0.0, norm, 1.0))
    return np.mean(found, axis=0)
