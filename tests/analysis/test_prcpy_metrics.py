"""PRCpy's numbers against a direct computation of their definitions, and where they mislead."""

from __future__ import annotations

import doctest

import numpy as np
import pytest

from openprc.analysis.benchmarks import prcpy_metrics
from openprc.analysis.benchmarks.prcpy_metrics import (
    estimator_capacity,
    linear_memory_curve,
    non_linearity,
    prcpy_scores,
)
from openprc.errors import TaskError


def body(n_rows=240, n_states=12, *, seed=4):
    """Return an input that is not white, and states that remember it."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=n_rows + 4), np.ones(5) / 5, mode="valid")
    leak = np.linspace(0.1, 1.0, n_states)
    states = np.zeros((n_rows, n_states))
    x = np.zeros(n_states)
    for t in range(n_rows):
        x = (1 - leak) * x + leak * np.tanh(2.0 * u[t] + 0.3 * np.roll(x, 1))
        states[t] = x
    return u, states + 0.01 * rng.normal(size=states.shape)


# --- the definitions, computed in another way ----------------------------------------------------


def fit(x, y, alpha=0.0):
    """Return weights of the normal equations with an unpenalised intercept."""
    ones = np.column_stack([np.ones(len(x)), x])
    penalty = alpha * np.diag([0.0] + [1.0] * x.shape[1])
    return np.linalg.solve(ones.T @ ones + penalty, ones.T @ y)


def predict(x, w):
    return w[0] + x @ w[1:]


def capacity(u, x):
    n = int(len(u) * 0.75)
    p, t = predict(x[n:], fit(x[:n], u[:n])), u[n:]
    return (np.mean(p * t) - p.mean() * t.mean()) ** 2 / (np.var(u) * np.var(p))


def memory(u, x, k_max):
    return [capacity(u[: len(u) - k], x[k:]) for k in range(1, k_max)]


def nonlinearity(u, x, k):
    history = np.array([[u[t - j] if t >= j else 0.0 for j in range(k)] for t in range(len(u))])
    return 1 - np.mean([capacity(column, history) for column in x.T])


@pytest.mark.parametrize(("k_max", "n_lags"), [(2, 1), (12, 12), (25, 25)])
def test_metrics_follow_their_definition(k_max, n_lags):
    u, x = body()
    scores = prcpy_scores(x, u, target=u, k_max=k_max, n_lags=n_lags)
    curve, own = memory(u, x, k_max), memory(u, u[:, None], k_max)
    np.testing.assert_allclose(scores["linear_memory_curve"], curve, rtol=1e-9)
    assert scores["linear_memory_capacity"] == pytest.approx(sum(curve), rel=1e-9)
    assert scores["linear_memory_capacity_without_input"] == pytest.approx(
        sum(curve) - sum(own), rel=1e-8
    )
    assert scores["non_linearity"] == pytest.approx(nonlinearity(u, x, n_lags), rel=1e-8)
    np.testing.assert_allclose(linear_memory_curve(u, x, k_max=k_max), curve, rtol=1e-9)
    assert non_linearity(u, x, n_lags=n_lags) == pytest.approx(scores["non_linearity"], abs=1e-12)


@pytest.mark.parametrize("tau", [1, 10])
@pytest.mark.parametrize("test_size", [0.3, 0.21])
def test_errors_of_forecasts(tau, test_size):
    u, x = body(101)
    scores = prcpy_scores(x, target=u, tau=tau, test_size=test_size, alpha=0.1)
    n = int(101 * (1 - test_size))
    w = fit(x[:n], u[tau : n + tau], alpha=0.1)
    train, test = predict(x[:n], w) - u[tau : n + tau], predict(x[n:-tau], w) - u[n + tau :]
    assert scores["train_mse"] == pytest.approx(np.mean(train**2), rel=1e-9)
    assert scores["test_mse"] == pytest.approx(np.mean(test**2), rel=1e-9)
    assert scores["train_mae"] == pytest.approx(np.mean(abs(train)), rel=1e-9)
    assert scores["test_mae"] == pytest.approx(np.mean(abs(test)), rel=1e-9)
    assert scores["test_nmse"] == pytest.approx(np.mean(test**2) / np.var(u[n + tau :]), rel=1e-9)
    assert "non_linearity" not in scores


def test_errors_of_transformations_split_as_scikit_learn_does():
    from sklearn.linear_model import Ridge
    from sklearn.model_selection import train_test_split

    u, x = body(101)
    y = np.sign(u)
    a, b, c, d = train_test_split(x, y, test_size=0.3, shuffle=False)
    model = Ridge(alpha=0.5).fit(a, c)
    scores = prcpy_scores(x, target=y, tau=0, test_size=0.3, alpha=0.5)
    assert len(d) == 31
    assert scores["train_mse"] == pytest.approx(np.mean((model.predict(a) - c) ** 2), rel=1e-12)
    assert scores["test_mse"] == pytest.approx(np.mean((model.predict(b) - d) ** 2), rel=1e-12)


# --- where they mislead --------------------------------------------------------------------------


@pytest.mark.parametrize("growth", [0.1, 1.0, 4.0])
def test_the_capacity_of_a_perfect_copy_is_a_ratio_of_variances(growth):
    u = np.random.default_rng(2).normal(size=400)
    u[300:] *= growth
    states = np.column_stack([u, np.ones(400)])
    (found,) = estimator_capacity(u, states)
    assert found == pytest.approx(np.var(u[300:]) / np.var(u), rel=1e-9)
    (corrected,) = estimator_capacity(u, states, denominator="test rows")
    assert corrected == pytest.approx(1.0, abs=1e-9)


def test_a_capacity_above_one_is_remarked_on():
    u, x = body()
    assert prcpy_scores(x, u, target=u)["remarks"] == ()
    u[180:] *= 3.0
    x[180:] *= 3.0
    scores = prcpy_scores(x, u, target=u)
    assert scores["linear_memory_curve"].max() > 1.0
    assert scores["linear_memory_curve_corrected"].max() <= 1.0
    assert 0.0 <= scores["non_linearity_corrected"] <= 1.0
    assert "a capacity is above 1: PRCpy divides by the variance of all" in scores["remarks"][-1]


def test_corrected_numbers_are_squared_correlations():
    u, x = body()
    found = linear_memory_curve(u, x, k_max=4, denominator="test rows")
    for k in (1, 2, 3):
        y, s = u[:-k], x[k:]
        n = int(0.75 * len(y))
        p = predict(s[n:], fit(s[:n], y[:n]))
        assert found[k - 1] == pytest.approx(np.corrcoef(p, y[n:])[0, 1] ** 2, rel=1e-9)
    both = non_linearity(u, x), non_linearity(u, x, denominator="test rows")
    assert both[0] != both[1]


def test_a_register_of_six_inputs_has_its_memory_and_no_nonlinearity():
    u = np.random.default_rng(8).uniform(-1.0, 1.0, 3000)
    states = np.column_stack([np.r_[np.zeros(k), u[: 3000 - k]] for k in range(1, 7)])
    scores = prcpy_scores(states, u, target=u, k_max=12)
    assert scores["linear_memory_curve_corrected"][:6] == pytest.approx(1.0, abs=1e-9)
    assert scores["linear_memory_curve_corrected"][6:].max() < 0.02
    assert scores["non_linearity_corrected"] == pytest.approx(0.0, abs=1e-9)


def test_an_offset_does_not_eat_the_digits():
    u, x = body()
    here, there = estimator_capacity(u, x), estimator_capacity(u + 1e7, x)
    np.testing.assert_allclose(here, there, rtol=1e-6)


def test_more_features_than_rows_is_remarked_on():
    u, _ = body(100)
    x = np.random.default_rng(0).normal(size=(100, 101))
    first, second = prcpy_scores(x, u, target=u, tau=10, k_max=12)["remarks"][:2]
    assert "70 training rows for 101 features" in first
    assert "fitted on 66 rows with 101 features" in second
    assert prcpy_scores(x[:, :70], target=u, tau=10)["remarks"] == ()


def test_values_beyond_the_states_are_told():
    u, x = body(100)
    longer = np.r_[u, 5.0, 6.0]
    scores = prcpy_scores(x, longer, target=longer, k_max=3, n_lags=3)
    expected = prcpy_scores(x, u[:, np.newaxis], target=u, k_max=3, n_lags=3)
    assert scores["remarks"][:2] == (
        "the last 2 values of target have no state: not used",
        "the last 2 values of u have no state: not used",
    )
    assert scores["remarks"][2:] == expected["remarks"]
    for key in set(scores) - {"remarks"}:
        np.testing.assert_array_equal(scores[key], expected[key])


# --- what is refused -----------------------------------------------------------------------------

U, X = body(100)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"states": U}, r"states has shape \(100,\)"),
        ({"states": np.where(np.arange(12) == 2, np.nan, X)}, r"states is not finite at \(0, 2\)"),
        ({"target": U[:99]}, r"target has shape \(99,\) and there are 100 rows"),
        ({"target": X}, r"target has shape \(100, 12\)"),
        ({"u": U[:50]}, r"u has shape \(50,\)"),
        ({"target": np.full(100, np.inf)}, r"target is not finite at \(0,\)"),
        ({"target": np.ones(100)}, "the target is constant on the test rows"),
        ({"u": np.ones(100)}, "u is constant"),
        ({"u": np.r_[U[:60], np.ones(40)]}, "the last quarter of u is constant"),
        ({"states": np.c_[X, np.ones(100)]}, "state 12 is constant"),
        ({"test_size": 1.0}, r"test_size is 1\.0"),
        ({"tau": -1}, "tau is -1"),
        ({"tau": 29}, "100 rows leave 70 for training and 1 for the test"),
        ({"k_max": 1}, "k_max is 1"),
        ({"k_max": 97}, "4 rows are left for a capacity"),
        ({"n_lags": 0}, "n_lags is 0"),
    ],
)
def test_what_is_refused(changes, match):
    given = {"states": X, "u": U, "target": U, **changes}
    with pytest.raises(TaskError, match=match):
        prcpy_scores(given.pop("states"), given.pop("u"), **given)


def test_a_prediction_that_does_not_vary():
    states = np.r_[np.random.default_rng(0).normal(size=75), np.ones(25)][:, np.newaxis]
    with pytest.raises(TaskError, match="the prediction of target is constant"):
        estimator_capacity(U, states)
    with pytest.raises(TaskError, match="100 rows of targets and 75 of predictors"):
        estimator_capacity(U, states[:75])


def test_the_example_of_the_docstring():
    assert doctest.testmod(prcpy_metrics) == doctest.TestResults(0, 5)
