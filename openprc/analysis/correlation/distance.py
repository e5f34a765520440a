"""Distance correlation in O(T log T) time and O(T) memory.

Szekely, Rizzo & Bakirov 2007, https://doi.org/10.1214/009053607000000505; the unbiased form:
Szekely & Rizzo 2014, https://doi.org/10.1214/14-AOS1255. Both need only sums over pairs of
distances, of their products, and of their row sums.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

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
        order = np.argsort(series)  # in whatever order ties come, they are at no distance
        # Distance correlation has no scale; products of tiny or huge numbers would leave float64.
        values = standardized(series)[order]
        n = len(values)
        # Running sums of many terms, in more digits than float64 where the machine has them.
        sums = np.cumsum(values, dtype=np.longdouble)
        row_sums = (2.0 * np.arange(n) - n) * values - 2.0 * (sums - values) + sums[-1]
        row_sums = row_sums.astype(np.float64)
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
class DistanceCorrelations:
    """Both estimates of a series with several others.

    Attributes
    ----------
    biased : (N,) float64
        ``dCor``, from 0 to 1, at least of order T^(-1/4) also without dependence.
    unbiased : (N,) float64
        ``dCor^2`` with U-centred distances: 0 on average without dependence, may be negative.
        NaN for a series of which a single row differs from the others.
    """

    biased: Array
    unbiased: Array


def standardized(series: Array) -> Array:
    """Return a series with zero mean and unit variance."""
    centred = series - series.mean()
    centred /= np.abs(centred).max()  # or squares might leave float64
    return np.asarray(centred / centred.std())


def distance_correlations(x: DistanceSeries, rows: Array) -> DistanceCorrelations:
    """Return the distance correlations of a prepared series with each of the rows (N, T).

    Rows are centred and not constant. The biased one is
    ``sqrt(dCov^2(x, y) / sqrt(dCov^2(x, x) dCov^2(y, y)))``.
    """
    from openprc.analysis.correlation import kernels  # noqa: PLC0415 - numba, heavy

    n = rows.shape[1]
    found = kernels.channel_products(x.order, x.values, x.row_sums, rows, kernels.workspace(n))
    products, row_products, total, own_rows, squares = found.T
    both, own = (products, row_products, x.total * total), (squares, own_rows, total**2)
    biased = _biased(n, both), _biased(n, own), _biased(n, x.own)
    unbiased = _unbiased(n, both), _unbiased(n, own), _unbiased(n, x.own)
    # A single row that differs from all others has no U-centred distances left.
    usable = np.minimum(unbiased[1] / biased[1], unbiased[2] / biased[2]) > LEAST_VARIANCE
    squared = np.full(len(rows), np.nan)
    squared[usable] = unbiased[0][usable] / np.sqrt(unbiased[1][usable] * unbiased[2])
    ratio = biased[0] / np.sqrt(biased[1] * biased[2])
    return DistanceCorrelations(np.sqrt(np.clip(ratio, 0.0, 1.0)), squared)


def reordered(x: DistanceSeries, y: Array, orders: Iterable[NDArray[np.int64]]) -> Array:
    """Return the biased dCor of `x` with `y` in other orders of its rows, one an order."""
    from openprc.analysis.correlation import kernels  # noqa: PLC0415 - numba, heavy

    n = len(y)
    work = kernels.workspace(n)
    other = standardized(y)
    squares = []
    scale = None
    for order in orders:
        products, rows, total, own_rows = kernels.distance_products(
            x.values, x.row_sums, other[order[x.order]], work
        )
        if scale is None:
            # No order changes the distances within a series.
            own = _squared_distances(other), own_rows, total**2
            scale = np.sqrt(_biased(n, x.own) * _biased(n, own))
        squares.append(_biased(n, (products, rows, x.total * total)) / scale)
    return np.sqrt(np.clip(squares, 0.0, 1.0))


def chi2_p_value(unbiased: float, n: int) -> float:
    """Return the p-value of an unbiased squared correlation of distances or kernels.

    ``T R + 1`` is compared with chi-squared of one degree of freedom (Shen, Panda & Vogelstein
    2022, https://doi.org/10.1080/10618600.2021.1938585). It holds for independent rows only.
    """
    from scipy import special

    return float(special.chdtrc(1.0, max(n * unbiased + 1.0, 0.0)))


def _squared_distances(values: Array) -> float:
    return float(2.0 * (len(values) * (values @ values) - values.sum() ** 2))


def _biased(n: int, sums: tuple[Any, Any, Any]) -> Any:
    """Return dCov^2, of one pair of series or of several."""
    products, rows, totals = sums
    return products / n**2 - 2.0 * rows / n**3 + totals / n**4


def _unbiased(n: int, sums: tuple[Any, Any, Any]) -> Any:
    """Return dCov^2 with U-centred distances."""
    products, rows, totals = sums
    inner = products - 2.0 * rows / (n - 2) + totals / ((n - 1) * (n - 2))
    return inner / (n * (n - 3))
