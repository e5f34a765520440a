"""Blocks of lanes hold every element once, and never two lanes at one node."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from openprc.demlat.compiled.packing import ensemble_blocks, run_blocks, spread_blocks


def check(blocks, rest, indices, chosen, width):
    real = blocks.element[blocks.element >= 0]
    assert sorted([*real, *rest]) == sorted(chosen)
    lanes = blocks.element.reshape(-1, width)
    for row, first in zip(lanes, blocks.places, strict=True):
        for lane, element in enumerate(row):
            if element >= 0:
                np.testing.assert_array_equal(first + lane, indices[element])
        assert (row >= 0).sum() >= 0.4 * width


def grid_bars(n):
    number = np.arange(n * n).reshape(n, n)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    pairs += [(number[:-1, :-1], number[1:, 1:]), (number[:-1, 1:], number[1:, :-1])]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs]).astype("i4")


@pytest.mark.parametrize("n", [9, 10, 30])
def test_a_lattice_is_almost_all_runs(n):
    bars = grid_bars(n)
    blocks, rest = run_blocks(bars, np.arange(len(bars)), 8)
    check(blocks, rest, bars, np.arange(len(bars)), 8)
    assert len(rest) < 0.05 * len(bars)
    assert (blocks.element >= 0).mean() > 0.85


def test_the_order_of_elements_does_not_matter_for_the_blocks():
    bars = grid_bars(10)
    shuffled = np.random.default_rng(0).permutation(bars)
    one, _ = run_blocks(bars, np.arange(len(bars)), 8)
    two, _ = run_blocks(shuffled, np.arange(len(bars)), 8)
    np.testing.assert_array_equal(one.places, two.places)


@given(
    st.lists(
        st.lists(st.integers(0, 60), min_size=4, max_size=4, unique=True),
        min_size=1,
        max_size=120,
    ),
    st.sampled_from([4, 8, 16]),
)
def test_any_elements_are_covered_once(rows, width):
    indices = np.array(rows, dtype="i4")
    chosen = np.arange(len(indices))[:: 2 if len(indices) > 5 else 1]
    blocks, rest = run_blocks(indices, chosen, width)
    check(blocks, rest, indices, chosen, width)


def test_spread_blocks_fill_up_with_repeats():
    indices = np.array([[3, 1], [7, 2], [5, 5]], dtype="i4")
    blocks = spread_blocks(indices, np.array([0, 1, 2]), 2)
    assert blocks.element.tolist() == [0, 1, 2, -1]
    assert blocks.places.tolist() == [[[3, 1], [7, 2]], [[5, 5], [5, 5]]]
    packed = blocks.spread_out(np.array([1.0, 2.0, 3.0]), fill=9.0)
    assert packed.tolist() == [1, 2, 3, 9]


def test_ensemble_blocks_are_one_element_in_every_lane():
    blocks = ensemble_blocks(np.array([[0, 2], [1, 2]], dtype="i4"), np.array([1]), 4)
    assert blocks.element.tolist() == [1, 1, 1, 1]
    assert blocks.places.tolist() == [[4, 8]]
