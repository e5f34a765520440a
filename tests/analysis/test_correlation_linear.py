"""Pearson, cross-correlation and partial correlation against their definitions."""

import numpy as np
import pytest
from scipy import stats

from openprc.analysis.correlation import Linear
from openprc.errors import TaskError


def late(u, by, rng):
    """The input `by` rows later; before that, something else."""
    return np.concatenate([rng.normal(size=by), u[: len(u) - by]])


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_pearson_of_white_data_is_that_of_scipy(rng):
    u = rng.normal(size=400)
    X = 0.1 * u[:, None] * np.arange(4) + rng.normal(size=(400, 4)) + 1e6
    found = Linear(u, X).pearson
    for k in range(4):
        r, p = stats.pearsonr(u, X[:, k])
        assert found.values[k] == pytest.approx(r, abs=1e-10)
        # White data are worth about as many samples as they have rows.
        assert 300 < found.n_effective[k] <= 400
        assert found.p_values[k] == pytest.approx(p, abs=0.05)


def test_slow_series_are_worth_few_samples(rng):
    from scipy.signal import lfilter

    phi, n = 0.9, 20_000
    u, x = lfilter([1], [1, -phi], rng.normal(size=(2, n)))
    # Of two such processes the inflation is (1 + phi^2)/(1 - phi^2).
    expected = n * (1 - phi**2) / (1 + phi**2)
    assert Linear(u, x).pearson.n_effective[0] == pytest.approx(expected, rel=0.15)


def test_threshold_is_where_p_is_five_percent(rng):
    from openprc.analysis.correlation.effective_size import (
        correlation_p_values,
        critical_correlation,
    )

    sizes = np.array([2.5, 10.0, 300.0])
    critical = critical_correlation(sizes)
    np.testing.assert_allclose(correlation_p_values(critical, sizes), 0.05, rtol=1e-9)
    r, p = stats.pearsonr(*rng.normal(size=(2, 30)))
    assert correlation_p_values(np.array([r]), np.array([30.0])) == pytest.approx(p, rel=1e-9)
    # Two samples lie on a line always.
    assert correlation_p_values(np.array([0.99]), np.array([2.0])) == 1.0
    assert critical_correlation(np.array([1.5])) == 1.0


@pytest.mark.parametrize("by", [0, 1, 7, 40])
def test_a_channel_that_comes_later_peaks_at_a_positive_lag(rng, by):
    u = rng.normal(size=1000)
    lin = Linear(u, late(u, by, rng), lag_sweep=True, max_lag=60)
    assert lin.ccf.lags[np.argmax(np.abs(lin.ccf.values[0]))] == by
    assert lin.peak.lags.tolist() == [by]
    assert lin.peak.values[0] >= 0.999
    assert lin.peak.p_values[0] < 1e-100


def test_a_channel_that_comes_earlier_peaks_at_a_negative_lag(rng):
    u = rng.normal(size=1000)
    x = -np.concatenate([u[7:], rng.normal(size=7)])
    lin = Linear(u, x)
    assert lin.peak.lags.tolist() == [-7]
    assert lin.peak.values[0] <= -0.999


@pytest.mark.parametrize("n", [40, 101])
def test_cross_correlation_by_its_definition(rng, n):
    u, X = rng.normal(size=n), rng.normal(size=(n, 3)) + 50
    lin = Linear(u, X, max_lag=n - 2)
    a = u - u.mean()
    for k in range(3):
        b = X[:, k] - X[:, k].mean()
        expected = [
            sum(a[t] * b[t + lag] for t in range(max(0, -lag), min(n, n - lag)))
            for lag in lin.ccf.lags
        ]
        expected /= np.sqrt(a @ a * (b @ b))
        np.testing.assert_allclose(lin.ccf.values[k], expected, atol=1e-12)
    np.testing.assert_allclose(lin.ccf.values[:, n - 2], lin.pearson.values, atol=1e-12)


def test_lags_reach_a_quarter_of_the_rows_and_at_most_five_hundred(rng):
    assert Linear(rng.normal(size=100), rng.normal(size=100)).max_lag == 25
    assert Linear(rng.normal(size=9000), rng.normal(size=9000)).max_lag == 500


@pytest.mark.parametrize("lag", [-1, 99])
def test_lags_out_of_range(rng, lag):
    with pytest.raises(TaskError, match=rf"max_lag: max_lag is {lag}\n.*0 to 98"):
        Linear(rng.normal(size=100), rng.normal(size=100), max_lag=lag)


# --- partial correlation -----------------------------------------------------------------------


def test_partial_correlation_sees_through_a_chain(rng):
    a = rng.normal(size=5000)
    b = a + rng.normal(size=5000)
    c = b + rng.normal(size=5000)
    lin = Linear(a, np.stack([a, b, c], axis=1))
    found = lin.partial
    assert np.corrcoef(a, c)[0, 1] > 0.5
    # Given b, a tells nothing about c; a and b given c: 1/2.
    assert found.values[0, 2] == pytest.approx(0.0, abs=0.04)
    assert found.values[0, 1] == pytest.approx(0.5, abs=0.03)
    np.testing.assert_array_equal(found.values, found.values.T)
    np.testing.assert_array_equal(found.significant()[0], [False, True, False])


def test_partial_correlation_is_that_of_residuals(rng):
    X = rng.normal(size=(200, 5)) @ rng.normal(size=(5, 5))
    found = Linear(X[:, 0], X).partial.values
    rest = np.column_stack([np.ones(200), X[:, 2:]])
    left = X[:, :2] - rest @ np.linalg.lstsq(rest, X[:, :2], rcond=None)[0]
    assert found[0, 1] == pytest.approx(np.corrcoef(left.T)[0, 1], abs=1e-10)
    precision = np.linalg.inv(np.corrcoef(X.T))
    scale = np.sqrt(np.diag(precision))
    expected = -precision / np.outer(scale, scale)
    np.testing.assert_allclose(found[~np.eye(5, dtype=bool)], expected[~np.eye(5, dtype=bool)])


def test_copies_of_a_channel(rng):
    X = rng.normal(size=(300, 3))
    X[:, 2] += X[:, 0]
    copied = np.column_stack([X, 2 * X[:, 0] + 1, np.zeros(300)])
    found = Linear(X[:, 0], copied, names=["a", "b", "c", "copy", "still"]).partial
    assert found["a"][3] == pytest.approx(1.0, abs=1e-6)
    assert found["a"][2] == pytest.approx(0.0, abs=1e-3)
    expected = Linear(X[:, 0], X).partial.values[1, 2]
    assert found["b"][2] == pytest.approx(expected, abs=1e-6)
    assert np.isnan(found["still"]).all()
    assert found.dropped == ("still",)
    assert "4 channels has rank 3" in found.notes[0]
    with pytest.raises(TaskError, match=r"partial has no p-values\n.*\n.*rank 3"):
        found.significant()


def test_more_channels_than_rows(rng):
    found = Linear(rng.normal(size=20), rng.normal(size=(20, 30))).partial
    assert np.isfinite(found.values).all()
    assert np.abs(found.values).max() <= 1.0
    assert "rank 19" in found.notes[0]
