"""An orthonormal basis of the centred states, by the cheapest route that is safe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from openprc.analysis.capacity.targets import RowSpan
from openprc.errors import TaskError
from openprc.reservoir.features.base import ROUND_OFF, is_constant

RANK_RULE = (
    "singular values of the centred states, each column at unit norm, above "
    "max(rows, states) * 2.2e-16 times the largest, and above what rounding of the stored numbers "
    "(offset included) adds"
)

#: Least reciprocal condition number (of the Gram matrix, 1-norm) down to which a Cholesky
#: factor is as good as an orthogonal factorisation. The Gram matrix is made in double precision
#: even where products with targets are not: its errors would be amplified, theirs are not.
_SAFE_RCOND = 1e-9
#: And down to which two of them are, the second of the states whitened by the first. Rows of
#: this condition have no singular value that could be taken for rounding.
_TWICE_RCOND = 1e-13
#: Numbers that stay near the processor between one pass over them and the next.
_NEAR = 32_768
#: Rounding below which no direction that Cholesky admits can be a copy.
_LITTLE_ROUNDING = 1e-8


@dataclass(frozen=True)
class CentredStates:
    """States without their mean, and their size.

    ``values`` (n, N) have zero mean in every column over the usable rows, and are zero in the
    others; ``kept`` (F,) flags the columns that vary; ``mean`` and ``norm`` (N,) are those of
    the columns kept. ``rounding`` is what the precision of the stored numbers adds to the
    singular values of columns at unit norm: columns that differ by less are copies.
    """

    values: NDArray[np.float64]
    kept: NDArray[np.bool_]
    mean: NDArray[np.float64]
    norm: NDArray[np.float64]
    rounding: float

    @property
    def n_constant(self) -> int:
        """Columns that never change, and were left out."""
        return int(np.count_nonzero(~self.kept))

    def at_unit_norm(self, dtype: DTypeLike = np.float64) -> NDArray[np.floating]:
        """Return every column divided by its norm."""
        room = np.empty(self.values.shape, dtype=dtype)
        return np.divide(self.values, self.norm, out=room, casting="same_kind")


def centre_states(states: NDArray[np.floating], span: RowSpan) -> CentredStates:
    """Centre the rows of a span, leaving out columns that never change.

    Raises
    ------
    TaskError
        When a number is missing in a usable row, or no state changes.
    """
    hull = states[span.start : span.stop]
    n = span.n_usable
    values, mean, norm = _centred(hull, span.usable)
    if not np.isfinite(norm).all():
        rows = hull if span.usable is None else hull[span.usable]
        bad = int(np.count_nonzero(~np.isfinite(rows).all(axis=1)))
        raise TaskError(
            f"{bad} of {n} rows of the states are NaN or infinite",
            expected="finite numbers in every row that counts",
            fix="pass usable= with the rows that were measured completely",
            key="states",
        )
    # Columns that cannot have changed by more than rounding are looked at closely.
    suspects = np.flatnonzero(norm <= 2 * ROUND_OFF * np.sqrt(n) * (np.abs(mean) + norm))
    kept = np.ones(len(norm), dtype=bool)
    if suspects.size:
        rows = hull if span.usable is None else hull[span.usable]
        kept[suspects] = ~is_constant(np.asarray(rows[:, suspects], dtype=np.float64))
    if not kept.any():
        raise TaskError(
            f"none of the {states.shape[1]} states changes over the {n} rows",
            expected="a body that moves",
            fix="check that the drive reached the body, or choose other features",
            key="states",
        )
    if not kept.all():
        values, mean, norm = np.ascontiguousarray(values[:, kept]), mean[kept], norm[kept]
    stored = np.finfo(states.dtype).eps if states.dtype.kind == "f" else 0.0
    eps = max(float(stored), float(np.finfo(np.float64).eps))
    # The largest number of a column is near its mean wherever rounding matters.
    rounding = eps * float(np.linalg.norm(np.sqrt(n) * np.abs(mean) / norm + 1.0))
    return CentredStates(values, kept, mean, norm, rounding)


def _centred(
    hull: NDArray[np.floating], usable: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the rows without their mean, unusable ones zero, the mean, and the norms."""
    n = len(hull) if usable is None else int(usable.sum())
    ones = np.ones(len(hull)) if usable is None else usable.astype(np.float64)
    mean = (hull if usable is None else hull[usable]).mean(axis=0, dtype=np.float64)
    values = np.empty(hull.shape)
    rest, power = np.zeros(len(mean)), np.zeros(len(mean))
    length = max(1, _NEAR // len(mean))
    for start in range(0, len(hull), length):
        rows = slice(start, start + length)
        part = np.subtract(hull[rows], mean, out=values[rows])
        if usable is not None:
            part[~usable[rows]] = 0.0
        rest += ones[rows] @ part
        power += np.einsum("ij,ij->j", part, part)
    rest /= n
    norm = np.sqrt(power)
    # The mean of a large offset is rounded; a second pass removes what that left behind.
    rest = ones @ values / n
    if (np.abs(rest) * np.sqrt(n) > 1e-12 * norm).any():
        values -= ones[:, None] * rest
        mean = mean + rest
        norm = np.sqrt(np.einsum("ij,ij->j", values, values))
    return values, mean, norm


@dataclass(frozen=True)
class StateBasis:
    """An orthonormal basis Q (n, r) of the space that the centred states span.

    ``Q^T z`` of a target is `coordinates` of ``z @ matrix``: the long products run on
    `matrix`, and what is left to do has the size of the states.

    Parameters
    ----------
    matrix : (n, N)
    norm : (N,) or None
        What its columns are to be divided by.
    rank : int
        r.
    method : {"cholesky", "cholesky twice", "qr"}
    rcond : float
        Reciprocal condition number of the Gram matrix, estimated in the 1-norm.
    """

    matrix: NDArray[np.floating]
    norm: NDArray[np.float64] | None
    rank: int
    method: str
    rcond: float
    _small: NDArray[np.float64]

    def coordinates(self, products: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return ``Q^T z`` (r, k) from ``z @ matrix`` (k, N)."""
        wide = np.asarray(products, dtype=np.float64).T
        if self.norm is not None:
            wide = wide / self.norm[:, None]
        if self.method != "qr":
            from scipy.linalg import blas

            return np.asarray(blas.dtrsm(1.0, self._small, wide, lower=1))
        return self._small.T @ wide

    def orthonormal(self) -> NDArray[np.float64]:
        """Return Q itself, (n, r)."""
        return self.coordinates(np.asarray(self.matrix, dtype=np.float64)).T


def state_basis(
    centred: CentredStates,
    *,
    n_rows: int,
    dtype: DTypeLike = np.float64,
    rank_tolerance: float | None = None,
) -> StateBasis:
    """Return the basis of centred states, whose columns are brought to unit norm.

    A Cholesky factor of the Gram matrix where it is well conditioned; the same again, of the
    whitened states, where it is badly conditioned; else a QR factorisation and the singular
    values of its small factor, which also tell the rank.

    Parameters
    ----------
    centred : CentredStates
    n_rows : int
        Rows that count.
    dtype : dtype
        Precision of the long products.
    rank_tolerance : float, optional
        Singular values below this fraction of the largest do not count.

    Raises
    ------
    TaskError
        When there are not more rows than independent states.
    """
    from scipy.linalg import blas, qr, svd

    n_states = centred.values.shape[1]
    dtype = np.dtype(dtype)
    rcond = 0.0
    if n_states < n_rows - 1 and rank_tolerance is None and centred.rounding < _LITTLE_ROUNDING:
        gram = gram_of(centred.values) / centred.norm / centred.norm[:, None]
        factor, rcond = cholesky(gram)
        if rcond > _SAFE_RCOND:
            # Single precision has no room for columns of any size.
            whole = dtype == np.float64
            matrix = centred.values if whole else centred.at_unit_norm(dtype)
            norm = centred.norm if whole else None
            return StateBasis(matrix, norm, n_states, "cholesky", rcond, factor)
        if rcond > _TWICE_RCOND:
            # Cholesky QR 2 (Yamamoto et al. 2015, Electron. Trans. Numer. Anal. 44, 306).
            white = blas.dtrsm(1.0, factor, centred.at_unit_norm().T, lower=1).T
            factor, _ = cholesky(gram_of(white))
            matrix = white.astype(dtype, copy=False)
            return StateBasis(matrix, None, n_states, "cholesky twice", rcond, factor)
    orthogonal, triangle = qr(centred.at_unit_norm(), mode="economic", check_finite=False)
    left, sizes, _ = svd(triangle, full_matrices=False, check_finite=False)
    limit = float(sizes[0]) * max(n_rows, n_states) * float(np.finfo(np.float64).eps)
    if rank_tolerance is None:
        limit = max(limit, centred.rounding)
    else:
        limit = rank_tolerance * float(sizes[0])
    rank = int(np.count_nonzero(sizes > limit))
    if rank >= n_rows - 1:
        raise too_few_rows(n_rows, rank)
    matrix = orthogonal.astype(dtype, copy=False)
    return StateBasis(matrix, None, rank, "qr", rcond, np.ascontiguousarray(left[:, :rank]))


def gram_of(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Gram matrix of the columns, (N, N)."""
    return np.asarray(matrix.T @ matrix)


def cholesky(gram: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the lower factor of a Gram matrix, and its reciprocal condition (0: failed)."""
    from scipy.linalg import lapack

    factor, failed = lapack.dpotrf(gram, lower=1, clean=1)
    if failed:
        return factor, 0.0
    size = float(np.abs(gram).sum(axis=0).max())
    return factor, float(lapack.dpocon(factor, size, uplo="L")[0])


def too_few_rows(n_rows: int, rank: int) -> TaskError:
    """Return the error for states that could reproduce any target."""
    return TaskError(
        f"{n_rows} rows for {rank} independent states",
        expected=f"more than {rank + 1} rows, and better {10 * rank}: fewer reproduce any target",
        fix="record for longer, or use fewer states",
        key="states",
    )
