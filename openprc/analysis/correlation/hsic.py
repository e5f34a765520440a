"""The Hilbert-Schmidt independence criterion at a cost that is linear in the number of rows.

Gretton, Bousquet, Smola & Schoelkopf 2005, https://doi.org/10.1007/11564089_7. The matrix of a
Gaussian kernel of one series has few directions above rounding errors; an incomplete Cholesky
factorisation finds them (Fine & Scheinberg 2001, J. Mach. Learn. Res. 2, 243), and the
criterion, at all circular shifts if wanted, follows from these alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

Array = NDArray[np.float64]

#: Largest error of an element of a kernel matrix, whose diagonal is 1.
KERNEL_ERROR = 1e-13
#: Share of the largest possible criterion below which a product of two directions is left out
#: of the profile over shifts.
LEAST_SHARE = 1e-13
#: More directions than this mean outliers far apart, and a matrix that is not compressible.
MOST_DIRECTIONS = 1000


@dataclass(frozen=True)
class Bandwidth:
    """Width of the kernel.

    Attributes
    ----------
    value : float
        Median of the distances of all pairs of samples; of those pairs that differ when more
        than half of them do not.
    many_ties : bool
        Whether more than half of the pairs do not differ.
    """

    value: float
    many_ties: bool


def median_distance(series: Array) -> Bandwidth:
    """Return the median of ``|x_i - x_j|``, i < j, exactly, in O(T log T)."""
    ordered = np.sort(series)
    n = len(ordered)
    value = _middle(ordered, 1, n * (n - 1) // 2)
    if value > 0:
        return Bandwidth(value, False)
    sizes = np.unique(ordered, return_counts=True)[1]
    tied = int(np.sum(sizes * (sizes - 1) // 2))
    return Bandwidth(_middle(ordered, tied + 1, n * (n - 1) // 2), True)


def _middle(ordered: Array, first: int, last: int) -> float:
    """Return the median of the `first`-th to the `last`-th smallest distance."""
    from openprc.analysis.correlation.kernels import ordered_distance  # noqa: PLC0415 - numba, heavy

    count = last - first + 1
    lower, upper = ordered_distance(ordered, first + (count - 1) // 2)
    return float(lower if count % 2 else 0.5 * (lower + upper))


@dataclass(frozen=True)
class KernelSeries:
    """One series, prepared once for any number of others.

    Attributes
    ----------
    features : (r, T) float64
        The kernel matrix is ``features.T @ features`` to `KERNEL_ERROR`.
    bandwidth : Bandwidth
    """

    features: Array
    bandwidth: Bandwidth

    @classmethod
    def of(cls, series: Array) -> KernelSeries:
        """Factorise ``exp(-(x_i - x_j)^2 / (2 s^2))`` of a series (T,) that is not constant.

        Raises
        ------
        TaskError
            When outliers make the series incompressible.
        """
        bandwidth = median_distance(series)
        scaled = series / (np.sqrt(2.0) * bandwidth.value)
        return cls(_cholesky(scaled), bandwidth)

    @property
    def centred(self) -> Array:
        """Factors of the centred kernel matrix, (r, T)."""
        return self.features - self.features.mean(axis=1, keepdims=True)


def _cholesky(scaled: Array) -> Array:
    n = len(scaled)
    found = np.empty((min(n, 32), n))
    rest = np.ones(n)
    for rank in range(min(n, MOST_DIRECTIONS)):
        pivot = int(np.argmax(rest))
        if rest[pivot] <= KERNEL_ERROR:
            return found[:rank]
        if rank == len(found):
            found = np.concatenate([found, np.empty((min(len(found), n - rank), n))])
        row = np.exp(-np.square(scaled - scaled[pivot]))
        row -= found[:rank, pivot] @ found[:rank]
        row /= np.sqrt(rest[pivot])
        found[rank] = row
        rest -= row * row
        rest[pivot] = 0.0
    if n > MOST_DIRECTIONS:
        raise TaskError(
            f"more than {MOST_DIRECTIONS} kernels do not span the series: its extremes are many"
            " median distances apart",
            expected="a series without such outliers",
            fix="replace it by its ranks, or take dcor, which has no bandwidth",
            key="hsic",
        )
    return found


def hsic(x: KernelSeries, y: KernelSeries) -> float:
    """Return the biased criterion ``tr(K H L H) / T^2``."""
    return float(np.sum((x.centred @ y.centred.T) ** 2) / x.features.shape[1] ** 2)


def hsic_reordered(x: KernelSeries, y: KernelSeries, orders: Iterable[NDArray[np.int64]]) -> Array:
    """Return the criterion of `x` with `y` in other orders of its rows, one an order."""
    a, b = x.centred, y.centred
    n = a.shape[1]
    return np.array([np.sum((a @ b[:, order].T) ** 2) / n**2 for order in orders])


@dataclass(frozen=True)
class ShiftProfile:
    """The criterion at all circular shifts, and what it would be without dependence.

    Attributes
    ----------
    values : (T,) float64
        At shifts 0 to T - 1.
    cumulants : (float, float, float)
        Mean, variance and third cumulant without dependence: of a sum of squares of normal
        variables, one for every product of a direction of one series and one of the other. Their
        variances are what the products have at distant shifts, which keep the memory of both.
    """

    values: Array
    cumulants: tuple[float, float, float]

    @property
    def threshold(self) -> float:
        """The value that a single shift passes with probability 5 %."""
        from scipy import special

        freedom, mean, scale = self._fit
        return float(mean + scale * (special.chdtri(freedom, 0.05) - freedom))

    def p_values(self, observed: Array) -> Array:
        """Return p-values, however small, by a chi-squared law with the same three cumulants.

        Buckley & Eagleson 1988, https://doi.org/10.1111/j.1467-842X.1988.tb00471.x.
        """
        from scipy import special

        freedom, mean, scale = self._fit
        ratio = freedom + (observed - mean) / scale
        return np.asarray(special.chdtrc(freedom, np.maximum(ratio, 0.0)))

    @property
    def _fit(self) -> tuple[float, float, float]:
        mean, variance, third = self.cumulants
        freedom = 8.0 * variance**3 / third**2
        return freedom, mean, float(np.sqrt(variance / (2.0 * freedom)))


def hsic_by_shift(x: KernelSeries, y: KernelSeries, *, far: slice | None = None) -> ShiftProfile:
    """Return the criterion of x(t) and y(t + shift) for all circular shifts.

    Every product of a direction of one and a direction of the other is a circular correlation:
    O(r^2 T log T) for all shifts together.

    Parameters
    ----------
    far : slice, optional
        The shifts at which there is no dependence; all by default.
    """
    from scipy import fft

    a, b = _principal(x.centred), _principal(y.centred)
    n = a.shape[1]
    a_squares, b_squares = np.sum(a**2, axis=1), np.sum(b**2, axis=1)
    share = LEAST_SHARE * float(a_squares.sum() * b_squares.sum())
    a_hat, b_hat = np.conj(fft.rfft(a, axis=1)), fft.rfft(b, axis=1)
    total = np.zeros(n)
    variances = []
    for row, squares in zip(a_hat, a_squares, strict=True):
        # Both are in descending order.
        last = int(np.count_nonzero(squares * b_squares > share))
        if last:
            products = fft.irfft(row * b_hat[:last], n, axis=1) ** 2
            total += products.sum(axis=0)
            variances.append(products[:, far or slice(None)].mean(axis=1))
    v = np.concatenate(variances) / n**2
    cumulants = float(v.sum()), float(2.0 * (v @ v)), float(8.0 * np.sum(v**3))
    return ShiftProfile(total / n**2, cumulants)


def kernel_correlation(x: KernelSeries, y: KernelSeries) -> float:
    """Return the U-centred criterion divided by those of the series with themselves.

    Its numerator is the unbiased criterion of Song et al. 2012 (J. Mach. Learn. Res. 13, 1393).
    """
    covariance = [_unbiased(a, b) for a, b in ((x, y), (x, x), (y, y))]
    return covariance[0] / float(np.sqrt(covariance[1] * covariance[2]))


def _unbiased(x: KernelSeries, y: KernelSeries) -> float:
    a, b = x.features, y.features
    n = a.shape[1]
    # Without the diagonals, which are 1.
    rows_a, rows_b = a.sum(axis=1) @ a - 1.0, b.sum(axis=1) @ b - 1.0
    products = float(np.sum((a @ b.T) ** 2)) - n
    inner = products - 2.0 * float(rows_a @ rows_b) / (n - 2)
    inner += float(rows_a.sum() * rows_b.sum()) / ((n - 1) * (n - 2))
    return inner / (n * (n - 3))


def _principal(features: Array) -> Array:
    """Rotate features so that they are orthogonal, in descending order of their norms."""
    values, vectors = np.linalg.eigh(features @ features.T)
    return vectors[:, np.argsort(values)[::-1]].T @ features
