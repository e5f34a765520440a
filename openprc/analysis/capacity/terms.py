"""Which targets are asked for: products of polynomials of delayed inputs, as index tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError

#: Beyond this many targets the tables alone would fill the memory of a small machine.
MOST_TERMS = 5_000_000

#: One factor: (degree, delay) or (degree, delay, input).
Factor = Sequence[int]


@dataclass(frozen=True)
class Terms:
    """K targets, each a product of at most F factors ``p_degree(u_input(t - delay))``.

    Parameters
    ----------
    degrees : (K, F) int
        Degree of each factor; 0 where a target has fewer factors than F.
    delays : (K, F) int
        Delay of each factor [rows].
    inputs : (K, F) int
        Column of the input that each factor reads.
    """

    degrees: NDArray[np.int64]
    delays: NDArray[np.int64]
    inputs: NDArray[np.int64]

    @classmethod
    def within(
        cls,
        delays: Mapping[int, int],
        *,
        n_inputs: int = 1,
        delay_step: int = 1,
        first_delay: int = 0,
    ) -> Terms:
        """Enumerate every target within a budget.

        Parameters
        ----------
        delays : mapping
            Largest delay for each total degree, in steps of `delay_step`:
            ``{1: 100, 2: 30, 3: 10}``. Degrees that are not named are left out.
        n_inputs : int
            Columns of the input; products run across them.
        delay_step : int [rows]
        first_delay : int
            Smallest delay, in steps.

        Raises
        ------
        TaskError
            When a degree, delay or step is out of range, or there are too many targets.
        """
        _check_budget(delays, delay_step, first_delay)
        sizes = {
            degree: (most - first_delay + 1) * n_inputs for degree, most in sorted(delays.items())
        }
        total = sum(comb(size + degree - 1, degree) for degree, size in sizes.items())
        if total > MOST_TERMS:
            raise TaskError(
                f"the budget {dict(delays)} has {total} targets",
                expected=f"at most {MOST_TERMS}",
                fix="lower the largest delay of the high degrees",
                key="delays",
            )
        blocks = [
            _multisets(degree, size, n_inputs, delay_step, first_delay)
            for degree, size in sizes.items()
        ]
        return cls(*(np.concatenate(parts) for parts in zip(*_padded(blocks), strict=True)))

    @classmethod
    def of(cls, products: Sequence[Sequence[Factor]], *, n_inputs: int = 1) -> Terms:
        """Take targets one by one: ``[[(1, 3)], [(1, 0), (2, 5)]]`` is u(t-3) and p1 p2.

        A factor is ``(degree, delay)``, or ``(degree, delay, input)``.

        Raises
        ------
        TaskError
            When a target is empty, names one delayed input twice, appears twice, or is out of
            range.
        """
        width = max((len(product) for product in products), default=0)
        tables = np.zeros((3, len(products), width), dtype=np.int64)
        seen: set[frozenset[tuple[int, ...]]] = set()
        for k, product in enumerate(products):
            factors = [(*factor, 0) if len(factor) == 2 else tuple(factor) for factor in product]
            proper = bool(factors) and all(
                len(f) == 3 and f[0] >= 1 and f[1] >= 0 and 0 <= f[2] < n_inputs for f in factors
            )
            if not proper or len({f[1:] for f in factors}) < len(factors):
                raise _wrong_term(k, product, n_inputs)
            if frozenset(factors) in seen:
                raise TaskError(
                    f"target {k} appears twice: {list(product)!r}",
                    expected="different targets, since each adds to the sum",
                    fix="leave the copy out",
                    key="terms",
                )
            seen.add(frozenset(factors))
            tables[:, k, : len(factors)] = np.array(factors).T
        if not len(products):
            raise TaskError(
                "there is no target", expected="at least one", fix="name one", key="terms"
            )
        return cls(*tables)

    def __len__(self) -> int:
        return len(self.degrees)

    @cached_property
    def total_degree(self) -> NDArray[np.int64]:
        """Sum of the degrees of the factors, (K,)."""
        return self.degrees.sum(axis=1)

    @cached_property
    def max_delay(self) -> NDArray[np.int64]:
        """Largest delay among the factors, (K,) [rows]."""
        return np.where(self.degrees > 0, self.delays, 0).max(axis=1)

    def take(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> Terms:
        """Return some of the targets."""
        return Terms(self.degrees[index], self.delays[index], self.inputs[index])

    def factors(self, term: int) -> Iterator[tuple[int, int, int]]:
        """Yield (degree, delay, input) of each factor of one target."""
        for degree, delay, column in zip(
            self.degrees[term].tolist(),
            self.delays[term].tolist(),
            self.inputs[term].tolist(),
            strict=True,
        ):
            if degree:
                yield degree, delay, column

    def labels(self) -> list[str]:
        """Return one readable name per target, such as ``"P1(u(t)) P2(u(t-5))"``."""
        several = bool(self.inputs.any())
        names = []
        for term in range(len(self)):
            parts = []
            for degree, delay, column in self.factors(term):
                signal = f"u{column}" if several else "u"
                parts.append(f"P{degree}({signal}(t{-delay if delay else ''}))")
            names.append(" ".join(parts))
        return names


def _multisets(
    degree: int, size: int, n_inputs: int, delay_step: int, first_delay: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return degrees, delays and inputs (K, degree) of all products of one total degree.

    A product of total degree d is a multiset of d delayed inputs; equal members next to each
    other are merged into one factor of a higher degree.
    """
    n_products = comb(size + degree - 1, degree)
    members = np.fromiter(
        chain.from_iterable(combinations_with_replacement(range(size), degree)),
        dtype=np.int64,
        count=n_products * degree,
    ).reshape(n_products, degree)
    starts = np.ones_like(members, dtype=bool)
    starts[:, 1:] = members[:, 1:] != members[:, :-1]
    place = np.cumsum(starts, axis=1) - 1
    # The place of each member in the table of factors, counted through row by row.
    place += degree * np.arange(n_products)[:, None]
    degrees = np.bincount(place.ravel(), minlength=place.size).reshape(members.shape)
    variable = np.zeros_like(members)
    variable.ravel()[place] = members
    delays = (variable // n_inputs + first_delay) * delay_step
    return degrees, np.where(degrees > 0, delays, 0), variable % n_inputs * (degrees > 0)


def _padded(
    blocks: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]],
) -> Iterator[tuple[NDArray[np.int64], ...]]:
    """Yield the tables of all degrees at one width."""
    width = max(block[0].shape[1] for block in blocks)
    for block in blocks:
        missing = width - block[0].shape[1]
        if missing:
            room = np.zeros((len(block[0]), missing), dtype=np.int64)
            yield tuple(np.concatenate([table, room], axis=1) for table in block)
        else:
            yield block


def _check_budget(delays: Mapping[int, int], delay_step: int, first_delay: int) -> None:
    if not delays or any(degree < 1 for degree in delays):
        raise TaskError(
            f"the budget is {dict(delays)}",
            expected="a largest delay for each total degree from 1 on, such as {1: 100, 2: 30}",
            fix="correct it",
            key="delays",
        )
    if delay_step < 1 or first_delay < 0:
        raise TaskError(
            f"delay_step is {delay_step} and first_delay is {first_delay}",
            expected="a step of at least 1 row and a first delay of at least 0 steps",
            fix="correct them",
            key="delay_step",
        )
    short = {degree: most for degree, most in delays.items() if most < first_delay}
    if short:
        raise TaskError(
            f"the largest delay of degree {min(short)} is {short[min(short)]}",
            expected=f"at least the first delay, {first_delay}",
            fix="raise it, or leave the degree out",
            key="delays",
        )


def _wrong_term(k: int, product: Sequence[Factor], n_inputs: int) -> TaskError:
    return TaskError(
        f"target {k} is {list(product)!r}",
        expected="factors (degree, delay) or (degree, delay, input) with degree >= 1, delay >= 0, "
        f"an input below {n_inputs}, and each delayed input once",
        fix="correct it",
        key="terms",
    )
