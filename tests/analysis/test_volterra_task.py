"""The separable sum is the double sum."""

import numpy as np
import pytest

from openprc.analysis.tasks import VolterraTask
from openprc.errors import TaskError


def test_against_the_double_sum():
    task = VolterraTask(dt=0.02)
    u = np.random.default_rng(0).uniform(-1, 1, 40)
    lags = 0.02 * np.arange(11)
    kernel = np.exp(-((lags[:, None] - 0.1) ** 2 + (lags[None, :] - 0.1) ** 2) / (2 * 0.05**2))
    kernel /= kernel.sum()
    series = task.target(u)
    assert series.n_warmup == 10
    for k in range(10, 40):
        double = sum(kernel[i, j] * u[k - i] * u[k - j] for i in range(11) for j in range(11))
        assert series.values[k, 0] == pytest.approx(double, abs=1e-13)


def test_default_kernel():
    h = VolterraTask().kernel()
    assert len(h) == 201
    assert h.sum() == pytest.approx(1.0)
    assert np.argmax(h) == 100
    np.testing.assert_allclose(h, h[::-1], rtol=1e-9)
    assert h[50] / h[100] == pytest.approx(np.exp(-0.5))


def test_a_narrow_window_is_the_square_of_one_past_symbol():
    u = np.random.default_rng(1).normal(size=30)
    y = VolterraTask(dt=0.1, mean=0.3, width=1e-4, support=0.5).target(u).values[:, 0]
    np.testing.assert_allclose(y[5:], u[2:27] ** 2, rtol=1e-12)


def test_quadratic_and_invariant_in_time():
    task = VolterraTask(dt=0.02)
    u = np.random.default_rng(2).normal(size=(60, 2))
    y = task.target(u).values
    np.testing.assert_allclose(task.target(-3 * u).values[10:], 9 * y[10:], rtol=1e-12)
    np.testing.assert_allclose(task.target(u[7:]).values[10:], y[17:], rtol=1e-12)
    np.testing.assert_allclose(task.target(np.full(20, 2.0)).values[10:], 4.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"dt": 0.0}, "dt is 0.0"),
        ({"width": -1.0}, "width is -1.0"),
        ({"mean": -0.1}, "mean is -0.1"),
        ({"dt": 0.3}, "support of 0.2 s is shorter than a row of 0.3 s"),
    ],
)
def test_wrong_parameters(parameters, words):
    with pytest.raises(TaskError, match=words):
        VolterraTask(**parameters)


def test_too_short_an_input():
    with pytest.raises(TaskError, match="200 symbols and the task leaves 200"):
        VolterraTask().target(np.zeros(200))
