"""Which targets a budget holds, and in which rows they come."""

from itertools import product
from math import comb

import numpy as np
import pytest

from openprc.analysis.capacity import Terms, polynomial_rows
from openprc.analysis.capacity.targets import RowSpan, TargetRows, chunks
from openprc.errors import TaskError


def test_a_budget_holds_every_product_once():
    terms = Terms.within({1: 4, 2: 3, 3: 2})
    assert len(terms) == 5 + comb(4 + 1, 2) + comb(3 + 2, 3)
    found = {tuple(sorted(terms.factors(k))) for k in range(len(terms))}
    assert len(found) == len(terms)
    by_hand = set()
    for most, total in ((4, 1), (3, 2), (2, 3)):
        for powers in product(range(total + 1), repeat=most + 1):
            if sum(powers) == total:
                by_hand.add(tuple(sorted((p, lag, 0) for lag, p in enumerate(powers) if p)))
    assert found == by_hand
    assert terms.total_degree.tolist() == sorted(terms.total_degree.tolist())


def test_the_size_of_the_papers_budget():
    assert len(Terms.within({1: 30, 2: 30})) == 527
    assert len(Terms.within({1: 10, 2: 10}, n_inputs=2)) == 22 + comb(23, 2)


def test_delays_and_labels():
    terms = Terms.within({2: 2}, delay_step=3, first_delay=1)
    assert terms.labels() == ["P2(u(t-3))", "P1(u(t-3)) P1(u(t-6))", "P2(u(t-6))"]
    assert terms.max_delay.tolist() == [3, 6, 6]
    chosen = Terms.of([[(1, 0)], [(2, 5), (1, 0, 1)]], n_inputs=2)
    assert chosen.labels() == ["P1(u0(t))", "P2(u0(t-5)) P1(u1(t))"]
    assert chosen.total_degree.tolist() == [1, 3]
    assert chosen.max_delay.tolist() == [0, 5]
    assert chosen.take(np.array([1])).labels() == ["P2(u0(t-5)) P1(u1(t))"]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_rows_of_targets_are_products_of_polynomials(dtype):
    u = np.random.default_rng(1).uniform(-1, 1, (200, 2))
    terms = Terms.within({1: 6, 2: 6, 3: 3}, n_inputs=2)
    tables = [polynomial_rows(column, max_degree=3) for column in u.T]
    usable = np.random.default_rng(2).uniform(size=150) > 0.2
    span = RowSpan(20, 170, usable)
    targets = TargetRows(terms, tables, dtype=dtype)
    whole = targets.whole(span)
    assert whole.shape == (len(terms), usable.sum())
    assert whole.dtype == dtype
    rows = 20 + np.flatnonzero(usable)
    for k in range(0, len(terms), 7):
        by_hand = np.prod([tables[c][d - 1, rows - lag] for d, lag, c in terms.factors(k)], axis=0)
        np.testing.assert_allclose(whole[k], by_hand, rtol=1e-5 if dtype == np.float32 else 1e-14)
    # In chunks and blocks the same numbers come out, with zeros where rows do not count.
    for block in span.blocks(64):
        for chunk in chunks(len(terms), 32):
            part = targets.fill(chunk, block, np.empty((32, 64), dtype=dtype))
            where = slice(block.start - 20, block.stop - 20)
            inside = np.zeros((len(chunk), usable[where].size))
            columns = np.flatnonzero(usable[where])
            first = usable[: where.start].sum()
            inside[:, columns] = whole[chunk.start : chunk.stop, first : first + len(columns)]
            np.testing.assert_array_equal(part, inside)


def test_spans_of_rows():
    assert RowSpan.of(np.arange(5, 9)) == RowSpan(5, 9)
    span = RowSpan.of(np.array([2, 3, 6]))
    assert (span.start, span.stop, span.n_usable) == (2, 7, 3)
    assert span.usable.tolist() == [True, True, False, False, True]
    assert [(b.start, b.stop, b.n_usable) for b in span.blocks(3)] == [(2, 5, 2), (5, 7, 1)]


@pytest.mark.parametrize(
    ("delays", "how", "words"),
    [
        ({}, {}, "the budget is {}"),
        ({0: 3}, {}, "the budget is {0: 3}"),
        ({1: 3}, {"delay_step": 0}, "delay_step is 0"),
        ({1: 3}, {"first_delay": -1}, "first_delay is -1"),
        ({1: 3, 2: 0}, {"first_delay": 1}, "the largest delay of degree 2 is 0"),
        ({5: 300}, {}, "has 21281794436 targets\n.*at most 5000000"),
    ],
)
def test_wrong_budgets(delays, how, words):
    with pytest.raises(TaskError, match=words):
        Terms.within(delays, **how)


@pytest.mark.parametrize(
    ("products", "words"),
    [
        ([], "there is no target"),
        ([[]], "target 0 is "),
        ([[(0, 3)]], r"target 0 is \[\(0, 3\)\]\n.*degree >= 1, delay >= 0"),
        ([[(1, -1)]], "target 0 is "),
        ([[(1, 0, 1)]], "an input below 1"),
        ([[(1, 0), (2, 0)]], "each delayed input once"),
        ([[(1, 0), (1, 2)], [(1, 2), (1, 0)]], "target 1 appears twice"),
    ],
)
def test_wrong_targets(products, words):
    with pytest.raises(TaskError, match=words):
        Terms.of(products)
