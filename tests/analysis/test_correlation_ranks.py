"""Rank correlations against SciPy, ties included."""

import numpy as np
import pytest
from scipy import stats

from openprc.analysis.correlation import Nonparametric
from openprc.analysis.correlation.ranks import OrderedRanks, circular_correlation, kendall_tau


@pytest.mark.parametrize("n", [8, 9, 64, 65, 500])
@pytest.mark.parametrize("decimals", [0, 1, 9])
def test_scipy(n, decimals):
    rng = np.random.default_rng(n)
    x = np.round(rng.normal(size=n), decimals)
    Y = np.round(x[:, None] * [1, -1, 0] + rng.normal(size=(n, 3)), decimals)
    found = Nonparametric(x, Y)
    for k in range(3):
        tau = stats.kendalltau(x, Y[:, k]).statistic
        assert found.kendall.values[k] == pytest.approx(tau, abs=1e-13)
        rho = stats.spearmanr(x, Y[:, k]).statistic
        assert found.spearman.values[k] == pytest.approx(rho, abs=1e-13)


def test_monotonic_is_one():
    x = np.linspace(-2, 2, 50)
    found = Nonparametric(x, np.stack([np.exp(x), -(x**3)], axis=1))
    np.testing.assert_array_equal(found.kendall.values, [1.0, -1.0])
    np.testing.assert_allclose(found.spearman.values, [1.0, -1.0], rtol=1e-15)


def test_reordered_rows():
    rng = np.random.default_rng(0)
    x, y = np.round(rng.normal(size=(2, 40)), 1)
    orders = [rng.permutation(40) for _ in range(4)]
    expected = [stats.kendalltau(x, y[order]).statistic for order in orders]
    np.testing.assert_allclose(kendall_tau(OrderedRanks.of(x), y, orders), expected, atol=1e-13)


def test_circular_shifts():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 37))
    a, b = a - a.mean(), b - b.mean()
    expected = [np.corrcoef(a, np.roll(b, -shift))[0, 1] for shift in range(37)]
    np.testing.assert_allclose(circular_correlation(a, b), expected, atol=1e-13)
