import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from openprc.analysis.benchmarks.baseline import (
    baseline_readout,
    input_cubic,
    shift_register,
)
from openprc.analysis.tasks.imitation import NARMA_task
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.evaluation import evaluate
from openprc.reservoir.training.row_split import RowSplit

#: NRMSE of a linear shift register in the limit of infinite data, by number of taps.
LIMITS = {
    2: {1: 0.647, 5: 0.412, 50: 0.4015},
    5: {2: 0.785, 5: 0.475, 50: 0.3687},
    10: {10: 0.587, 11: 0.499, 15: 0.427, 50: 0.383},
    20: {20: 0.526, 50: 0.367},
    30: {30: 0.478, 50: 0.384},
}
N_SYMBOLS, N_SEEDS = 20_000, 4


@pytest.mark.parametrize("order", LIMITS)
def test_shift_register_limits(order):
    """Mean over four sequences: one alone is off by up to 0.026 for order 10."""
    split = RowSplit(washout=200, train=12_000, test=7_000)
    found = {taps: [] for taps in LIMITS[order]}
    for seed in range(N_SEEDS):
        u = np.random.default_rng(seed).uniform(0.0, 0.5, N_SYMBOLS)
        target = NARMA_task(u, order, horizon=1)[:, None]
        states = shift_register(u, 50)
        for taps, values in found.items():
            values.append(evaluate(Ridge(), states[:, :taps], target, split=split).mean_nrmse)
    for taps, limit in LIMITS[order].items():
        assert np.mean(found[taps]) == pytest.approx(limit, abs=0.01), f"{taps} taps"


def test_taps_are_the_last_inputs_newest_first():
    np.testing.assert_array_equal(
        shift_register(np.array([1.0, 2.0, 3.0, 4.0]), 3),
        [[1, 0, 0], [2, 1, 0], [3, 2, 1], [4, 3, 2]],
    )


def test_cubic_of_the_present_input():
    np.testing.assert_array_equal(input_cubic(np.array([2.0, -1.0])), [[2, 4, 8], [-1, 1, -1]])


def test_taps_of_several_inputs():
    u = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]])
    np.testing.assert_array_equal(
        shift_register(u, 2), [[1, 10, 0, 0], [2, 20, 1, 10], [3, 30, 2, 20]]
    )


def test_the_baseline_has_the_penalty_of_the_readout():
    assert baseline_readout(Ridge(0.5)).regularization == 0.5
    assert baseline_readout(LinearRegression()).regularization == Ridge().regularization
