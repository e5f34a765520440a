"""Rank correlations, and how they change when one series is reordered."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def centred_ranks(series: Array) -> Array:
    """Return mean ranks less their mean, so that Pearson's r of them is Spearman's."""
    from scipy import stats

    ranks = stats.rankdata(series)
    return np.asarray(ranks - ranks.mean())


@dataclass(frozen=True)
class OrderedRanks:
    """One series, prepared once for Kendall's tau with any number of others.

    Attributes
    ----------
    order : (T,) int64
        Rows by ascending value.
    groups : (G + 1,) int64
        Where groups of equal values start in that order, and T at the end.
    """

    order: NDArray[np.intp]
    groups: NDArray[np.int64]

    @classmethod
    def of(cls, series: Array) -> OrderedRanks:
        """Sort a series (T,)."""
        order = np.argsort(series)
        ordered = series[order]
        new = np.concatenate([[True], ordered[1:] != ordered[:-1], [True]])
        return cls(order, np.flatnonzero(new).astype(np.int64))

    @property
    def tied_pairs(self) -> int:
        """Number of pairs of equal values."""
        sizes = np.diff(self.groups)
        return int(np.sum(sizes * (sizes - 1) // 2))


def kendall_tau(x: OrderedRanks, y: Array, orders: Iterable[NDArray[np.int64] | slice]) -> Array:
    """Return Kendall's tau-b of `x` with `y` in each of the orders of its rows.

    ``tau_b = (C - D) / sqrt((P - P_x)(P - P_y))`` with the numbers of concordant, discordant,
    all and tied pairs (Kendall 1945, https://doi.org/10.1093/biomet/33.3.239).
    """
    from openprc.analysis.correlation.kernels import discordant_pairs  # noqa: PLC0415 - numba, heavy

    _, ranks, counts = np.unique(y, return_inverse=True, return_counts=True)
    ranks = ranks.astype(np.int64)
    pairs = len(y) * (len(y) - 1) // 2
    tied_x, tied_y = x.tied_pairs, int(np.sum(counts * (counts - 1) // 2))
    scale = np.sqrt(float(pairs - tied_x)) * np.sqrt(float(pairs - tied_y))
    found = []
    for order in orders:
        discordant, tied_both = discordant_pairs(x.groups, ranks[order][x.order])
        difference = pairs - tied_x - tied_y + tied_both - 2 * discordant
        found.append(difference / scale)
    return np.clip(np.array(found), -1.0, 1.0)


def circular_correlation(a: Array, b: Array) -> Array:
    """Return Pearson's r of a(t) with b(t + shift) for all T circular shifts, both centred."""
    from scipy import fft

    product = np.conj(fft.rfft(a)) * fft.rfft(b)
    return np.asarray(fft.irfft(product, len(a)) / np.sqrt((a @ a) * (b @ b)))
