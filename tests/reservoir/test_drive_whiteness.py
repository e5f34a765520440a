"""False alarms on independent drives, and detection of drives that are not."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from openprc.errors import TaskError
from openprc.reservoir.io.whiteness import (
    autocorrelation,
    decorrelation_lag,
    drive_whiteness,
    effective_samples,
)

INDEPENDENT = {
    "uniform": lambda rng, shape: rng.uniform(-1, 1, shape),
    "normal": lambda rng, shape: rng.normal(size=shape),
    "binary": lambda rng, shape: rng.integers(0, 2, shape),
    "rare pulses": lambda rng, shape: (rng.random(shape) < 0.02).astype(float),
    "four levels": lambda rng, shape: rng.choice([-3, -1, 1, 3], shape),
    "exponential": lambda rng, shape: rng.exponential(size=shape),
    "no variance": lambda rng, shape: rng.standard_cauchy(shape),
}


@pytest.mark.parametrize("shape", [(40,), (300,), (1000,), (300, 2)])
@pytest.mark.parametrize("name", INDEPENDENT)
def test_at_most_one_alarm_in_twenty(name, shape):
    rng = np.random.default_rng(17)
    n_trials = 80
    alarms = 0
    for _ in range(n_trials):
        drive = INDEPENDENT[name](rng, shape)
        alarms += np.ptp(drive) > 0 and not drive_whiteness(drive).white
    # Three standard deviations above a rate of 5 % would be 10 of 80.
    assert alarms <= 4


def first_order(rng, n, phi):
    noise = rng.normal(size=n + 200)
    x = np.zeros(n + 200)
    for t in range(1, n + 200):
        x[t] = phi * x[t - 1] + noise[t]
    return x[200:]


@pytest.mark.parametrize(("n", "phi"), [(100, 0.9), (300, 0.5), (1000, 0.3), (1000, -0.3)])
def test_a_process_of_first_order_is_found(n, phi):
    rng = np.random.default_rng(3)
    found = [drive_whiteness(first_order(rng, n, phi)) for _ in range(20)]
    assert not any(w.white for w in found)
    assert all(w.lag <= 2 for w in found)


def test_correlation_and_count_of_a_process_of_first_order():
    """Correlation 0.9 at lag 1; n (1 - phi) / (1 + phi) values for the mean."""
    found = drive_whiteness(first_order(np.random.default_rng(5), 50_000, 0.9))
    assert found.max_autocorrelation == pytest.approx(0.9, abs=0.01)
    assert found.lag == 1
    assert found.n_effective == pytest.approx(50_000 * 0.1 / 1.9, rel=0.1)
    assert found.sentence.startswith("autocorrelation 0.899 at lag 1 (p < 1e-12); 50000 values")


def test_product_of_sines_of_the_robotics_literature():
    t = np.arange(5000) * 1e-3
    drive = np.prod([np.sin(2 * np.pi * f * t) for f in (2.11, 3.73, 4.33)], axis=0)
    found = drive_whiteness(0.2 * drive)
    assert not found.white
    assert found.max_autocorrelation > 0.99
    assert found.n_effective < 150


def test_independent_symbols_joined_by_a_spline():
    """White symbol by symbol, and not white frame by frame."""
    symbols = np.random.default_rng(2).uniform(-1, 1, 300)
    frames = CubicSpline(33 * np.arange(300), symbols)(np.arange(33 * 299 + 1))
    assert drive_whiteness(symbols).white
    assert drive_whiteness(frames[::33]).white
    found = drive_whiteness(frames)
    assert not found.white
    assert found.max_autocorrelation > 0.99
    assert 100 < found.n_effective < 900


def test_held_symbols_count_once():
    symbols = np.random.default_rng(8).normal(size=4000)
    assert effective_samples(np.repeat(symbols, 10)) == pytest.approx(4000, rel=0.1)


def test_a_late_echo_is_found():
    rng = np.random.default_rng(4)
    noise = rng.uniform(-1, 1, 800)
    echo = noise + 0.7 * np.concatenate([np.zeros(37), noise[:-37]])
    found = drive_whiteness(echo)
    assert (found.white, found.lag, found.kind) == (False, 37, "values")
    assert drive_whiteness(echo, max_lag=36).white


def test_columns_that_repeat_each_other():
    rng = np.random.default_rng(6)
    a, b = rng.uniform(-1, 1, (2, 500))
    assert drive_whiteness(np.stack([a, b], axis=1)).white
    at_once = drive_whiteness(np.stack([a, 0.5 * a + b], axis=1))
    assert (at_once.white, at_once.lag, at_once.kind) == (False, 0, "columns")
    assert at_once.sentence.startswith("correlation 0.4")
    later = drive_whiteness(np.stack([a, np.roll(a, 5)], axis=1))
    assert (later.white, later.lag, later.kind) == (False, 5, "columns")
    assert later.max_autocorrelation > 0.99


def test_a_chaotic_map_is_uncorrelated_and_not_independent():
    x = np.empty(1000)
    x[0] = 0.3123
    for k in range(999):
        x[k + 1] = 4.0 * x[k] * (1.0 - x[k])
    found = drive_whiteness(x)
    assert abs(found.max_autocorrelation) < 0.1
    assert (found.white, found.kind, found.lag) == (False, "squares", 1)
    assert found.sentence.startswith("no autocorrelation, but the values depend on the squares 1")


def test_white_is_said_with_its_reach():
    found = drive_whiteness(np.random.default_rng(1).normal(size=200))
    assert found.sentence == "no dependence beyond chance among 200 values, to lag 50"
    assert found.n_effective == 200
    assert found.p_value > 0.05


def test_a_constant_column_does_not_matter():
    u = np.random.default_rng(1).normal(size=(200, 2))
    u[:, 0] = 3.0
    assert drive_whiteness(u) == drive_whiteness(u[:, 1])


def test_autocorrelation_of_few_values():
    """1 2 3: deviations -1 0 1, products 2, 0, -1."""
    np.testing.assert_allclose(autocorrelation(np.array([1.0, 2.0, 3.0])), [1, 0, -0.5], atol=1e-15)
    assert autocorrelation(np.ones(4)).tolist() == [1, 0, 0, 0]
    assert decorrelation_lag(np.cos(2 * np.pi * np.arange(400) / 40)) == 10
    assert decorrelation_lag(np.array([1.0, 1.0])) == 1


@pytest.mark.parametrize(
    ("u", "keywords", "words"),
    [
        (np.zeros(50), {}, "the drive does not vary"),
        (np.arange(5.0), {}, "the drive has shape \\(5,\\)"),
        (np.zeros((20, 2, 2)), {}, "the drive has shape"),
        (np.append(np.arange(20.0), np.nan), {}, "1 values are NaN or infinite"),
        (np.arange(20.0), {"max_lag": 19}, "max_lag is 19"),
        (np.arange(20.0), {"max_lag": 0}, "max_lag is 0"),
    ],
)
def test_what_cannot_be_tested(u, keywords, words):
    with pytest.raises(TaskError, match=words):
        drive_whiteness(u, **keywords)
