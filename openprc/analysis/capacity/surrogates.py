"""Thresholds by example: the same states and targets with their common time broken."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.capacity.thresholds import check_alpha
from openprc.errors import TaskError

#: Maps an order of n samples (a permutation of range(n)) to the capacities (K,) when the
#: input, or the states, come in that order and the other side does not.
CapacitiesOf = Callable[[NDArray[np.intp]], NDArray[np.float64]]


def surrogate_thresholds(
    capacities_of: CapacitiesOf,
    *,
    n_samples: int,
    kind: str,
    degrees: NDArray[np.int64],
    guard: int,
    n_surrogates: int,
    alpha: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a threshold per target, (K,), and what each reaches by chance on average, (K,).

    A threshold is what chance reaches among targets of that degree.

    For every surrogate the largest capacity within each total degree is kept. Of these
    n + 1 values (the measured one included) a fraction alpha may lie above the threshold, so
    within a degree no capacity of chance counts with a probability of 1 - alpha.

    Parameters
    ----------
    capacities_of : callable
    n_samples : int
        Length of the orders.
    kind : {"circular", "shuffle"}
        ``circular`` turns the input against the states by a random number of rows and keeps
        the autocorrelation of both, which is what a drive that is not white needs; ``shuffle``
        puts one of them in random order, and tests against white noise
        (Kubota et al. 2021, doi:10.1103/PhysRevResearch.3.043135).
    degrees : (K,)
    guard : int [rows]
        Least shift in either direction, longer than the memory that could be found.
    rng : Generator

    Raises
    ------
    TaskError
        When there are too few surrogates for the level, or too few rows for the shifts.
    """
    check_alpha(alpha)
    allowed = int(np.floor(alpha * (n_surrogates + 1) + 1e-9))
    if allowed < 1:
        raise TaskError(
            f"{n_surrogates} surrogates cannot resolve a level of {alpha:g}",
            expected=f"at least {int(np.ceil(1 / alpha)) - 1}",
            fix="ask for more surrogates, or raise alpha",
            key="n_surrogates",
        )
    groups = [np.flatnonzero(degrees == degree) for degree in np.unique(degrees)]
    largest, total = np.empty((n_surrogates, len(groups))), np.zeros(len(degrees))
    orders = _orders(n_samples, kind, guard=guard, count=n_surrogates, rng=rng)
    for row, order in zip(largest, orders, strict=True):
        found = capacities_of(order)
        row[:] = [found[members].max() for members in groups]
        total += found
    ranked = -np.sort(-largest, axis=0)
    thresholds = np.empty(len(degrees))
    for column, members in enumerate(groups):
        thresholds[members] = ranked[allowed - 1, column]
    return thresholds, total / n_surrogates


def _orders(
    n: int, kind: str, *, guard: int, count: int, rng: np.random.Generator
) -> Iterator[NDArray[np.intp]]:
    if kind == "shuffle":
        for _ in range(count):
            yield rng.permutation(n)
        return
    if kind != "circular":
        raise TaskError(
            f"the surrogates are {kind!r}",
            expected="circular or shuffle",
            fix="choose one of these",
            key="null",
        )
    room = n - 2 * guard
    if room < count:
        raise TaskError(
            f"{n} rows leave {max(room, 0)} circular shifts of at least {guard} rows",
            expected=f"at least {count}",
            fix="record for longer, lower the largest delay, or ask for fewer surrogates",
            key="n_surrogates",
        )
    rows = np.arange(n)
    for shift in guard + rng.choice(room, size=count, replace=False):
        yield np.roll(rows, int(shift))
