"""The engine against closed-form solutions."""

import numpy as np
import pytest

X, Y, Z = np.eye(3)


def angular_frequency(t, signal):
    """Fit the frequency of a sinusoid to its zero crossings, by local interpolation."""
    sign = np.flatnonzero(np.diff(np.signbit(signal)))
    crossings = []
    for i in sign:
        lo = max(i - 2, 0)
        local = np.polynomial.Polynomial.fit(signal[lo : lo + 6], t[lo : lo + 6], 5)
        crossings.append(local(0.0))
    return np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])


def test_fixed_free_bar_oscillates_at_sqrt_k_over_m(body, simulate):
    k, m, a = 40.0, 0.1, 1e-3
    scene = body([0 * X, (1 + a) * X], [m, m], bars=[(0, 1, k, 1.0, 0)], fixed=[True, False])
    run = simulate(scene)
    exact = 1 + a * np.cos(np.sqrt(k / m) * run.t)
    np.testing.assert_allclose(run.x[:, 1, 0], exact, atol=1e-10)
    np.testing.assert_allclose(run.kinetic + run.potential, 0.5 * k * a**2, rtol=1e-7)


def test_two_masses_oscillate_at_the_reduced_mass(body, simulate):
    k, m1, m2, a = 40.0, 0.1, 0.3, 1e-3
    scene = body([0 * X, (1 + a) * X], [m1, m2], bars=[(0, 1, k, 1.0, 0)])
    run = simulate(scene)
    length = run.x[:, 1, 0] - run.x[:, 0, 0]
    omega = np.sqrt(k * (1 / m1 + 1 / m2))
    np.testing.assert_allclose(length, 1 + a * np.cos(omega * run.t), atol=1e-10)


def test_damped_bar_has_the_exact_logarithmic_decrement(body, simulate):
    k, m, a, zeta = 40.0, 0.1, 1e-3, 0.05
    c = 2 * zeta * np.sqrt(k * m)
    scene = body([0 * X, (1 + a) * X], [m, m], bars=[(0, 1, k, 1.0, c)], fixed=[True, False])
    run = simulate(scene)
    omega = np.sqrt(k / m)
    damped = omega * np.sqrt(1 - zeta**2)
    envelope = np.exp(-zeta * omega * run.t)
    exact = a * envelope * (np.cos(damped * run.t) + zeta * omega / damped * np.sin(damped * run.t))
    np.testing.assert_allclose(run.x[:, 1, 0] - 1, exact, atol=1e-10)


def test_global_damping_is_a_rate_of_damping_over_the_mean_mass(body, simulate):
    # The meaning that the older files have: 0.8 with masses around 0.01 decays at 80 / s.
    masses = np.array([0.005, 0.015])
    scene = body([0 * X, X], masses, velocities=[X, 2 * Y], damping=0.8, duration=0.1, dt=1e-4)
    run = simulate(scene)
    decay = np.exp(-0.8 / masses.mean() * run.t)
    np.testing.assert_allclose(run.v[:, 0, 0], decay, rtol=2e-8)
    np.testing.assert_allclose(run.v[:, 1, 1], 2 * decay, rtol=2e-8)


def test_free_fall_is_exact_in_any_direction(body, simulate):
    g = np.array([1.0, -2.0, -9.81])
    scene = body([0 * X], [0.3], velocities=[X], gravity=tuple(g), damping=0.0)
    run = simulate(scene)
    exact = X * run.t[:, None] + 0.5 * g * run.t[:, None] ** 2
    np.testing.assert_allclose(run.x[:, 0], exact, atol=1e-12)
    np.testing.assert_allclose(run.balance, 0, atol=1e-12)


def test_von_mises_truss_vibrates_at_its_closed_form_frequency(body, simulate):
    # Small vibration of a shallow two-bar truss: omega = sqrt(2 k / m) h / L0.
    b, h, k, m = 1.0, 0.3, 100.0, 1.0
    l0 = np.hypot(b, h)
    scene = body(
        [-b * X, b * X, (h + 1e-5) * Z],
        [m] * 3,
        bars=[(0, 2, k, l0, 0), (1, 2, k, l0, 0)],
        fixed=[True, True, False],
        duration=20.0,
        dt=2e-3,
    )
    run = simulate(scene)
    omega = angular_frequency(run.t, run.x[:, 2, 2] - h)
    assert omega == pytest.approx(4.063713, rel=3e-5)


@pytest.mark.parametrize(("share", "snaps"), [(0.95, False), (1.05, True)])
def test_von_mises_truss_snaps_above_its_energy_barrier(body, simulate, share, snaps):
    # The barrier between z = h and z = -h is k (L0 - b)^2.
    b, h, k, m = 1.0, 0.3, 100.0, 1.0
    l0 = np.hypot(b, h)
    speed = np.sqrt(2 * share * k * (l0 - b) ** 2 / m)
    scene = body(
        [-b * X, b * X, h * Z],
        [m] * 3,
        bars=[(0, 2, k, l0, 0), (1, 2, k, l0, 0)],
        fixed=[True, True, False],
        velocities=[0 * Z, 0 * Z, -speed * Z],
        duration=3.0,
    )
    assert (simulate(scene).x[:, 2, 2].min() < 0) == snaps


def test_prestress_shifts_the_relaxed_length(body, simulate):
    # Relaxed at l0 (1 + p): released at l0, the free end swings about l0 (1 + p).
    k, m, p = 40.0, 0.1, -0.02
    scene = body([0 * X, X], [m, m], bars=[(0, 1, k, 1.0, 0)], fixed=[True, False], prestress=[p])
    run = simulate(scene)
    exact = (1 + p) - p * np.cos(np.sqrt(k / m) * run.t)
    np.testing.assert_allclose(run.x[:, 1, 0], exact, atol=1e-8)


def test_force_ramp_on_a_free_mass(body, simulate, drive):
    # F = r t gives x = r t^3 / 6 m; the scheme is exact for cubics.
    m, rate = 0.2, 3.0
    signal, actuator = drive([[0, 0, 0], [rate, 0, -rate]], dt=1.0)
    scene = body([0 * X], [m], signals=[signal], actuators=[actuator])
    run = simulate(scene)
    exact = rate * run.t**3 / (6 * m)
    np.testing.assert_allclose(run.x[:, 0, 0], exact, atol=1e-13)
    np.testing.assert_allclose(run.x[:, 0, 2], -exact, atol=1e-13)
    assert not run.x[:, 0, 1].any()


def test_held_force_switches_without_an_error(body, simulate, drive):
    # Symbols of 0.1 s switch on a step's edge: every stretch is a parabola.
    symbols = np.array([1.0, -2.0, 0.5, 0.0, 3.0])
    signal, actuator = drive(symbols, dt=0.1, interpolation="hold", axes=(1, 0, 0))
    scene = body([0 * X], [0.5], signals=[signal], actuators=[actuator], duration=0.5)
    run = simulate(scene)
    x = v = 0.0
    for n, a in enumerate(symbols / 0.5):
        tau = run.t[: 10 + 1][None]
        part = run.x[10 * n : 10 * n + 11, 0, 0]
        np.testing.assert_allclose(part, (x + v * tau + a * tau**2 / 2)[0], atol=1e-13)
        x, v = x + v * 0.1 + a * 0.005, v + a * 0.1


def test_several_forces_on_a_node_add_up_and_masks_hold(body, simulate, drive):
    one, first = drive([2.0], dt=1.0, name="one", axes=(1, 0, 0), interpolation="hold")
    two, second = drive([3.0], dt=1.0, name="two", axes=(1, 1, 0), interpolation="hold")
    scene = body([0 * X], [1.0], signals=[one, two], actuators=[first, second])
    end = simulate(scene).x[-1, 0]
    np.testing.assert_allclose(end, [2.5, 1.5, 0.0], atol=1e-12)


def test_hinge_wing_oscillates_at_sqrt_k_over_m_over_h(body, simulate):
    # Crease and one wing fixed, the other wing on stiff bars at height h over the crease.
    k, m, h, a = 0.05, 0.01, 0.8, 1e-3
    wing = [0.5, h * np.cos(a), h * np.sin(a)]
    side = np.hypot(0.5, h)
    scene = body(
        [0 * X, X, [0.5, -h, 0], wing],
        [m] * 4,
        bars=[(0, 3, 1e4, side, 0), (1, 3, 1e4, side, 0)],
        hinges=[(0, 1, 2, 3, k, np.pi, 0)],
        fixed=[True, True, True, False],
        duration=20.0,
        dt=5e-4,
        save_interval=0.02,
    )
    run = simulate(scene)
    assert angular_frequency(run.t, run.x[:, 3, 2]) == pytest.approx(2.79508, rel=1e-5)


def test_free_hinge_oscillates_at_two_over_h_sqrt_k_over_m(body, simulate):
    # Four equal masses, two mirror triangles: omega = (2 / h) sqrt(k / m).
    k, m, h, a = 0.05, 0.01, 0.8, 1e-3
    wings = [[0.5, -h, a], [0.5, h, a]]
    side = np.hypot(0.5, h)
    pairs = [(0, 1, 1.0), (0, 2, side), (1, 2, side), (0, 3, side), (1, 3, side)]
    scene = body(
        [0 * X, X, *wings],
        [m] * 4,
        bars=[(i, j, 1e4, length, 0) for i, j, length in pairs],
        hinges=[(0, 1, 2, 3, k, np.pi, 0)],
        duration=10.0,
        dt=5e-4,
        save_interval=0.01,
    )
    run = simulate(scene)
    fold = run.x[:, 2, 2] + run.x[:, 3, 2] - run.x[:, 0, 2] - run.x[:, 1, 2]
    assert angular_frequency(run.t, fold) == pytest.approx(5.59017, rel=1e-4)


def test_hinge_pendulum_has_the_frequency_of_a_pendulum(body, simulate):
    # No hinge stiffness: a wing hanging from the crease, omega = sqrt(g / h) (1 - a^2 / 16).
    g, h, a = 9.81, 0.8, 0.05
    wing = [0.5, h * np.sin(a), -h * np.cos(a)]
    side = np.hypot(0.5, h)
    scene = body(
        [0 * X, X, [0.5, -h, 0], wing],
        [0.01] * 4,
        bars=[(0, 3, 1e4, side, 0), (1, 3, 1e4, side, 0)],
        hinges=[(0, 1, 2, 3, 0.0, np.pi, 0)],
        fixed=[True, True, True, False],
        gravity=(0.0, 0.0, -g),
        duration=20.0,
        dt=5e-4,
        save_interval=0.02,
    )
    run = simulate(scene)
    expected = np.sqrt(g / h) * (1 - a**2 / 16)
    assert angular_frequency(run.t, run.x[:, 3, 1]) == pytest.approx(expected, rel=2e-5)


def test_hinge_damping_gives_the_exact_decrement(body, simulate):
    # Torsional oscillator: I = m h^2, damping ratio c / (2 sqrt(k I)).
    k, m, h, a, zeta = 0.05, 0.01, 0.8, 1e-3, 0.05
    c = 2 * zeta * np.sqrt(k * m * h**2)
    side = np.hypot(0.5, h)
    scene = body(
        [0 * X, X, [0.5, -h, 0], [0.5, h * np.cos(a), h * np.sin(a)]],
        [m] * 4,
        bars=[(0, 3, 1e4, side, 0), (1, 3, 1e4, side, 0)],
        hinges=[(0, 1, 2, 3, k, np.pi, c)],
        fixed=[True, True, True, False],
        duration=5.0,
        dt=5e-4,
    )
    run = simulate(scene)
    omega = np.sqrt(k / m) / h
    damped = omega * np.sqrt(1 - zeta**2)
    angle = np.arctan2(run.x[:, 3, 2], run.x[:, 3, 1])
    exact = a * np.exp(-zeta * omega * run.t)
    exact = exact * (np.cos(damped * run.t) + zeta * omega / damped * np.sin(damped * run.t))
    np.testing.assert_allclose(angle, exact, atol=2e-4 * a)
