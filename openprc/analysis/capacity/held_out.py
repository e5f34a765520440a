"""Held-out capacities: a ridge readout fitted on some rows and scored on others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from openprc.analysis.capacity.in_sample import Sums
from openprc.analysis.capacity.state_basis import centre_states, cholesky
from openprc.analysis.capacity.targets import RowSpan, TargetRows, chunks
from openprc.analysis.capacity.thresholds import check_alpha
from openprc.errors import TaskError

HELD_OUT_DEFINITION = (
    "1 - sum((z - prediction)^2) / sum((z - mean(z))^2) on the test rows; ridge with a free "
    "intercept on standardised states, penalty = ridge * number of training rows"
)


#: Reciprocal condition number above which Cholesky factors are trusted.
_SAFE_RCOND = 1e-9


@dataclass(frozen=True)
class HeldOutReadout:
    """The ridge readouts of all targets at once.

    `train` (n, N) and `test` (m, N) are the states, centred and scaled by the training rows, and
    are multiplied with the targets. ``W V`` of the products with the training rows are weights,
    W (N, r) and V (r, N) being the factors of the inverse of Gram matrix and penalty.
    """

    train: NDArray[np.floating]
    test: NDArray[np.floating]
    test_total: NDArray[np.float64]
    test_gram: NDArray[np.float64]
    inverse: tuple[NDArray[np.float64], NDArray[np.float64]]
    shrunk: NDArray[np.float64]
    rank: int

    def weights(self, products: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the weights (N, k) of targets from their products (k, N) with `train`."""
        left, right = self.inverse
        return left @ (right @ np.asarray(products, dtype=np.float64).T)


def held_out_readout(
    states: NDArray[np.floating],
    *,
    train: RowSpan,
    test: RowSpan,
    ridge: float,
    dtype: DTypeLike = np.float64,
) -> HeldOutReadout:
    """Prepare the readouts of all targets.

    Raises
    ------
    TaskError
        When the penalty is negative, or numbers are missing.
    """
    if not (np.isfinite(ridge) and ridge >= 0):
        raise TaskError(
            f"ridge is {ridge!r}",
            expected="a penalty of at least 0, relative to the variance of a state",
            fix="choose one, such as 1e-6",
            key="ridge",
        )
    centred = centre_states(states, train)
    inside = centred.at_unit_norm()
    dtype = np.dtype(dtype)
    hull = states[test.start : test.stop]
    outside = np.subtract(
        hull if centred.kept.all() else hull[:, centred.kept], centred.mean, dtype=np.float64
    )
    outside /= centred.norm
    if test.usable is not None:
        outside[~test.usable] = 0.0
    total = np.ones(len(outside)) @ outside
    if not np.isfinite(total).all():
        raise TaskError(
            "test rows of the states are NaN or infinite",
            expected="finite numbers in every row that counts",
            fix="pass usable= with the rows that were measured completely",
            key="states",
        )
    left, right, shrunk = _inverse(inside, ridge=ridge, n_rows=train.n_usable)
    inner = outside.astype(dtype, copy=False)
    return HeldOutReadout(
        train=inside.astype(dtype, copy=False),
        test=inner,
        test_total=total,
        test_gram=np.asarray(outside.T @ outside),
        inverse=(left, right),
        shrunk=shrunk,
        rank=left.shape[1],
    )


def _inverse(
    states: NDArray[np.floating], *, ridge: float, n_rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return W (N, r) and V (r, N), and what the penalty leaves, ``V X^T X V^T`` (r, r).

    The columns have unit norm, so a penalty of `ridge` times the variance of a state, added up
    over the rows, is `ridge` itself.
    """
    from scipy.linalg import eigh, lapack, qr, svd

    n_states = states.shape[1]
    eps = float(np.finfo(np.float64).eps)
    gram = states.T @ states
    if cholesky(gram)[1] > _SAFE_RCOND:
        # Of full rank beyond doubt: a triangular factor is as good, and costs far less.
        factor, _ = cholesky(gram + ridge * np.eye(n_states))
        right = np.ascontiguousarray(lapack.dtrtri(factor, lower=1)[0])
        return right.T, right, np.eye(n_states) - ridge * (right @ right.T)
    power, vectors = eigh(gram, check_finite=False)
    # A Gram matrix has lost half of the digits. Where the small directions count, because no
    # penalty covers them, they are taken from the states themselves.
    if ridge >= 1e-9:
        seen = power > 4 * n_states * eps * power[-1]
        power, vectors = power[seen], vectors[:, seen]
    else:
        triangle = qr(states, mode="r", check_finite=False)[0][:n_states]
        _, sizes, across = svd(triangle, full_matrices=False, check_finite=False)
        seen = sizes > max(n_rows, n_states) * eps * sizes[0]
        power, vectors = sizes[seen] ** 2, across[seen].T
    half = vectors / np.sqrt(power + ridge)
    return half, np.ascontiguousarray(half.T), np.diag(power / (power + ridge))


def held_out_capacities(
    readout: HeldOutReadout, targets: TargetRows, *, train: RowSpan, test: RowSpan
) -> NDArray[np.float64]:
    """Return ``1 - NMSE`` on the test rows for every target, (K,); it may be negative.

    A target that is constant over the test rows has no capacity, and is 0.
    """
    found = np.zeros(len(targets))
    buffer, other = targets.buffer(train), targets.buffer(test)
    n_train, n_test = train.n_usable, test.n_usable
    for chunk in chunks(len(targets)):
        inside = Sums.over(targets, chunk, span=train, matrix=readout.train, buffer=buffer)
        outside = Sums.over(targets, chunk, span=test, matrix=readout.test, buffer=other)
        mean = inside.total / n_train
        weights = readout.weights(inside.products)
        crossed = outside.products.T - readout.test_total[:, None] * mean
        error = (
            outside.power
            - 2.0 * mean * outside.total
            + n_test * mean**2
            - 2.0 * np.einsum("nk,nk->k", weights, crossed)
            + np.einsum("nk,nk->k", weights, readout.test_gram @ weights)
        )
        power = outside.variance(n_test)
        ratio = np.ones(len(chunk))
        np.divide(error, power, out=ratio, where=power > 0)
        found[chunk.start : chunk.stop] = 1.0 - ratio
    return found


#: Quantiles of the size of predictions, and of their offset, that chance is averaged over.
_SIZES, _OFFSETS = 16, 3


def held_out_threshold(
    readout: HeldOutReadout, *, n_train: int, n_test: int, probability: float
) -> tuple[float, float]:
    """Return what the held-out capacity of chance exceeds with a probability, and its mean.

    The coordinates of a white target on the training rows are standard normal, so its
    predictions p on the test rows have ``|p|^2 = sum lambda_i chi^2_1``, lambda being the
    eigenvalues of ``V X^T X V^T V G V^T`` for the centred Gram matrix G of the test rows. A
    scaled chi-square of the same mean and variance stands in for it (Satterthwaite 1946,
    doi:10.2307/3002019). The target on the test rows is white and independent of p, so with
    ``q = |p| / |z|``, which then follows an F distribution, and c the cosine between p and z,
    ``c^2 ~ Beta(1/2, (m - 2)/2)`` for m rows, the capacity is ``2 q c - q^2 - d^2``, where d is
    the offset of the prediction, from the means of z over n training and m test rows and of p.
    Its mean is negative.

    Raises
    ------
    TaskError
        When the probability is out of range.
    """
    from scipy.optimize import brentq
    from scipy.special import betaincc, chdtri, fdtri

    check_alpha(probability)
    _, right = readout.inverse
    total = right @ readout.test_total
    size = readout.shrunk @ (right @ readout.test_gram @ right.T - np.outer(total, total) / n_test)
    mean, spread = float(np.trace(size)), float(np.einsum("ij,ji->", size, size))
    middle = (np.arange(_SIZES) + 0.5) / _SIZES
    power = mean / (n_test - 1) * fdtri(mean**2 / spread, n_test - 1, middle)
    # The mean of z differs between the two spans, and p has a mean of its own.
    share = 1.0 + n_test / n_train + float(total @ readout.shrunk @ total) / n_test
    middle = (np.arange(_OFFSETS) + 0.5) / _OFFSETS
    offset = share / (n_test - 1) * chdtri(1.0, middle)
    loss = (power[:, None] + offset).ravel()
    size_of = np.repeat(np.sqrt(power), _OFFSETS)

    def exceeded(capacity: float) -> float:
        cosine = (capacity + loss) / (2.0 * size_of)
        tail = betaincc(0.5, (n_test - 2) / 2, np.clip(cosine**2, 0.0, 1.0)) / 2.0
        return float(np.where(cosine >= 0, tail, 1.0 - tail).mean()) - probability

    low = -float(loss.max()) - 2.0 * float(size_of.max())
    return float(brentq(exceeded, low, 1.0, xtol=1e-8)), -(mean + share) / (n_test - 1)
