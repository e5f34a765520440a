"""Mackey-Glass, Lorenz and Henon against closed forms and published figures."""

import numpy as np
import pytest

from openprc.analysis.tasks import Henon, Lorenz, MackeyGlass
from openprc.analysis.tasks.runge_kutta import rk4_step
from openprc.errors import Diverged, TaskError


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_mackey_glass_during_the_first_delay(step):
    """While the delayed value is the constant history, x relaxes exponentially."""
    x = MackeyGlass(step=step).integrate(int(17 / step), history=1.2)
    t = step * np.arange(len(x))
    rest = 0.2 * 1.2 / (1 + 1.2**10) / 0.1
    np.testing.assert_allclose(x, rest + (1.2 - rest) * np.exp(-0.1 * t), atol=2e-7 * step**4)


def test_mackey_glass_is_of_fourth_order():
    """Over three delays, where interpolation between steps counts."""
    ends = [
        MackeyGlass(step=h, sampling=1.0).integrate(round(51 / h), history=1.2)[-1]
        for h in (0.5, 0.25, 0.125, 0.03125)
    ]
    errors = np.abs(np.array(ends[:3]) - ends[3])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders == pytest.approx(4.0, abs=0.35)


def test_mackey_glass_statistics():
    x = MackeyGlass().series(20_000)
    assert x.shape == (20_000, 1)
    assert x.mean() == pytest.approx(0.9302, abs=0.001)
    assert x.std() == pytest.approx(0.2261, abs=0.001)
    assert x.min() == pytest.approx(0.4170, abs=0.001)
    assert x.max() == pytest.approx(1.3198, abs=0.001)


def test_mackey_glass_fixed_point():
    """beta / (1 + x^n) = gamma at x = 1, which stays where it is."""
    x = MackeyGlass(history=1.0).integrate(100, history=1.0)
    np.testing.assert_allclose(x, 1.0, atol=1e-13)


def test_lorenz_lyapunov_exponent():
    """Growth of small differences along 400 trajectories; 0.9056 is Sprott's figure."""
    system, h = Lorenz(), 0.02
    rng = np.random.default_rng(0)
    start = Lorenz(columns=("x", "y", "z"), sampling=1.0).series(400)

    def rates(x, y, z, a, b, c):
        return (
            *system.rates(x, y, z),
            10.0 * (b - a),
            a * (28.0 - z) - b - x * c,
            a * y + x * b - 8.0 / 3.0 * c,
        )

    state = (*start.T, *rng.normal(size=(3, 400)))
    growth = 0.0
    for step in range(3000):
        state = rk4_step(rates, state, h)
        if step % 10 == 9:
            size = np.sqrt(sum(part**2 for part in state[3:]))
            state = (*state[:3], *(part / size for part in state[3:]))
            # The first steps turn the differences into the direction of growth.
            growth += np.log(size).mean() if step >= 500 else 0.0
    assert growth / (2500 * h) == pytest.approx(0.9056, rel=0.02)


def test_lorenz_fixed_points_and_symmetry():
    c = np.sqrt(8 / 3 * 27)
    system = Lorenz()
    assert system.rates(c, c, 27.0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert system.rates(-1.0, -2.0, 3.0)[:2] == tuple(-r for r in system.rates(1.0, 2.0, 3.0)[:2])


def test_lorenz_sampling_keeps_the_trajectory():
    fine = Lorenz(columns=("x", "z"), transient=1.0, sampling=0.01).series(21)
    coarse = Lorenz(columns=("x", "z"), transient=1.0, sampling=0.02).series(11)
    np.testing.assert_allclose(fine[::2], coarse, rtol=1e-9)


def test_henon_recursion_and_lyapunov_exponent():
    x = Henon().series(20_000)[:, 0]
    np.testing.assert_allclose(x[2:], 1 - 1.4 * x[1:-1] ** 2 + 0.3 * x[:-2], atol=1e-14)
    before, now, growth = 0.0, 1.0, 0.0
    for value in x[:-1]:
        before, now = now, -2.8 * value * now + 0.3 * before
        size = np.hypot(before, now)
        before, now, growth = before / size, now / size, growth + np.log(size)
    assert growth / (len(x) - 1) == pytest.approx(0.419, rel=0.02)


def test_henon_fixed_point():
    x = (-0.7 + np.sqrt(0.49 + 5.6)) / 2.8
    assert 1 - 1.4 * x**2 + 0.3 * x == pytest.approx(x, abs=1e-14)
    start = Henon(transient=0).series(3)[:, 0]
    assert start == pytest.approx([1.0, -0.4, 1 - 1.4 * 0.16 + 0.3])


@pytest.mark.parametrize("system", [MackeyGlass(transient=50), Lorenz(transient=5), Henon()])
def test_the_start_is_drawn_and_repeatable(system):
    fixed = system.series(50)
    np.testing.assert_array_equal(fixed, system.series(50))
    drawn = system.series(50, rng=1)
    np.testing.assert_array_equal(drawn, system.series(50, rng=np.random.default_rng(1)))
    assert np.abs(drawn - fixed).max() > 1e-3
    assert np.abs(drawn - system.series(50, rng=2)).max() > 1e-3


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: MackeyGlass(tau=17.05), "tau is 17.05 and the step 0.1"),
        (lambda: MackeyGlass(sampling=0.05), "sampling is 0.05 and the step 0.1"),
        (lambda: MackeyGlass(tau=0), "tau is 0\n.*above 0"),
        (lambda: MackeyGlass(transient=-1), "transient is -1"),
        (lambda: Lorenz(sigma=np.inf), "sigma is inf"),
        (lambda: Lorenz(columns=("u",)), "the columns are \\('u',\\)"),
        (lambda: Lorenz(columns=()), "the columns are \\(\\)"),
        (lambda: Henon(transient=-1), "transient is -1"),
        (lambda: Henon().series(0), "n is 0"),
        (lambda: Lorenz().series(5, rng=1.5), "rng is 1.5"),
    ],
)
def test_wrong_parameters(make, words):
    with pytest.raises(TaskError, match=words):
        make()


def test_henon_without_attractor():
    with pytest.raises(Diverged, match="the Henon map left its attractor at step"):
        Henon(a=2.0).series(200)
