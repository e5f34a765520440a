"""Least squares by QR: exact, biased as a penalty says, and where normal equations fail."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone

from openprc.errors import TaskError
from openprc.reservoir import LeastSquares, Ridge
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.row_split import RowSplit

SPLIT = RowSplit(10, 3000, 1000)
N = SPLIT.n_rows


def normal(shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("standardize", [True, False])
def test_a_linear_function_of_the_states_is_exact(standardize):
    states = normal((N, 7)) * 10.0 ** np.arange(-5, 2) + 3.0
    target = states @ normal((7, 2), 1) + 5.0
    found = evaluate(LeastSquares(), states, target, split=SPLIT, standardize=standardize)
    assert found.nmse.max() < 1e-24
    assert found.fitted.estimator.rank_ == 7


@pytest.mark.parametrize("readout", [LeastSquares, Ridge])
def test_a_penalty_pulls_the_weight_of_a_standardised_state_by_n_over_n_plus_p(readout):
    states = normal((N, 1))
    penalty = 300.0
    found = evaluate(readout(penalty), states, states, split=SPLIT)
    # Predicted is mean + n / (n + p) (x - mean), on training rows exactly.
    assert found.train_nmse[0] == pytest.approx((penalty / (SPLIT.train + penalty)) ** 2, rel=1e-9)


def test_penalised_weights_agree_with_ridge():
    states, target = normal((N, 12)), normal((N, 2), 1)
    ours = evaluate(LeastSquares(2.5), states, target, split=SPLIT)
    ridge = evaluate(Ridge(2.5), states, target, split=SPLIT)
    np.testing.assert_allclose(ours.prediction, ridge.prediction, atol=1e-12)


def test_a_direction_of_1e_minus_10_is_kept_and_normal_equations_lose_it():
    common, hidden = normal((N, 1)), normal((N, 1), 1)
    states = np.hstack([common, common + 1e-10 * hidden])
    ours = evaluate(LeastSquares(), states, hidden, split=SPLIT)
    # Rounding of the states themselves, 1e-16 of 1e-10, is what is left.
    assert ours.nmse[0] < 1e-10
    assert evaluate(Ridge(0.0), states, hidden, split=SPLIT).nmse[0] > 0.9


def test_copied_states_share_a_weight_and_are_remarked_on():
    state = normal((N, 1))
    states = np.hstack([state, state, np.ones((N, 1))])
    found = evaluate(LeastSquares(), states, 4.0 * state, split=SPLIT)
    assert found.nmse[0] < 1e-24
    np.testing.assert_allclose(found.fitted.weights[:2, 0], found.fitted.weights[0, 0])
    assert found.fitted.weights[2, 0] == 0.0
    assert any("1 of 2 directions" in text for text in found.fitted.warnings)


def test_fewer_rows_than_states_give_the_weights_of_least_norm():
    states, target = normal((6, 20)), normal(6, 1)
    readout = LeastSquares().fit(states, target)
    centred = states - states.mean(axis=0)
    expected = np.linalg.pinv(centred) @ (target - target.mean())
    np.testing.assert_allclose(readout.coef_, expected, atol=1e-12)
    np.testing.assert_allclose(readout.predict(states), target, atol=1e-12)


def test_an_offset_of_a_million_deviations_costs_no_more_than_the_digits_of_the_states():
    states = 1e6 + normal((N, 3))
    target = states @ np.array([[1.0], [2.0], [3.0]]) - 6e6
    assert evaluate(LeastSquares(), states, target, split=SPLIT).nmse[0] < 1e-18


def test_rows_that_are_left_out_do_not_count():
    states, target = normal((N, 4)), normal((N, 1), 1)
    rows = np.flatnonzero(np.arange(N) % 3)
    readout = LeastSquares()
    readout.fit_blocks(RowBlocks(states, rows), target[rows], standardize=False)
    expected = LeastSquares().fit(states[rows], target[rows, 0])
    np.testing.assert_allclose(readout.coef_[0], expected.coef_, atol=1e-13)


def test_no_state_that_changes_leaves_the_mean():
    readout = LeastSquares().fit(np.ones((5, 2)), np.arange(5.0))
    np.testing.assert_allclose(readout.predict(np.zeros((1, 2))), [2.0])


def test_it_can_be_cloned():
    copy = clone(LeastSquares(1.0, rank_tolerance=1e-3))
    assert (copy.regularization, copy.rank_tolerance) == (1.0, 1e-3)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"regularization": -1.0}, "regularization"),
        ({"regularization": np.nan}, "regularization"),
        ({"rank_tolerance": 1.0}, "rank_tolerance"),
        ({"rank_tolerance": True}, "rank_tolerance"),
    ],
)
def test_parameters_out_of_range_are_refused(settings, key):
    with pytest.raises(TaskError, match=f"{key} is .*\n  expected: a finite number, at least 0"):
        LeastSquares(**settings).fit(normal((9, 2)), normal(9))


def test_a_tolerance_leaves_small_directions_out():
    states = normal((N, 2)) * np.array([1.0, 1e-4])
    readout = LeastSquares(rank_tolerance=1e-2).fit(states, states[:, 1])
    assert readout.rank_ == 1
