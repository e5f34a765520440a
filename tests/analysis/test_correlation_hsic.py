"""The Hilbert-Schmidt criterion against whole kernel matrices, and its profile over shifts."""

import numpy as np
import pytest

from openprc.analysis.correlation import Nonparametric
from openprc.analysis.correlation.hsic import (
    KernelSeries,
    hsic,
    hsic_by_shift,
    hsic_reordered,
    kernel_correlation,
    median_distance,
)
from openprc.errors import TaskError


def kernel(v):
    distances = np.abs(np.subtract.outer(v, v))
    width = np.median(distances[np.triu_indices(len(v), 1)])
    return np.exp(-(distances**2) / (2 * width**2))


def direct(x, y):
    n = len(x)
    centre = np.eye(n) - 1 / n
    return np.sum((centre @ kernel(x) @ centre) * kernel(y)) / n**2


def low_rank(x, y):
    return hsic(KernelSeries.of(x), KernelSeries.of(y))


@pytest.mark.parametrize("n", [8, 51, 500, 1000])
@pytest.mark.parametrize("related", [True, False])
def test_whole_matrices(n, related):
    rng = np.random.default_rng(n)
    x, y = rng.normal(size=(2, n))
    y = x**2 + 0.5 * y if related else y
    assert low_rank(x, y) == pytest.approx(direct(x, y), rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("draw", ["standard_cauchy", "standard_exponential", "random"])
def test_other_distributions(draw):
    x, y = (getattr(np.random.default_rng(seed), draw)(400) for seed in (1, 2))
    assert low_rank(x, x * y) == pytest.approx(direct(x, x * y), rel=1e-9)


@pytest.mark.parametrize("n", [8, 9, 50, 301])
@pytest.mark.parametrize("decimals", [0, 1, 12])
def test_the_median_is_exact(n, decimals):
    x = np.round(np.random.default_rng(n).normal(size=n), decimals)
    distances = np.abs(np.subtract.outer(x, x))[np.triu_indices(n, 1)]
    found = median_distance(x)
    if np.median(distances) > 0:
        assert found.value == np.median(distances)
        assert not found.many_ties
    else:
        assert found.value == np.median(distances[distances > 0])
        assert found.many_ties


def test_two_valued_series_say_how_wide_their_kernel_is():
    x = np.repeat([0.0, 1.0], 20)
    x[:3] = 1.0
    assert median_distance(np.repeat([0.0, 2.0], [30, 10])).value == 2.0
    found = Nonparametric(np.repeat([0.0, 2.0], [30, 10]), np.arange(40.0), names=["ramp"]).hsic
    assert "half of the pairs of samples are equal" in found.notes[0]
    assert found.notes[0].endswith("the input.")


def test_all_shifts_at_once():
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, 101))
    y = np.roll(x, 5) ** 2 + y
    a, b = KernelSeries.of(x), KernelSeries.of(y)
    profile = hsic_by_shift(a, b).values
    expected = [direct(x, np.roll(y, -shift)) for shift in range(101)]
    np.testing.assert_allclose(profile, expected, atol=1e-11)
    orders = [np.roll(np.arange(101), -shift) for shift in (0, 3)]
    np.testing.assert_allclose(hsic_reordered(a, b, orders), np.take(expected, [0, 3]), atol=1e-11)


def test_the_profile_finds_a_square_of_a_late_input():
    rng = np.random.default_rng(4)
    x = rng.normal(size=2000)
    Y = np.stack([np.roll(x, 13) ** 2, rng.normal(size=2000)], axis=1)
    Y[:, 0] += 0.5 * rng.normal(size=2000)
    profile = Nonparametric(x, Y, max_lag=30).hsic_profile
    assert profile.shape == (2, 61)
    assert profile.lags[np.argmax(profile.values[0])] == 13
    found = profile.significant(0.05, correction="bonferroni")
    assert profile.lags[found[0]].tolist() == [13]
    assert not found[1].any()
    assert np.all(profile.values[1] < 2 * profile.threshold[1])


def test_kernel_correlation_is_that_of_u_centred_matrices():
    rng = np.random.default_rng(5)
    x, y = rng.normal(size=(2, 80))
    y += np.abs(x)
    n = len(x)

    def u_centred(k):
        k = k - np.diag(np.diag(k))
        rows = k.sum(0) / (n - 2)
        found = k - rows - rows[:, None] + k.sum() / ((n - 1) * (n - 2))
        np.fill_diagonal(found, 0.0)
        return found

    p, q = u_centred(kernel(x)), u_centred(kernel(y))
    expected = np.sum(p * q) / np.sqrt(np.sum(p * p) * np.sum(q * q))
    found = kernel_correlation(KernelSeries.of(x), KernelSeries.of(y))
    assert found == pytest.approx(expected, abs=1e-11)


def test_extremes_that_no_kernel_reaches(monkeypatch):
    monkeypatch.setattr("openprc.analysis.correlation.hsic.MOST_DIRECTIONS", 50)
    # Every sample of the tail is alone: the median is that of the narrow rest.
    x = np.concatenate([np.linspace(0, 1, 300), 1e4 * np.arange(1, 60)])
    with pytest.raises(TaskError, match=r"more than 50 kernels.*\n.*\n.*ranks"):
        KernelSeries.of(x)


def test_tails_of_the_law_without_dependence():
    reached = []
    for seed in range(40):
        x, y = np.random.default_rng(seed).normal(size=(2, 600))
        reached.append(Nonparametric(x, y, max_lag=50).hsic_profile.p_values[0])
    p = np.concatenate(reached)
    # 4040 lags: nominal 5 %, 1 % and 0.1 %, that is 202, 40 and 4 of them.
    assert 140 < np.count_nonzero(p <= 0.05) < 270
    assert 15 < np.count_nonzero(p <= 0.01) < 75
    assert np.count_nonzero(p <= 0.001) < 16
