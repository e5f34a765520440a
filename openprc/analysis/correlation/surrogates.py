"""Recordings as they might have been without the dependence that is tested for.

Reordering samples freely makes them independent in time as well, and then a test takes the
slowness of a body for a dependence. Shifting a series around its own end keeps all of its
memory and only breaks the tie with the other one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.analysis.correlation.effective_size import autocorrelation, decorrelation_rows
from openprc.errors import TaskError

Null = Literal["shift", "block", "permutation", "chi2"]
Array = NDArray[np.float64]

#: Differences below this fraction of the statistic are rounding errors, and count as ties.
TIE = 1e-12
#: Shifts begin after so many decorrelation times.
CLEARANCE = 3


def check_null(null: str) -> None:
    """Raise `TaskError` when there is no such null distribution."""
    if null not in get_args(Null):
        raise TaskError(
            f"null is {null!r}",
            expected=" or ".join(get_args(Null)),
            fix='leave "shift" unless the rows are independent of each other',
            key="null",
        )


@dataclass(frozen=True)
class Shifts:
    """The circular shifts that are surrogates of one pair of series.

    Attributes
    ----------
    n_rows : int
    least : int
        Smallest shift: some decorrelation times, at most a quarter of the length. Smaller ones
        would be as valid, but keep part of a dependence that there is, and so hide it.
    alike : float
        Number of neighbouring shifts that amount to a single independent one.
    """

    n_rows: int
    least: int
    alike: float

    def far(self, *, beyond: int = 0) -> slice:
        """Return the shifts at least `beyond` further away; a quarter of all in any case."""
        least = min(self.least + beyond, 3 * self.n_rows // 8)
        return slice(least, self.n_rows - least + 1)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Return `count` different shifts, or all there are."""
        every = np.arange(self.least, self.n_rows - self.least + 1)
        if len(every) <= count:
            return every
        return np.sort(rng.choice(every, size=count, replace=False))

    def p_value(self, observed: float, surrogate: Array) -> float:
        """Return the p-value of shift 0 among those of other shifts.

        (w + #{s >= s_0}) / (w + S): that of Phipson & Smyth 2010
        (https://doi.org/10.2202/1544-6115.1585) with the observed value in the company of the
        shifts next to it, which are alike and have been left out of the S others. So a slow pair
        of series cannot have a p-value below w/T, whatever the number of shifts.
        """
        own = max(1.0, self.alike * len(surrogate) / (self.n_rows - 2 * self.least + 1))
        return p_value(observed, surrogate, own=own)


def shifts_of(x: Array, rows: Array) -> list[Shifts]:
    """Return the shifts for a series (T,) with each of the rows (N, T), all centred."""
    n = len(x)
    last = n // 4
    both = np.concatenate([x[None], rows])
    times = decorrelation_rows(both)
    squares = autocorrelation(both, max_lag=last) ** 2
    # Squared correlations at two shifts, k apart, correlate by about this product of squares;
    # lags to both sides, and 0 once.
    alike = 2.0 * squares[1:] @ squares[0] - 1.0
    least = np.minimum(CLEARANCE * np.maximum(times[0], times[1:]), last)
    return [Shifts(n, int(m), float(w)) for m, w in zip(least, alike, strict=True)]


def row_orders(
    null: Null, shifts: Shifts, *, count: int, rng: np.random.Generator
) -> Iterator[NDArray[np.int64]]:
    """Yield new orders of the rows.

    Parameters
    ----------
    null : {"shift", "block", "permutation"}
        Circular shifts; blocks, as long as the least shift, in random order from a random start;
        single rows in random order, which is valid only for rows independent of each other.
    """
    n_rows = shifts.n_rows
    rows = np.arange(n_rows)
    if null == "shift":
        for shift in shifts.draw(count, rng):
            yield np.roll(rows, -shift)
        return
    for _ in range(count):
        if null == "permutation":
            yield rng.permutation(n_rows)
            continue
        turned = np.roll(rows, int(rng.integers(n_rows)))
        blocks = np.array_split(turned, n_rows // shifts.least)
        yield np.concatenate([blocks[k] for k in rng.permutation(len(blocks))])


def p_value(observed: float, surrogate: Array, *, own: float = 1.0) -> float:
    """Return the share of values as large as the observed one, which counts as `own` values."""
    reached = surrogate >= observed - TIE * abs(observed)
    return float((own + np.count_nonzero(reached)) / (own + len(surrogate)))
