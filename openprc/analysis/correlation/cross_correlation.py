"""Correlation of an input with later and earlier rows of each channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def pearson(u: Array, rows: Array) -> Array:
    """Return Pearson's r of u (T,) with each of the rows (N, T), all centred."""
    scale = np.sqrt((u @ u) * np.einsum("nt,nt->n", rows, rows))
    return np.clip(rows @ u / scale, -1.0, 1.0)


def cross_correlation(u: Array, rows: Array, *, max_lag: int) -> Array:
    """Return the cross-correlation of each channel at lags -max_lag to max_lag, (N, 2L + 1).

    ``CCF_i(lag) = sum_t u(t) x_i(t + lag) / sqrt(sum u^2 sum x_i^2)``: a channel that follows
    the input 7 rows later peaks at lag +7. The sum has T - \\|lag\\| terms and the norms have T,
    so that distant lags are damped.

    Parameters
    ----------
    u, rows : (T,) and (N, T) float64
        Centred, none of them constant.
    """
    from scipy import fft

    n = len(u)
    size = fft.next_fast_len(n + max_lag, real=True)
    reversed_u = np.conj(fft.rfft(u, size))
    found = np.empty((len(rows), 2 * max_lag + 1))
    for k, row in enumerate(rows):
        circular = fft.irfft(reversed_u * fft.rfft(row, size), size)
        found[k, max_lag:] = circular[: max_lag + 1]
        found[k, :max_lag] = circular[size - max_lag :]
    scale = np.sqrt((u @ u) * np.einsum("nt,nt->n", rows, rows))
    return found / scale[:, None]


def correlation_at(u: Array, row: Array, *, lag: int) -> float:
    """Return Pearson's r of u(t) with x(t + lag), over the rows that both have."""
    n = len(u)
    early, late = u[max(0, -lag) : n - max(0, lag)], row[max(0, lag) : n - max(0, -lag)]
    early, late = early - early.mean(), late - late.mean()
    scale = np.sqrt((early @ early) * (late @ late))
    # One of them may rest where they overlap.
    return float(np.clip(early @ late / scale, -1.0, 1.0)) if scale > 0 else float("nan")
