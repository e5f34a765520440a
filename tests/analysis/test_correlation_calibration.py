"""Tests keep their promise on slow recordings, and find what is there."""

import numpy as np
import pytest
from scipy.signal import lfilter

from openprc.analysis.correlation import Linear, Nonparametric
from openprc.errors import TaskError

RUNS, N = 200, 500
#: Nominal 5 %, and what is accepted in 200 runs.
NOMINAL, ACCEPTED = 0.05, 0.09


def slow(rng, *shape, phi=0.9):
    """Stationary first-order autoregressive series along the last axis."""
    return lfilter([1], [1, -phi], rng.normal(size=(*shape, N + 200)))[..., 200:]


@pytest.fixture(scope="module")
def rejections():
    """Share of independent slow pairs that each metric calls dependent."""
    rng = np.random.default_rng(22)
    found = {}
    for _ in range(RUNS):
        x, y = slow(rng, 2)
        lin = Linear(x, y, max_lag=30)
        several = Linear(x, slow(rng, 5).T)
        free = Nonparametric(x, y, n_surrogates=99, max_lag=30)
        for name, result in (
            ("pearson", lin.pearson),
            ("peak", lin.peak),
            ("cca", several.cca(n_surrogates=99)),
            ("partial", several.partial),
            ("spearman", free.spearman),
            ("kendall", free.kendall),
            ("dcor", free.dcor),
            ("hsic", free.hsic),
        ):
            p = result.p_values[0]
            found.setdefault(name, []).append(p[1] if name == "partial" else p)
        found.setdefault("hsic_profile", []).append(free.hsic_profile.p_values[0, 30])
    return {name: np.mean(np.array(p) <= NOMINAL) for name, p in found.items()}


@pytest.mark.parametrize(
    "metric",
    ["pearson", "peak", "partial", "cca", "spearman", "kendall", "dcor", "hsic", "hsic_profile"],
)
def test_independent_slow_series_are_seldom_called_dependent(rejections, metric):
    assert rejections[metric] <= ACCEPTED


def test_a_test_for_white_data_calls_most_of_them_dependent():
    # What the default is there to prevent; if this passed, the fixture would show nothing.
    rng = np.random.default_rng(23)
    wrong = [
        Nonparametric(*slow(rng, 2), null=null, n_surrogates=19).dcor.p_values[0] <= NOMINAL
        for _ in range(40)
        for null in ("permutation", "chi2")
    ]
    assert np.mean(wrong) > 0.5


@pytest.mark.parametrize("null", ["shift", "block"])
def test_dependent_slow_series_are_found(null):
    rng = np.random.default_rng(24)
    x, noise = slow(rng, 2)
    found = Nonparametric(x, np.stack([x + 0.5 * noise, x**2, noise], axis=1), null=null)
    for metric in (found.dcor, found.hsic):
        np.testing.assert_array_equal(metric.significant(0.05), [True, True, False])
    for metric in (found.spearman, found.kendall):
        np.testing.assert_array_equal(metric.significant(0.05)[[0, 2]], [True, False])
    if null == "shift":
        assert Linear(x, x + 0.5 * noise).cca().significant().all()
        assert Linear(x, x + 0.5 * noise).pearson.significant().all()


@pytest.mark.parametrize("null", ["shift", "block", "permutation", "chi2"])
def test_white_data(null):
    rng = np.random.default_rng(25)
    x = rng.normal(size=300)
    found = Nonparametric(x, np.stack([x**2, rng.normal(size=300)], axis=1), null=null, max_lag=20)
    np.testing.assert_array_equal(found.dcor.significant(0.05), [True, False])
    np.testing.assert_array_equal(found.hsic.significant(0.05), [True, False])


def test_p_values_are_reproducible_and_do_not_depend_on_other_channels():
    rng = np.random.default_rng(26)
    x, Y = slow(rng), slow(rng, 2).T
    p = Nonparametric(x, Y, seed=4).dcor.p_values
    np.testing.assert_array_equal(p, Nonparametric(x, Y, seed=4).dcor.p_values)
    assert p[0] == Nonparametric(x, Y[:, :1], seed=4).dcor.p_values[0]


def test_a_slow_pair_has_no_tiny_p_value():
    rng = np.random.default_rng(27)
    x = slow(rng, phi=0.98)
    # However large the dependence: the recording holds only some independent shifts.
    assert Nonparametric(x, x).spearman.p_values[0] > 10 / N
    white = rng.normal(size=N)
    assert Nonparametric(white, white).spearman.p_values[0] < 2 / N


def test_nulls_that_do_not_fit():
    x = np.random.default_rng(28).normal(size=50)
    with pytest.raises(TaskError, match=r"null is 'shuffle'\n.*shift or block"):
        Nonparametric(x, x, null="shuffle")
    with pytest.raises(TaskError, match="n_surrogates is 0"):
        Nonparametric(x, x, n_surrogates=0)
    found = Nonparametric(x, x, null="chi2")
    assert found.kendall.values[0] == 1.0
    for metric in (found.kendall, found.spearman):
        with pytest.raises(TaskError, match="chi-squared limit is known for dcor and hsic"):
            _ = metric.p_values
