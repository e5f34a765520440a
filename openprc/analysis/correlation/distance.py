"""Distance correlation in O(T log T) time and O(T) memory.

Szekely, Rizzo & Bakirov 2007, https://doi.org/10.1214/009053607000000505; the unbiased form:
Szekely & Rizzo 2014, https://doi.org/10.1214/14-AOS1255. Both need only sums over pairs of
distances, of their products, and of their row sums.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Sums over pairs of products of distances, over rows of products of row sums, and the product
#: of the totals.
Sums = tuple[float, float, float]

#: A U-centred distance variance below this fraction of the biased one is rounding errors.
LEAST_VARIANCE = 1e-10


@dataclass(frozen=True)
class DistanceSeries:
    """One series, prepared once for any number of others.

    Attributes
    ----------
    order : (T,) int64
        Rows by ascending value.
    values : (T,) float64
        In that order, centred and with unit variance.
    row_sums : (T,) float64
        Sums of distances to all others, in that order.
    """

    order: NDArray[np.intp]
    values: Array
    row_sums: Array

    @classmethod
    def of(cls, series: Array) -> DistanceSeries:
        """Sort a series (T,) that is not constant."""
        order = np.argsort(series, kind="stable")
        # Distance correlation has no scale; products of tiny or huge numbers would leave float64.
        values = standardized(series)[order]
        before = np.concatenate([[0.0], np.cumsum(values)[:-1]])
        n = len(values)
        row_sums = (2.0 * np.arange(n) - n) * values - 2.0 * before + values.sum()
        return cls(order, values, row_sums)

    @cached_property
    def total(self) -> float:
        """Sum over pairs of distances."""
        return float(self.row_sums.sum())

    @cached_property
    def own(self) -> Sums:
        """Sums of the series with itself."""
        return _squared_distances(self.values), float(self.row_sums @ self.row_sums), self.total**2


@dataclass(frozen=True)
class DistanceCorrelation:
    """Both estimates of one pair of series.

    Attributes
    ----------
    biased : float
        ``dCor``, from 0 to 1, at least of order T^(-1/4) also without dependence.
    unbiased : float
        ``dCor^2`` with U-centred distances: 0 on average without dependence, may be negative.
    """

    biased: float
    unbiased: float


def standardized(series: Array) -> Array:
    """Return a series with zero mean and unit variance."""
    centred = series - series.mean()
    centred /= np.abs(centred).max()  # or squares might leave float64
    return np.asarray(centred / centred.std())


def distance_correlation(x: DistanceSeries, y: Array) -> DistanceCorrelation:
    """Return the distance correlation of a prepared series with another (T,).

    The biased one is ``sqrt(dCov^2(x, y) / sqrt(dCov^2(x, x) dCov^2(y, y)))``.
    """
    both, own = _sums(x, standardized(y))
    n = len(y)
    scale = np.sqrt(_biased(n, x.own) * _biased(n, own))
    variances = _unbiased(n, x.own), _unbiased(n, own)
    # A single row that differs from all others has no U-centred distances left.
    least = LEAST_VARIANCE * scale
    unbiased = np.nan
    if min(variances) > least:
        unbiased = _unbiased(n, both) / np.sqrt(variances[0] * variances[1])
    biased = np.sqrt(np.clip(_biased(n, both) / scale, 0.0, 1.0))
    return DistanceCorrelation(float(biased), float(unbiased))


def reordered(x: DistanceSeries, y: Array, orders: Iterable[NDArray[np.int64]]) -> Array:
    """Return the biased dCor of `x` with `y` in other orders of its rows, one an order."""
    other, n = standardized(y), len(y)
    squares = []
    for order in orders:
        both, own = _sums(x, other[order])
        squares.append(_biased(n, both) / np.sqrt(_biased(n, x.own) * _biased(n, own)))
    return np.sqrt(np.clip(squares, 0.0, 1.0))


def chi2_p_value(unbiased: float, n: int) -> float:
    """Return the p-value of an unbiased squared correlation of distances or kernels.

    ``T R + 1`` is compared with chi-squared of one degree of freedom (Shen, Panda & Vogelstein
    2022, https://doi.org/10.1080/10618600.2021.1938585). It holds for independent rows only.
    """
    from scipy import special

    return float(special.chdtrc(1.0, max(n * unbiased + 1.0, 0.0)))


def _sums(x: DistanceSeries, other: Array) -> tuple[Sums, Sums]:
    """Return the sums of `x` with a standardised series, and of that series with itself."""
    from openprc.analysis.correlation.kernels import distance_products  # noqa: PLC0415 - numba, heavy

    products, rows, total, squares = distance_products(x.values, x.row_sums, other[x.order])
    own = (_squared_distances(other), float(squares), float(total) ** 2)
    return (float(products), float(rows), x.total * float(total)), own


def _squared_distances(values: Array) -> float:
    return float(2.0 * (len(values) * (values @ values) - values.sum() ** 2))


def _biased(n: int, sums: Sums) -> float:
    """Return dCov^2."""
    products, rows, totals = sums
    return products / n**2 - 2.0 * rows / n**3 + totals / n**4


def _unbiased(n: int, sums: Sums) -> float:
    """Return dCov^2 with U-centred distances."""
    products, rows, totals = sums
    inner = products - 2.0 * rows / (n - 2) + totals / ((n - 1) * (n - 2))
    return inner / (n * (n - 3))
