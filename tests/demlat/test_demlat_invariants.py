"""Conservation, balance, units, determinism."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from openprc.schema.geometry import Bars, Geometry

X, Y, Z = np.eye(3)


def momentum(scene, run):
    m = scene.geometry.masses[:, None]
    return (m * run.v).sum(axis=1), np.cross(run.x, m * run.v).sum(axis=1)


def test_internal_damping_conserves_momentum_and_angular_momentum(lattice, simulate):
    scene = lattice(3, damping=0.05, pinned=False, dt=1e-4)
    run = simulate(scene)
    linear, angular = momentum(scene, run)
    np.testing.assert_allclose(linear - linear[0], 0, atol=1e-14)
    # The scheme keeps linear invariants exactly and quadratic ones to its order.
    np.testing.assert_allclose(angular - angular[0], 0, atol=1e-7 * np.abs(angular[0]).max())
    assert run.dissipated[-1] > 0.1 * run.kinetic[0]


def test_a_spinning_bar_is_not_slowed_by_its_dashpot(body, simulate):
    k, m, omega = 1e3, 1.0, 2.0
    # In steady rotation the spring carries m omega^2 times half the length.
    length = 1.0 / (1 - m * omega**2 / (2 * k))
    scene = body(
        [-length / 2 * X, length / 2 * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 5.0)],
        velocities=[-omega * length / 2 * Y, omega * length / 2 * Y],
        duration=5.0,
    )
    run = simulate(scene)
    speed = np.linalg.norm(run.v, axis=2)
    np.testing.assert_allclose(speed, omega * length / 2, rtol=1e-9)
    assert run.dissipated[-1] < 1e-10 * run.kinetic[0]


def test_hinge_forces_have_no_net_force_or_moment(body, simulate):
    positions = [0 * X, X, [0.4, -0.7, 0.3], [0.6, 0.9, 0.2]]
    scene = body(positions, [0.1] * 4, hinges=[(0, 1, 2, 3, 0.5, 2.5, 0.01)], duration=0.5)
    run = simulate(scene)
    linear, angular = momentum(scene, run)
    np.testing.assert_allclose(linear, 0, atol=1e-14)
    np.testing.assert_allclose(angular, 0, atol=1e-10)
    assert np.abs(run.v).max() > 0.1


@pytest.mark.parametrize("kind", ["force", "position"])
@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_energy_is_accounted_for(lattice, simulate, drive, kind, interpolation):
    scene = lattice(3, damping=0.02)
    values = np.random.default_rng(0).uniform(-1, 1, (21, 3))
    if kind == "position":
        values = scene.geometry.positions[8] + 0.02 * values
    signal, actuator = drive(values, dt=0.05, node=8, type=kind, interpolation=interpolation)
    scene = replace(
        scene,
        signals={"u": signal},
        actuators=(actuator,),
        dt=1e-4,
        damping=0.01,
        gravity=(0.0, 1.0, -9.81),
    )
    run = simulate(scene)
    assert np.ptp(run.work_in) > 1e-3
    assert np.abs(run.balance).max() < 1e-6 * run.dissipated[-1]
    assert (np.diff(run.dissipated) >= 0).all()


def test_nothing_is_gained_over_ten_thousand_periods(body, simulate):
    # Classical RK4 loses (h omega)^6 / 72 of the energy in a step, and never gains any.
    k, m, h = 100.0, 1.0, 0.01
    scene = body(
        [0 * X, 1.01 * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 0)],
        fixed=[True, False],
        duration=6000.0,
        dt=h,
        save_interval=100.0,
    )
    run = simulate(scene)
    energy = (run.kinetic + run.potential) / (run.kinetic + run.potential)[0]
    expected = np.exp(-((h * 10) ** 6) / 72 * 6000 / h)
    assert energy[-1] == pytest.approx(expected, rel=2e-3)


def test_units_can_be_rescaled(lattice, simulate):
    # Lengths times a, masses times b, times times c: the same motion.
    a, b, c = 1e3, 1e-4, 30.0
    scene = lattice(3, damping=0.05, gravity=(0.0, 0.0, -9.81))
    g = scene.geometry
    scaled = replace(
        scene,
        geometry=Geometry(
            positions=a * g.positions,
            masses=b * g.masses,
            fixed=g.fixed,
            velocities=a / c * g.velocities,
            bars=Bars(
                indices=g.bars.indices,
                stiffness=b / c**2 * g.bars.stiffness,
                rest_length=a * g.bars.rest_length,
                damping=b / c * g.bars.damping,
            ),
        ),
        gravity=(0.0, 0.0, -9.81 * a / c**2),
        duration=c * scene.duration,
        dt=c * scene.dt,
        save_interval=c * scene.save_interval,
    )
    one, two = simulate(scene), simulate(scaled)
    np.testing.assert_allclose(two.x / a, one.x, atol=1e-10)
    np.testing.assert_allclose(two.kinetic / (b * a**2 / c**2), one.kinetic, rtol=1e-8, atol=1e-12)


def test_twice_the_same_bits(lattice, simulate):
    scene = lattice(3, damping=0.05)

    def digest(run):
        return hashlib.sha256(run.x.tobytes() + run.v.tobytes() + run.work_in.tobytes()).hexdigest()

    assert digest(simulate(scene)) == digest(simulate(scene))


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "hold"])
def test_a_driven_node_is_where_its_signal_says(lattice, simulate, drive, interpolation):
    from scipy.interpolate import CubicSpline

    scene = lattice(3)
    samples = scene.geometry.positions[8] + 0.01 * np.random.default_rng(2).normal(size=(12, 3))
    signal, actuator = drive(
        samples, dt=0.1, node=8, type="position", interpolation=interpolation, axes=(1, 0, 1)
    )
    scene = replace(scene, signals={"u": signal}, actuators=(actuator,))
    run = simulate(scene)
    knots = 0.1 * np.arange(12)
    if interpolation == "cubic":
        spline = CubicSpline(knots, samples)
        value, rate = spline(run.t), spline(run.t, 1)
    elif interpolation == "linear":
        value = np.stack([np.interp(run.t, knots, column) for column in samples.T], axis=1)
        segment = np.minimum(np.floor(run.t / 0.1 + 1e-9).astype(int), 10)
        rate = (np.diff(samples, axis=0) / 0.1)[segment]
    else:
        value = samples[np.floor(run.t / 0.1 + 1e-9).astype(int)]
        rate = np.zeros_like(value)
    for axis in (0, 2):
        np.testing.assert_allclose(run.x[:, 8, axis], value[:, axis], atol=1e-12)
        np.testing.assert_allclose(run.v[:, 8, axis], rate[:, axis], atol=1e-11)
    # The axis that is not driven is free.
    assert np.abs(run.x[:, 8, 1] - value[:, 1]).max() > 1e-3


def test_the_last_value_stays_after_the_end_of_a_signal(body, simulate, drive):
    signal, actuator = drive([[0, 0, 0], [0.2, 0, 0]], dt=0.5, type="position")
    scene = body([0 * X], [1.0], signals=[signal], actuators=[actuator])
    run = simulate(scene)
    late = run.t >= 0.5
    np.testing.assert_allclose(run.x[late, 0, 0], 0.2, atol=1e-15)
    assert not run.v[late].any()


def test_the_first_frame_is_the_initial_state(lattice, simulate):
    scene = lattice(3)
    run = simulate(scene)
    assert run.t[0] == 0
    np.testing.assert_array_equal(run.x[0], scene.geometry.positions)
    np.testing.assert_array_equal(run.v[0], scene.geometry.velocities)
    assert len(run.t) == 101
