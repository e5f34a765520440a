"""What a capacity has to exceed before it counts: the distribution of chance."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

Correction = Literal["bonferroni", "benjamini-hochberg", "none"]


def chance_mean(rank: int, n_rows: int) -> float:
    """Return the mean capacity of a target that has nothing to do with the states.

    ``r / (T - 1)``, exactly, for r independent states over T rows.
    """
    return rank / (n_rows - 1)


def chance_quantile(probability: float, *, rank: int, n_rows: int) -> float:
    """Return the capacity that chance exceeds with the given probability.

    The part of a white Gaussian vector within a fixed subspace of dimension r of the T - 1
    dimensions that centring leaves is ``Beta(r/2, (T-1-r)/2)``; white targets that are not
    Gaussian follow it closely. The states may be autocorrelated.
    """
    from scipy.special import betainccinv

    return float(betainccinv(rank / 2, (n_rows - 1 - rank) / 2, probability))


def chance_p_values(
    capacities: NDArray[np.float64], *, rank: int, n_rows: int
) -> NDArray[np.float64]:
    """Return the probability that chance reaches each capacity, (K,)."""
    from scipy.special import betaincc

    return betaincc(rank / 2, (n_rows - 1 - rank) / 2, np.clip(capacities, 0.0, 1.0))


def beta_threshold(
    capacities: NDArray[np.float64],
    *,
    rank: int,
    n_rows: int,
    alpha: float,
    correction: Correction = "bonferroni",
) -> float:
    """Return the threshold for K in-sample capacities.

    ``bonferroni``: with probability of at least 1 - alpha no capacity of chance counts.
    ``benjamini-hochberg``: of those that count, a fraction alpha is chance on average
    (doi:10.1111/j.2517-6161.1995.tb02031.x). ``none``: each target at level alpha.

    Raises
    ------
    TaskError
        When alpha or the correction is out of range.
    """
    check_alpha(alpha)
    n_terms = len(capacities)
    if correction == "none":
        return chance_quantile(alpha, rank=rank, n_rows=n_rows)
    strict = chance_quantile(alpha / n_terms, rank=rank, n_rows=n_rows)
    if correction == "bonferroni":
        return strict
    if correction == "benjamini-hochberg":
        p = np.sort(chance_p_values(capacities, rank=rank, n_rows=n_rows))
        accepted = np.flatnonzero(p <= alpha * np.arange(1, n_terms + 1) / n_terms)
        if not accepted.size:
            return strict
        level = alpha * (accepted[-1] + 1) / n_terms
        return chance_quantile(level, rank=rank, n_rows=n_rows)
    raise TaskError(
        f"the correction is {correction!r}",
        expected="bonferroni, benjamini-hochberg or none",
        fix="choose one of these",
        key="correction",
    )


def check_alpha(alpha: float) -> None:
    """Refuse a level that is no probability."""
    if not 0.0 < alpha < 1.0:
        raise TaskError(
            f"alpha is {alpha!r}",
            expected="a probability between 0 and 1, such as 0.01",
            fix="correct it",
            key="alpha",
        )


def corrected_sum(capacities: NDArray[np.float64], *, rank: int, n_rows: int) -> float:
    """Return the sum of in-sample capacities without what chance adds on average.

    ``sum (C - b) / (1 - b)`` with ``b = r / (T - 1)``: without bias whether a target is held
    in the states or not, and noisy by about ``sqrt(2 K r) / T``.
    """
    bias = chance_mean(rank, n_rows)
    return float(((capacities - bias) / (1.0 - bias)).sum())
