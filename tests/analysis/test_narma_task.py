import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from openprc.analysis.tasks.imitation import NARMA_task, narma_system
from openprc.errors import TaskError


@pytest.mark.parametrize(
    ("order", "u", "expected"),
    [
        (2, 0.0, (3 - np.sqrt(5)) / 4),
        (5, 0.0, (0.7 - np.sqrt(0.49 - 0.1)) / 0.5),
        (10, 0.0, 0.7 - np.sqrt(0.29)),
        (2, 0.25, 0.75 - np.sqrt(0.5625 - 2.5 * 0.109375)),
        (5, 0.25, (0.7 - np.sqrt(0.49 - 0.19375)) / 0.5),
        (10, 0.25, 0.7 - np.sqrt(0.49 - 0.3875)),
    ],
)
def test_fixed_points(order, u, expected):
    """The smaller root of the recursion with y(t+1) = y(t)."""
    y = NARMA_task(np.full(2000, u), order)
    assert y[-1] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("order", "u", "printed"),
    [(2, 0, 0.190983), (5, 0, 0.151000), (10, 0, 0.161484), (2, 0.25, 0.212355),
     (5, 0.25, 0.311423), (10, 0.25, 0.379844)],
)  # fmt: skip
def test_fixed_points_in_print(order, u, printed):
    assert NARMA_task(np.full(2000, float(u)), order)[-1] == pytest.approx(printed, abs=6e-7)


@pytest.mark.parametrize(
    ("order", "mean", "std", "tolerance"),
    [
        (2, 0.23500, 0.02556, 0.0005),
        (5, 0.31357, 0.09384, 0.002),
        (10, 0.3876, 0.1086, 0.004),
        (20, 0.20286, 0.09370, 0.002),
    ],
)
def test_statistics_of_uniform_input(order, mean, std, tolerance):
    u = np.random.default_rng(1).uniform(0.0, 0.5, 60_000)
    y = NARMA_task(u, order)[1000:]
    assert y.mean() == pytest.approx(mean, abs=tolerance)
    assert y.std() == pytest.approx(std, abs=tolerance)


@pytest.mark.parametrize("order", [2, 3, 5, 10, 20, 30])
def test_recursion_element_by_element(order):
    """y(t+1) from u(t), and the oldest input of the product is u(t-n+1)."""
    u = np.random.default_rng(order).uniform(0.0, 0.5, 200)
    y = NARMA_task(u, order)
    a, b, c, d = {
        2: (0.4, 0.4, 0.6, 0.1), 20: (0.3, 0.05, 1.5, 0.01), 30: (0.2, 0.04, 1.5, 0.001),
    }.get(order, (0.3, 0.05, 1.5, 0.1))  # fmt: skip
    for t in range(order, 199):
        if order == 2:
            value = a * y[t] + b * y[t] * y[t - 1] + c * u[t] ** 3 + d
        else:
            history = y[t - order + 1 : t + 1].sum()
            value = a * y[t] + b * y[t] * history + c * u[t - order + 1] * u[t] + d
        if order == 20:
            value = np.tanh(value)
        assert y[t + 1] == pytest.approx(value, abs=1e-14)


@settings(max_examples=50, deadline=None)
@given(
    order=st.sampled_from([2, 4, 5, 20]),
    k=st.integers(0, 99),
    seed=st.integers(0, 2**16),
)
def test_causal(order, k, seed):
    """With horizon 1 element t depends on u(t) and nothing later; with horizon 0, up to u(t-1)."""
    u = np.random.default_rng(seed).uniform(0.05, 0.45, 100)
    other = u.copy()
    other[k] += 0.05
    now, before = NARMA_task(u, order, horizon=1), NARMA_task(u, order)
    np.testing.assert_array_equal(NARMA_task(other, order, horizon=1)[:k], now[:k])
    np.testing.assert_array_equal(NARMA_task(other, order)[: k + 1], before[: k + 1])
    np.testing.assert_array_equal(before[1:], now[:-1])
    if order == 2:
        assert NARMA_task(other, order, horizon=1)[k] > now[k]


def test_column_input_and_start():
    y = NARMA_task(np.array([[0.0], [0.5], [0.0]]), 2)
    np.testing.assert_allclose(y, [0.0, 0.1, 0.215], rtol=1e-15)


@pytest.mark.parametrize("order", [6, 8, 10])
def test_divergence_is_found(order):
    with pytest.raises(TaskError, match=f"NARMA{order} diverged at step \\d+ of 500"):
        NARMA_task(np.full(500, 0.5), order)


def test_bounded_form_does_not_diverge():
    assert NARMA_task(np.full(5000, 0.5), 20).max() < 1.0


@pytest.mark.parametrize("order", [2, 5, 10, 20, 30])
def test_formula_and_source_are_told(order):
    system = narma_system(order)
    assert system.formula.startswith("y(t+1) = ")
    assert "doi:" in system.source
    if order > 2:
        assert f"u(t-{order - 1}) u(t)" in system.formula
    assert ("tanh" in system.formula) == (order == 20)


@pytest.mark.parametrize("order", [0, 1, -2, 11, 19, 21, 31, 2.5, "2", True])
def test_unknown_orders(order):
    with pytest.raises(TaskError, match="the order is"):
        NARMA_task(np.zeros(10), order)


@pytest.mark.parametrize(
    ("u", "order", "words"),
    [
        ([0.1, 0.6], 5, "runs from 0.1 to 0.6\n.*0 to 0.5 for order 5"),
        ([-0.1, 0.2], 10, "runs from -0.1 to 0.2"),
        ([-0.6, 0.2], 2, "-0.5 to 0.5 for order 2"),
        ([0.1, np.nan], 2, "1 of 2 input values are NaN"),
        ([], 2, "shape \\(0,\\)"),
        (np.zeros((5, 2)), 2, "shape \\(5, 2\\)"),
    ],
)
def test_wrong_input(u, order, words):
    with pytest.raises(TaskError, match=words):
        NARMA_task(u, order)


def test_range_check_can_be_left_out():
    assert NARMA_task([0.6, 0.6], 5, any_range=True)[1] == pytest.approx(0.1)


def test_wrong_horizon():
    with pytest.raises(TaskError, match="the horizon is 2"):
        NARMA_task([0.1], 2, horizon=2)
