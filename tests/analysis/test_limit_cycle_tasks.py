"""Limit cycles against their closed forms, and the measures that compare them."""

import numpy as np
import pytest

from openprc.analysis.tasks import (
    LissajousTask,
    QuadraticLimitCycleTask,
    VanDerPolTask,
    compare_cycles,
    cycle_period,
    orbit_distance,
)
from openprc.errors import TaskError


def test_quadratic_limit_cycle_is_exact():
    """With epsilon 1 the direction turns linearly and the radius follows Bernoulli's equation."""
    x = QuadraticLimitCycleTask().trajectory(400, 0.05)
    w = np.sqrt(2.0)
    # Where the angle variable of the linear part is, from the ratio of the coordinates.
    turn = np.arctan2(-x[:, 1] / w, x[:, 0])
    rest = 1.5 - (np.cos(2 * turn) + w * np.sin(2 * turn)) / 6.0
    exact = np.stack([np.cos(turn), -w * np.sin(turn)], axis=1) / np.sqrt(rest)[:, None]
    np.testing.assert_allclose(x, exact, atol=1e-8)
    np.testing.assert_allclose(np.unwrap(turn), turn[0] + w * 0.05 * np.arange(400), atol=1e-7)


def test_van_der_pol_period_and_amplitude():
    x = VanDerPolTask().trajectory(4000, 0.01)
    assert cycle_period(x, dt=0.01) == pytest.approx(6.663287, abs=1e-5)
    assert np.abs(x[:, 0]).max() == pytest.approx(2.00862, abs=1e-4)
    np.testing.assert_allclose(np.gradient(x[:, 0], 0.01)[1:-1], x[1:-1, 1], atol=1e-3)


def test_weak_van_der_pol():
    x = VanDerPolTask(mu=0.1).trajectory(3000, 0.02)
    assert cycle_period(x, dt=0.02) == pytest.approx(2 * np.pi * (1 + 0.01 / 16), rel=1e-5)
    assert np.abs(x[:, 0]).max() == pytest.approx(2.0, abs=1e-3)


def test_time_scale():
    slow = QuadraticLimitCycleTask(time_scale=0.5).trajectory(50, 0.05)
    fast = QuadraticLimitCycleTask().trajectory(50, 0.1)
    np.testing.assert_allclose(slow, fast, atol=1e-12)
    changed = QuadraticLimitCycleTask(epsilon=0.5).trajectory(500, 0.02)
    assert np.ptp(changed[:, 0]) > 1.1 * np.ptp(fast[:, 0])


def test_lissajous():
    x = LissajousTask(period=2.0).trajectory(201, 0.01)
    t = 0.01 * np.arange(201)
    exact = np.stack([np.sin(np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    np.testing.assert_allclose(x, exact, atol=1e-13)
    np.testing.assert_allclose(x[0], x[200], atol=1e-12)
    assert LissajousTask(phase=np.pi / 2).trajectory(1, 0.1)[0, 0] == 1.0


def test_teacher_is_one_step_ahead():
    data = LissajousTask().teacher(50, 0.01)
    np.testing.assert_array_equal(data.input[1:], data.target.values[:-1])
    assert data.input.shape == data.target.values.shape == (50, 2)
    assert data.metadata["dt"] == 0.01
    assert data.metadata["kind"] == "generation"


@pytest.mark.parametrize("dt", [0.013, 0.1])
@pytest.mark.parametrize("ratio", [(1, 2), (3, 4), (2, 1)])
def test_period_of_a_curve_that_crosses_itself(ratio, dt):
    x = LissajousTask(ratio=ratio, period=2.7).trajectory(1000, dt)
    assert cycle_period(x, dt=dt) == pytest.approx(2.7, rel=1e-4)


def test_period_in_noise():
    x = VanDerPolTask().trajectory(3000, 0.05)
    noisy = x + 0.1 * np.random.default_rng(0).normal(size=x.shape)
    assert cycle_period(noisy, dt=0.05) == pytest.approx(6.66329, rel=2e-3)


def test_comparison_ignores_phase_and_length():
    task = QuadraticLimitCycleTask()
    x = task.trajectory(3000, 0.01)
    seen = compare_cycles(x[700:2500], x[:2000], dt=0.01)
    assert seen.period == pytest.approx(np.sqrt(2) * np.pi, rel=1e-5)
    assert abs(seen.period_error) < 1e-5
    np.testing.assert_allclose(seen.amplitude_error, 0.0, atol=1e-3)
    assert seen.distance < 1e-3


def test_comparison_of_a_larger_and_slower_circle():
    t = np.arange(2000) * 0.01
    circle = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    slow = 1.2 * np.stack([np.cos(1.6 * np.pi * t), np.sin(1.6 * np.pi * t)], axis=1)
    seen = compare_cycles(slow, circle, dt=0.01)
    assert seen.period_error == pytest.approx(0.25, abs=1e-5)
    assert seen.amplitude_error == pytest.approx([0.2, 0.2], abs=2e-3)
    assert seen.distance == pytest.approx(0.2, abs=1e-3)


def test_distance_to_a_point_is_one():
    t = np.linspace(0, 2 * np.pi, 500)
    circle = np.stack([np.cos(t), np.sin(t)], axis=1)
    assert orbit_distance(np.zeros((10, 2)), circle) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda x: cycle_period(np.exp(-0.1 * np.arange(300.0)), dt=1.0), "does not repeat itself"),
        (lambda x: cycle_period(x[:600], dt=0.01), "does not repeat itself"),
        (lambda x: cycle_period(np.ones((99, 2)), dt=0.01), "coordinate 0 does not move"),
        (lambda x: cycle_period(x[:7], dt=0.01), "shape \\(7, 2\\)"),
        (lambda x: cycle_period(np.full(99, np.nan), dt=0.01), "holds NaN"),
        (lambda x: compare_cycles(x, x[:, :1], dt=0.01), "2 coordinates beside 1"),
        (lambda x: orbit_distance(x, np.zeros((9, 2))), "coordinate 0 does not move"),
    ],
)
def test_what_is_no_cycle(call, words):
    x = QuadraticLimitCycleTask().trajectory(1000, 0.01)
    with pytest.raises(TaskError, match=words):
        call(x)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: VanDerPolTask(mu=0.0), "mu is 0.0"),
        (lambda: VanDerPolTask(time_scale=-1.0), "time_scale is -1.0"),
        (lambda: QuadraticLimitCycleTask(epsilon=0.0), "epsilon is 0.0"),
        (lambda: LissajousTask(ratio=(2, 4)), "ratio is 2 to 4"),
        (lambda: LissajousTask(ratio=(1,)), "two whole numbers"),
        (lambda: LissajousTask(ratio=(0, 1)), "ratio is 0"),
        (lambda: LissajousTask(period=0.0), "period is 0.0"),
        (lambda: VanDerPolTask().trajectory(5, 0.0), "dt is 0.0"),
        (lambda: LissajousTask().teacher(0, 0.1), "n is 0"),
    ],
)
def test_wrong_parameters(call, words):
    with pytest.raises(TaskError, match=words):
        call()
