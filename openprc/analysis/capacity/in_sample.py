"""In-sample capacities: the part of each target that lies in the space of the states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.capacity.state_basis import StateBasis
from openprc.analysis.capacity.targets import RowSpan, TargetRows, chunks
from openprc.errors import TaskError


@dataclass
class Sums:
    """Running sums over rows of one chunk of targets: what a capacity is made of.

    ``products`` (k, N) with the states, ``total`` (k,) and ``power`` (k,) of the targets.
    """

    products: NDArray[np.floating]
    total: NDArray[np.float64]
    power: NDArray[np.float64]

    @classmethod
    def over(
        cls,
        targets: TargetRows,
        chunk: range,
        *,
        span: RowSpan,
        matrix: NDArray[np.floating],
        buffer: NDArray[np.floating],
    ) -> Sums:
        """Add up the rows of a span; row i of `matrix` (n, N) belongs to row start + i."""
        size = len(chunk)
        sums = cls(
            np.zeros((size, matrix.shape[1]), dtype=matrix.dtype), np.zeros(size), np.zeros(size)
        )
        for block in span.blocks():
            rows = targets.fill(chunk, block, buffer)
            sums.products += rows @ matrix[block.start - span.start : block.stop - span.start]
            sums.total += rows @ np.ones(rows.shape[1], dtype=rows.dtype)
            sums.power += np.vecdot(rows, rows)
        return sums

    def variance(self, n_rows: int) -> NDArray[np.float64]:
        """Return the centred power ``sum (z - mean)^2``; 0 for a constant target, (k,)."""
        centred = self.power - self.total**2 / n_rows
        rounding = 64.0 * np.finfo(self.products.dtype).eps
        return np.where(centred > rounding * self.power, centred, 0.0)


def in_sample_capacities(
    basis: StateBasis, targets: TargetRows, *, span: RowSpan
) -> NDArray[np.float64]:
    """Return ``C = |Q^T z|^2 / |z|^2`` of every target, z without its mean, (K,).

    This is ``1 - min_w <(z - w x - b)^2> / <(z - <z>)^2>`` of Dambre et al. 2012
    (doi:10.1038/srep00514, Eq. 5) with an intercept; `Q` is an orthonormal basis of the centred
    states. A target that is constant over the rows has no capacity, and is 0.
    """
    n_rows = span.n_usable
    found = np.zeros(len(targets))
    buffer = targets.buffer(span)
    for chunk in chunks(len(targets)):
        sums = Sums.over(targets, chunk, span=span, matrix=basis.matrix, buffer=buffer)
        inside = basis.coordinates(sums.products)
        power = sums.variance(n_rows)
        np.divide(
            np.einsum("rk,rk->k", inside, inside),
            power,
            out=found[chunk.start : chunk.stop],
            where=power > 0,
        )
    return found


@dataclass(frozen=True)
class OrthonormalTargets:
    """Targets made exactly orthonormal over the rows that count.

    ``values`` (n, K): zero mean, unit norm, mutually orthogonal columns; a target that depends
    on earlier ones is a column of zeros, and ``dependent`` (K,) flags it.
    """

    values: NDArray[np.float64]
    dependent: NDArray[np.bool_]


#: A target of which less than this fraction (of its norm) is new counts as dependent.
_NOTHING_NEW = 1e-7


def orthonormal_targets(targets: TargetRows, *, span: RowSpan) -> OrthonormalTargets:
    """Orthonormalise the targets one after the other, in their order, by QR.

    The sum of their capacities then cannot exceed the rank of the states, whatever the input:
    it is ``|Q^T Z|_F^2`` of two matrices with orthonormal columns.

    Raises
    ------
    TaskError
        When there are as many targets as rows: they would fill the whole space.
    """
    from scipy.linalg import qr

    n_rows, n_terms = span.n_usable, len(targets)
    if n_terms >= n_rows - 1:
        raise TaskError(
            f"{n_terms} targets over {n_rows} rows",
            expected="fewer targets than rows, to make them orthonormal",
            fix="lower the largest delay of the high degrees, or record for longer",
            key="orthonormalize",
        )
    values = np.empty((n_rows, n_terms), order="F")
    buffer = np.empty((min(n_terms, 64), span.stop - span.start), dtype=targets.dtype)
    for chunk in chunks(n_terms, 64):
        rows = targets.fill(chunk, span, buffer)
        values[:, chunk.start : chunk.stop] = (
            rows if span.usable is None else rows[:, span.usable]
        ).T
    size = np.linalg.norm(values, axis=0)
    values -= values.mean(axis=0)
    orthogonal, triangle = qr(values, mode="economic", overwrite_a=True, check_finite=False)
    dependent = np.abs(np.diag(triangle)) <= _NOTHING_NEW * size
    orthogonal[:, dependent] = 0.0
    return OrthonormalTargets(orthogonal, dependent)


def orthonormal_capacities(
    states: NDArray[np.float64], targets: OrthonormalTargets
) -> NDArray[np.float64]:
    """Return the capacities (K,) of orthonormal targets in orthonormal states (n, r)."""
    inside = states.T @ targets.values
    return np.einsum("rk,rk->k", inside, inside)
