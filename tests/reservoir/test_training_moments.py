from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from openprc.errors import TaskError
from openprc.reservoir.training.moments import Moments, merge_all, moments_of, row_moments
from openprc.reservoir.training.row_blocks import RowBlocks, rows_per_block
from openprc.reservoir.training.standardizer import Standardizer


def moments(states, target):
    return row_moments(RowBlocks.all_of(states), target.reshape(len(states), -1))


def exactly(states, target):
    """Return mean and scatter in rational arithmetic, rounded at the end."""
    rows = [[Fraction(float(v)) for v in row] for row in np.column_stack([states, target])]
    n, width = len(rows), len(rows[0])
    mean = [sum(row[j] for row in rows) / n for j in range(width)]
    scatter = np.array(
        [
            [float(sum((r[i] - mean[i]) * (r[j] - mean[j]) for r in rows)) for j in range(width)]
            for i in range(width)
        ]
    )
    return np.array([float(m) for m in mean]), scatter


def test_by_hand():
    """Rows (0, 1), (2, 3), (4, 8): means 2 and 4, squares 8, 26, product 14."""
    found = moments(np.array([[0.0], [2.0], [4.0]]), np.array([1.0, 3.0, 8.0]))
    assert (found.n, found.n_states) == (3, 1)
    np.testing.assert_allclose(found.mean, [2.0, 4.0], rtol=1e-15)
    np.testing.assert_allclose(found.scatter, [[8.0, 14.0], [14.0, 26.0]], rtol=1e-15)
    np.testing.assert_allclose(found.std_x, [np.sqrt(8.0 / 3.0)], rtol=1e-15)


@pytest.mark.parametrize("offset", [0.0, 1e6, 1e8])
@pytest.mark.parametrize("drift", [0.0, 50.0])
def test_offsets_and_drifts_cost_no_digits(offset, drift):
    """The scatter of the very numbers that are stored, to rounding errors of the scatter."""
    rng = np.random.default_rng(0)
    z = rng.normal(size=(600, 3)) + drift * np.linspace(0.0, 1.0, 600)[:, None]
    x, y = z + offset, z.sum(axis=1)
    mean, scatter = exactly(x, y)
    for found in (moments(x, y), moments_of([(x[k : k + 7], y[k : k + 7])
                                              for k in range(0, 600, 7)])):  # fmt: skip
        size = np.sqrt(np.outer(np.diagonal(scatter), np.diagonal(scatter)))
        assert (np.abs(found.scatter - scatter) / size).max() < 1e-14
        np.testing.assert_allclose(found.mean, mean, rtol=1e-15, atol=1e-14)


def test_an_unlucky_origin_costs_as_many_rounding_errors_as_there_are_blocks():
    """A start far away from the rest: the origin lies in the data all the same."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(500, 2))
    x[:100] += 1e7
    mean, scatter = exactly(x, np.zeros(500))
    found = moments_of([(x[k : k + 100], np.zeros(100)) for k in range(0, 500, 100)])
    np.testing.assert_allclose(found.gxx, scatter[:2, :2], rtol=1e-13)
    np.testing.assert_allclose(found.mean_x, mean[:2], rtol=1e-14)


@given(
    cuts=st.lists(st.integers(0, 90), max_size=5),
    seed=st.integers(0, 2**32 - 1),
    offset=st.sampled_from([0.0, 1e3, -1e6]),
)
def test_moments_do_not_depend_on_how_rows_are_divided(cuts, seed, offset):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(90, 4)) + offset, rng.normal(size=(90, 2))
    whole = moments(x, y)
    edges = sorted({0, 90, *cuts})
    parts = [moments(x[a:b], y[a:b]) for a, b in pairwise(edges)]
    for found in (merge_all(parts), merge_all(parts[::-1])):
        assert found.n == 90
        np.testing.assert_allclose(found.scatter, whole.scatter, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.mean, whole.mean, rtol=1e-14, atol=1e-14)


def test_nothing_to_merge():
    assert merge_all([]) is None


def test_rows_that_are_left_out_are_not_read():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2000, 5)), rng.normal(size=(2000, 1))
    chosen = np.sort(rng.choice(2000, 1500, replace=False))
    spoiled = np.full_like(x, np.nan)
    spoiled[chosen] = x[chosen]
    blocks = RowBlocks(spoiled, chosen)
    assert not blocks.consecutive
    np.testing.assert_allclose(
        row_moments(blocks, y[chosen]).scatter, moments(x[chosen], y[chosen]).scatter, rtol=1e-12,
        atol=1e-11,
    )  # fmt: skip
    learned, standardised = Standardizer.fit_transform(blocks)
    np.testing.assert_allclose(learned.mean, x[chosen].mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(learned.scale, x[chosen].std(axis=0), rtol=1e-13)
    np.testing.assert_allclose(standardised.std(axis=0), np.ones(5), rtol=1e-13)


def test_consecutive_rows_are_views():
    x = np.zeros((5000, 3))
    blocks = RowBlocks(x, np.arange(100, 4900))
    assert blocks.consecutive
    for place, block in blocks:
        assert block.base is x
        assert len(block) == place.stop - place.start <= rows_per_block(3)
    assert sum(len(block) for _, block in blocks) == len(blocks) == 4800


def test_standardising_and_an_affine_map_in_one_go():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(3000, 4)) * [1.0, 1e-3, 1e3, 1.0] + 1e5
    learned, standardised = Standardizer.fit_transform(RowBlocks.all_of(x))
    weights, bias = rng.normal(size=(4, 2)), np.array([1.0, -2.0])
    np.testing.assert_allclose(
        learned.apply_affine(RowBlocks.all_of(x), weights, bias),
        standardised @ weights + bias,
        atol=1e-12,
    )


def test_two_kinds_of_columns_do_not_merge():
    a, b = (Moments(1, np.zeros(3), np.zeros(3), np.eye(3), n_states) for n_states in (2, 1))
    with pytest.raises(TaskError, match="moments of 2 states and 1 targets meet those of 1 and 2"):
        a.merge(b)


def test_no_rows_and_no_numbers():
    with pytest.raises(TaskError, match="there are no rows"):
        moments_of([(np.zeros((0, 2)), np.zeros(0))])
    x = np.zeros((10, 2))
    x[3, 1] = np.inf
    with pytest.raises(TaskError, match="state 1 has values that are NaN or infinite"):
        moments(x, np.zeros(10))
    with pytest.raises(TaskError, match="output 0 has values"):
        moments(np.zeros((10, 2)), np.full(10, np.nan))
