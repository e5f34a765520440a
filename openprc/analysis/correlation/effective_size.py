"""How many independent samples a recording is worth, and p-values that follow from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def autocorrelation(rows: Array, *, max_lag: int) -> Array:
    """Return autocorrelations at lags 0 to `max_lag`, biased estimator, (N, max_lag + 1).

    Parameters
    ----------
    rows : (N, T) float64
        Centred, none of them constant.
    """
    from scipy import fft

    n = rows.shape[1]
    size = fft.next_fast_len(n + max_lag, real=True)
    found = np.empty((len(rows), max_lag + 1))
    for k, row in enumerate(rows):
        # One at a time: all transforms together may not fit in the memory.
        power = np.abs(fft.rfft(row, size)) ** 2
        found[k] = fft.irfft(power, size)[: max_lag + 1]
    return found / found[:, :1]


def decorrelation_rows(rows: Array) -> NDArray[np.int64]:
    """Return after how many rows each autocorrelation stays below 1/e, (N,).

    It is looked for up to half the length, beyond which too few products are left.
    """
    n = rows.shape[1]
    above = np.abs(autocorrelation(rows, max_lag=n // 2)) >= np.exp(-1.0)
    return np.asarray(above.shape[1] - np.argmax(above[:, ::-1], axis=1), dtype=np.int64)


def pair_sizes(a: Array, b: Array) -> Array:
    """Return the effective number of samples of each correlation, (A, B), at most T.

    The variance of the correlation of two independent stationary processes is that of

        N_eff = T / (1 + 2 sum_k (1 - k/T) rho_a(k) rho_b(k))

    independent samples (Bartlett 1935, https://doi.org/10.2307/2980743 (Some aspects of the
    time-correlation problem); Pyper & Peterman 1998, https://doi.org/10.1139/f98-104). The
    sum runs to T/4: later autocorrelations are estimated from too few products.

    Parameters
    ----------
    a, b : (A, T) and (B, T) float64
        Centred, none of them constant.
    """
    n = a.shape[1]
    last = n // 4
    weights = 1.0 - np.arange(1, last + 1) / n
    rho_a = autocorrelation(a, max_lag=last)[:, 1:]
    rho_b = rho_a if b is a else autocorrelation(b, max_lag=last)[:, 1:]
    inflation = 1.0 + 2.0 * (rho_a * weights) @ rho_b.T
    # Alternating signs would promise more than T samples; estimates may do so by chance.
    return n / np.maximum(inflation, 1.0)


def correlation_p_values(r: Array, sizes: Array, *, conditioned: int = 0) -> Array:
    """Return two-sided p-values of correlations by Student's t with N_eff - 2 degrees of freedom.

    With two effective samples or fewer no correlation is significant, and p is 1.

    Parameters
    ----------
    r, sizes : float64
        Correlations and their effective numbers of samples; shapes that broadcast.
    conditioned : int
        Number of variables whose influence was removed, each of which costs a degree of freedom.
    """
    from scipy import special

    r, sizes = np.broadcast_arrays(r, sizes)
    freedom = sizes - 2.0 - conditioned
    usable = freedom > 0
    p = np.ones(r.shape)
    # The survival function of |t| is an incomplete beta function of 1 - r^2.
    rest = np.clip(1.0 - r[usable] ** 2, 0.0, 1.0)
    p[usable] = special.betainc(0.5 * freedom[usable], 0.5, rest)
    return np.where(np.isnan(r), np.nan, p)


def critical_correlation(sizes: Array, *, alpha: float = 0.05) -> Array:
    """Return the |r| whose p-value is `alpha`; 1 where no correlation is significant."""
    from scipy import special

    freedom = np.asarray(sizes, dtype=np.float64) - 2.0
    found = np.ones(freedom.shape)
    usable = freedom > 0
    rest = special.betaincinv(0.5 * freedom[usable], 0.5, alpha)
    found[usable] = np.sqrt(1.0 - rest)
    return found
