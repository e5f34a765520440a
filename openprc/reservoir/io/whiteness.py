"""Whether a drive is as good as independent from sample to sample.

Capacities and delay tasks are defined for independent symbols. On a drive that remembers its own
past, a body without memory seems to have some.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

#: Probability of calling an independent drive dependent: at most this.
SIGNIFICANCE = 0.05
_MAX_LAG = 100
_FEWEST = 10
_WHAT = {
    "values": "autocorrelation {:.3g} at lag {}",
    "columns": "correlation {:.3g} between columns at lag {}",
    "squares": "no autocorrelation, but the values depend on the squares {1} samples earlier",
}


@dataclass(frozen=True)
class Whiteness:
    """How much a drive tells about its own future.

    Parameters
    ----------
    max_autocorrelation : float
        Correlation at the lag that is most unlikely for independent values; between two columns
        where that is the pair.
    lag : int
    p_value : float
        Bound on the probability that independent values look as dependent, over all lags.
    n_effective : float
        As many independent samples would tell the mean of the drive as well; all of them when
        it is white.
    white : bool
    n_samples : int
    max_lag : int
    kind : {"values", "columns", "squares"}
        What the most unlikely pair is: values of one column, values of two columns, or one of
        them squared.
    """

    max_autocorrelation: float
    lag: int
    p_value: float
    n_effective: float
    white: bool
    n_samples: int
    max_lag: int
    kind: str

    @property
    def sentence(self) -> str:
        """What to tell a reader."""
        if self.white:
            return (
                f"no dependence beyond chance among {self.n_samples} values, to lag {self.max_lag}"
            )
        what = _WHAT[self.kind].format(self.max_autocorrelation, self.lag)
        chance = "p < 1e-12" if self.p_value < 1e-12 else f"p {self.p_value:.1g}"
        count = f"; {self.n_samples} values count as about {self.n_effective:.0f}"
        return f"{what} ({chance}){count if self.n_effective < 0.9 * self.n_samples else ''}"


def drive_whiteness(u: ArrayLike, *, max_lag: int | None = None) -> Whiteness:
    """Test whether the rows of a drive are independent of each other.

    Values are replaced by their ranks, so that no tail is too heavy. Ranks and squared ranks
    are correlated with each other at every lag, and across columns also at lag 0. For
    independent values each such sum of n products is one of a martingale, so with z its size in
    standard deviations and M the largest product in units of the variance it is exceeded with a
    probability of at most ``2 exp(-z^2 / 2 / (1 + M z / (3 sqrt(n))))`` (Freedman 1975,
    doi:10.1214/aop/1176996452); this is multiplied by the number of sums.

    Parameters
    ----------
    u : (K,) or (K, C)
    max_lag : int, optional
        By default 100, or a quarter of K.

    Raises
    ------
    TaskError
        When there are fewer than 10 values, when one is not finite, when no column varies, or
        when `max_lag` is not between 1 and K - 2.
    """
    values, max_lag = _checked(u, max_lag)
    n, n_columns = values.shape
    scores = np.stack([_scores(column) for column in values.T], axis=1)
    squares = scores**2 - 1.0
    spread = squares.std(axis=0)
    many = spread > 1e-9  # of two values the squared ranks are one number
    series = np.concatenate([scores, squares[:, many] / spread[many]], axis=1)
    source = [*range(n_columns), *np.flatnonzero(many).tolist()]
    reach = np.abs(series).max(axis=0)
    n_series = series.shape[1]
    different = np.not_equal.outer(source, source)
    n_tests = max_lag * n_series**2 + int(np.count_nonzero(np.triu(different)))
    products = _lagged_products(series, max_lag) / n
    rest = n - np.arange(max_lag + 1)[:, None, None]
    # Ranks add up to nothing, which correlates them a little; this takes it out again.
    excess = products + rest / n * products[0] / (n - 1)
    excess[0] = np.where(np.triu(different), products[0], 0.0)
    z = np.abs(excess) * n / np.sqrt(rest)
    log_p = -0.5 * z**2 / (1.0 + np.outer(reach, reach) * z / (3.0 * np.sqrt(rest)))
    if not different.any():
        log_p[0] = np.inf
    lag, a, b = (int(k) for k in np.unravel_index(int(log_p.argmin()), log_p.shape))
    log_p_best = float(log_p[lag, a, b])
    p_value = float(min(1.0, 2.0 * n_tests * np.exp(max(log_p_best, -700.0))))
    white = p_value > SIGNIFICANCE
    effective = float(n) if white else min(effective_samples(column) for column in values.T)
    squared = a >= n_columns or b >= n_columns
    pair = values[: n - lag, source[a]], values[lag:, source[b]]
    return Whiteness(
        max_autocorrelation=_correlation(*pair),
        lag=lag,
        p_value=p_value,
        n_effective=effective,
        white=white,
        n_samples=n,
        max_lag=max_lag,
        kind="squares" if squared else "values" if source[a] == source[b] else "columns",
    )


def autocorrelation(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the autocorrelation of a signal (K,) at lags 0 to K - 1, (K,); biased, so it fades.

    Zeros beyond lag 0 for a signal that does not vary.
    """
    n = len(u)
    spectrum = np.fft.rfft(u - u.mean(), 2 * n)
    covariance = np.fft.irfft(spectrum.real**2 + spectrum.imag**2, 2 * n)[:n]
    if not covariance[0] > 0:
        return np.eye(1, n)[0]
    return np.asarray(covariance / covariance[0])


def effective_samples(u: NDArray[np.float64]) -> float:
    """Return how many independent samples tell the mean as well as a signal (K,) does.

    ``K / (1 + 2 sum rho)``, the sum of autocorrelations being taken over lags in pairs for as
    long as these are positive (Geyer 1992, doi:10.1214/ss/1177011137). For a signal held for h
    samples at a time it is K / h. At most K.
    """
    rho = autocorrelation(u)
    even = len(rho) // 2 * 2
    pairs = rho[:even].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    stop = int(negative[0]) if negative.size else len(pairs)
    time = max(1.0, 2.0 * float(pairs[:stop].sum()) - 1.0)
    return len(u) / time


def decorrelation_lag(u: NDArray[np.float64]) -> int | None:
    """Return the first lag at which the autocorrelation of a signal (K,) is not positive."""
    crossed = np.flatnonzero(autocorrelation(u) <= 0)
    return int(crossed[0]) if crossed.size else None


def _checked(u: ArrayLike, max_lag: int | None) -> tuple[NDArray[np.float64], int]:
    values = np.asarray(u, dtype=np.float64)
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or len(values) < _FEWEST:
        raise TaskError(
            f"the drive has shape {np.shape(u)}",
            expected=f"(K,) or (K, C), with {_FEWEST} values or more",
            fix="pass the symbols of the drive, one row each",
            key="u",
        )
    if not np.isfinite(values).all():
        raise TaskError(
            f"{int(np.count_nonzero(~np.isfinite(values)))} values are NaN or infinite",
            expected="finite numbers",
            fix="leave out what was not measured",
            key="u",
        )
    values = values[:, np.ptp(values, axis=0) > 0]
    if not values.shape[1]:
        raise TaskError(
            "the drive does not vary",
            expected="a drive",
            fix="name another input or column",
            key="u",
        )
    chosen = min(_MAX_LAG, len(values) // 4) if max_lag is None else max_lag
    if isinstance(chosen, bool) or not 1 <= chosen <= len(values) - 2:
        raise TaskError(
            f"max_lag is {max_lag}",
            expected=f"a whole number from 1 to {len(values) - 2}",
            fix="pass such a number, or leave it out",
            key="max_lag",
        )
    return values, int(chosen)


def _lagged_products(series: NDArray[np.float64], max_lag: int) -> NDArray[np.float64]:
    """Return ``sum_t series[t, a] series[t + lag, b]``, (max_lag + 1, S, S)."""
    size = 1 << int(np.ceil(np.log2(len(series) + max_lag)))
    spectra = np.fft.rfft(series.T, size)
    products = [np.fft.irfft(one.conj() * spectra, size)[:, : max_lag + 1] for one in spectra]
    return np.stack(products).transpose(2, 0, 1)


def _scores(column: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ranks, ties sharing their mean, brought to mean 0 and variance 1."""
    _, position, counts = np.unique(column, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - 0.5 * (counts + 1))[position]
    centred = ranks - ranks.mean()
    return np.asarray(centred / centred.std())


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0 else 0.0
