"""Rigid bars and hinges: derivatives, projections, multipliers."""

import numpy as np
import pytest
from rigid_bodies import (
    BODIES,
    chain,
    cloud,
    constraints,
    dihedral,
    gauss_seidel,
    make,
    miura,
    moved,
)

from openprc.demlat import observables
from openprc.demlat.linear import PIVOT_TOLERANCE

# --- values and derivatives -------------------------------------------------------------------


def test_values_are_lengths_and_angles_less_those_at_rest():
    body = cloud()
    rng = np.random.default_rng(1)
    x = body.geometry.positions + 1e-5 * rng.normal(size=(9, 3))
    geometry, rows = body.geometry, body.system
    stretch = observables.bar_lengths(x[None], geometry.bars)[0] - geometry.bars.rest_length
    turn = observables.hinge_angles(x[None], geometry.hinges)[0] - geometry.hinges.rest_angle
    expected = np.concatenate([stretch[rows.bars], turn[rows.hinges]])
    np.testing.assert_allclose(body.values(body.flat(x)), expected, rtol=0, atol=3e-9)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_and_second_rates_are_differences_of_the_values(seed):
    body = cloud(seed)
    rng = np.random.default_rng(seed)
    x, v = body.x, body.flat(rng.normal(size=(9, 3)))
    step = 1e-5
    ahead, back = body.jacobian(x + step * v), body.jacobian(x - step * v)
    slope = (body.values(x + step * v) - body.values(x - step * v)) / (2 * step)
    exact = body.jacobian(x)
    np.testing.assert_allclose(exact @ v, slope, rtol=0, atol=1e-8 * np.abs(exact @ v).max())
    out = np.zeros(body.system.n_rows)
    constraints.second_rates(x, v, body.system.table, out)
    second = (ahead - back) @ v / (2 * step)
    np.testing.assert_allclose(out, second, rtol=0, atol=1e-7 * np.abs(out).max())


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.4, np.pi / 2, 3.0, np.pi])
def test_hinge_derivatives_are_regular_from_shut_to_flat(angle):
    body = dihedral(angle, hinges=[(0, 1, 2, 3)])
    rng = np.random.default_rng(0)
    x, v = body.x, body.flat(rng.normal(size=(4, 3)))
    exact = observables.hinge_gradients(body.geometry.positions[None], np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(body.jacobian(x)[0], body.flat(exact[0, 0]), atol=1e-13)
    out = np.zeros(1)
    constraints.second_rates(x, v, body.system.table, out)
    step = 1e-5
    second = (body.jacobian(x + step * v) - body.jacobian(x - step * v)) @ v / (2 * step)
    assert out[0] == pytest.approx(second[0], rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("amount", [1e-12, 1e-6, 1e-3])
def test_a_hinge_that_is_nearly_flat_is_seen_exactly(amount):
    body = dihedral(np.pi, hinges=[(0, 1, 2, 3)])
    x = body.geometry.positions.copy()
    x[3] = [0.6, -0.7 * np.cos(amount), 0.7 * np.sin(amount)]
    assert abs(body.values(body.flat(x))[0]) == pytest.approx(amount, rel=1e-9, abs=2e-16)


# --- projections ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BODIES)
def test_positions_are_projected_to_rounding_along_the_given_directions(name):
    body = BODIES[name]()
    start = moved(body, 1e-3)
    x = start.copy()
    iterations, residual = body.project(x, reference=body.x)
    assert residual <= 1e-13
    assert iterations <= 12
    # The move is M^-1 G' times the multipliers, with the gradients of the reference.
    gradient = body.jacobian(body.x)
    move = body.inverse_mass * (gradient.T @ body.system.work.multiplier)
    np.testing.assert_allclose(x - start, move, rtol=0, atol=1e-14 * np.abs(x).max())
    held = body.flat(body.held) != 0
    np.testing.assert_array_equal(x[held], start[held])


@pytest.mark.parametrize("name", BODIES)
def test_newton_and_gauss_seidel_agree_to_second_order_of_the_gap(name):
    body = BODIES[name]()
    apart = []
    for amount in (1e-3, 5e-4):
        direct, swept = moved(body, amount), moved(body, amount)
        assert body.project(direct)[1] <= 1e-12
        assert body.sweep(swept)[1] <= 1e-12
        apart.append(np.abs(direct - swept).max())
    assert apart[0] < 1e-2 * np.abs(direct - moved(body, amount)).max()
    if name != "pendulum":  # one bar: the two are the same
        assert apart[0] / apart[1] > 3.0


def test_large_gaps_take_few_newton_steps():
    body = miura()
    x = moved(body, 0.1)
    iterations, residual = constraints.newton_positions(
        x, body.inverse_mass, *body.tail, body.system.factor, PIVOT_TOLERANCE, 1e-13, 20
    )
    assert residual <= 1e-13
    assert iterations <= 6


def test_projections_leave_momentum_and_angular_momentum():
    body = cloud()
    mass = body.geometry.masses
    start = moved(body, 0.02)
    for project in (lambda x: body.project(x, reference=start), body.sweep):
        x = start.copy()
        project(x)
        change = mass[:, None] * body.columns(x - start)
        assert np.abs(change).max() > 1e-4
        np.testing.assert_allclose(change.sum(axis=0), 0.0, atol=1e-13)
    x = start.copy()
    body.project(x, reference=start)
    turned = np.cross(body.columns(start), mass[:, None] * body.columns(x - start)).sum(axis=0)
    np.testing.assert_allclose(turned, 0.0, atol=1e-13)


def test_a_projection_that_cannot_converge_says_so():
    body = chain(2, fixed=(0, 2))
    x = body.x
    x[2] += 0.05  # the held end is out of reach
    assert body.project(x, max_iterations=30)[1] > 1e-3
    x[1] = np.nan
    assert np.isnan(body.project(x)[1])
    assert np.isnan(body.sweep(x)[1])


@pytest.mark.parametrize("name", BODIES)
def test_velocities_are_projected_and_both_ways_agree(name):
    body = BODIES[name]()
    rng = np.random.default_rng(3)
    start = body.flat(np.where(body.held, 0.0, rng.normal(size=body.held.shape)))
    v = start.copy()
    residual = body.project_velocities(body.x, v)[1]
    gradient = body.jacobian(body.x)
    assert residual < 1e-14
    np.testing.assert_allclose(gradient @ v, 0.0, atol=1e-12 * np.abs(gradient).max())
    impulse = start.copy()
    constraints.push(impulse, body.system.work.multiplier, 1.0, *body.tail)
    np.testing.assert_allclose(impulse, v, rtol=0, atol=1e-13)
    swept = start.copy()
    gauss_seidel.gauss_seidel_velocities(
        body.x, swept, body.inverse_mass, *body.tail, 1e-15, 20_000
    )
    np.testing.assert_allclose(swept, v, rtol=0, atol=1e-9)


def test_driven_nodes_pull_the_others_along():
    held = np.zeros((3, 3), dtype=bool)
    held[0] = True
    body = make([[0, 0, 0], [1, 0, 0], [1, 1, 0]], bars=[(0, 1), (1, 2)], held=held)
    v = body.flat([[2.0, 5.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    body.project_velocities(body.x, v)
    expected = [[2.0, 5.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(body.columns(v), expected, atol=1e-15)
    x = body.x
    x[0] -= 0.01  # and in position
    assert body.project(x)[1] < 1e-14
    assert body.columns(x)[0, 0] == -0.01


def test_flat_rigid_hinge_is_brought_back_flat():
    body = dihedral(np.pi, bars=[(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)], hinges=[(0, 1, 2, 3)])
    x = body.geometry.positions.copy()
    x[3] = [0.6, -0.7 * np.cos(1e-3), 0.7 * np.sin(1e-3)]
    for project in (body.project, body.sweep):
        y = body.flat(x)
        assert project(y)[1] <= 1e-13
        assert abs(body.values(y)[-1]) <= 1e-13


# --- multipliers ------------------------------------------------------------------------------


def test_tension_of_a_pendulum():
    length, mass, speed, g, phi = 0.7, 0.3, 1.3, 9.81, 0.4
    down = np.array([np.sin(phi), 0.0, -np.cos(phi)])
    across = np.array([np.cos(phi), 0.0, np.sin(phi)])
    body = make([[0, 0, 0], length * down], bars=[(0, 1)], masses=[1.0, mass], fixed=[0])
    v = body.flat([[0, 0, 0], speed * across])
    weight = body.flat([[0, 0, 0], [0, 0, -g]])
    acceleration = body.accelerate(body.x, v, weight)
    tension = mass * (g * np.cos(phi) + speed**2 / length)
    assert -body.system.work.multiplier[0] == pytest.approx(tension, rel=1e-14)
    expected = -g * np.sin(phi) * across - speed**2 / length * down
    np.testing.assert_allclose(body.columns(acceleration)[1], expected, rtol=0, atol=1e-14)
    force = np.zeros_like(v)
    constraints.add_forces(force, body.system.work.multiplier, 1.0, *body.tail)
    np.testing.assert_allclose(body.columns(force)[0], tension * down, rtol=0, atol=1e-14)


def test_prescribed_accelerations_of_held_axes_reach_the_free_nodes():
    body = chain(3)
    acceleration = body.flat([[4.0, 1.0, 0.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    pulled = body.columns(body.accelerate(body.x, np.zeros_like(body.x), acceleration))
    np.testing.assert_allclose(pulled[:, 0], 4.0, rtol=1e-13)
    np.testing.assert_allclose(pulled[1:, 1:], 0.0, atol=1e-15)


def test_accelerations_keep_every_constraint_to_second_order():
    body = cloud(2)
    rng = np.random.default_rng(4)
    v, force = body.flat(rng.normal(size=(9, 3))), body.flat(rng.normal(size=(9, 3)))
    body.project_velocities(body.x, v)
    a = body.accelerate(body.x, v, body.inverse_mass * force)
    gaps = []
    for h in (2e-3, 1e-3):
        gaps.append(np.abs(body.values(body.x + h * v + 0.5 * h * h * a)).max())
    assert gaps[0] / gaps[1] == pytest.approx(8.0, rel=0.1)  # what is left is of third order


def pendulum_forces(body):
    return body.flat([[0, 0, 0]] + [[0, 0, -9.81]] * (body.geometry.n_nodes - 1))


def rattle(body, x, v, *, h, n):
    a = pendulum_forces(body)
    body.prepare(x)
    factor = body.system.factor
    for _ in range(n):
        v += 0.5 * h * a
        x += h * v
        constraints.project_positions(x, *body.tail, factor, 1e-14, 60)
        constraints.push(v, body.system.work.multiplier, 1.0 / h, *body.tail)
        v += 0.5 * h * a
        body.prepare(x)
        constraints.project_velocities(v, *body.tail, factor, 1e-15, 2)
    assert constraints.values(x, *body.tail) < 1e-13
    return x


def runge_kutta(body, x, v, *, h, n):
    a = pendulum_forces(body)
    for _ in range(n):
        k1 = body.accelerate(x, v, a)
        v2 = v + 0.5 * h * k1
        k2 = body.accelerate(x + 0.5 * h * v, v2, a)
        v3 = v + 0.5 * h * k2
        k3 = body.accelerate(x + 0.5 * h * v2, v3, a)
        v4 = v + h * k3
        k4 = body.accelerate(x + h * v3, v4, a)
        x = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


@pytest.mark.parametrize(
    ("scheme", "order", "steps"), [(rattle, 2, (200, 400, 800)), (runge_kutta, 4, (50, 100, 200))]
)
def test_pieces_make_integrators_of_their_order(scheme, order, steps):
    body = chain(3)
    start = body.flat(np.zeros((4, 3)))
    start[body.stride + 3] = 0.3  # out of the plane
    body.project_velocities(body.x, start)
    truth = runge_kutta(body, body.x, start.copy(), h=0.4 / 800, n=800)
    errors = [
        np.abs(scheme(body, body.x, start.copy(), h=0.4 / n, n=n) - truth).max() for n in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, order, atol=0.25)


def test_a_body_held_together_by_a_hinge_spins_as_a_rigid_one():
    body = dihedral(1.1, bars=[(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)], hinges=[(0, 1, 2, 3)])
    spin = np.array([0.3, 1.0, -0.5])
    positions = body.geometry.positions - body.geometry.positions.mean(axis=0)
    x, v = body.flat(positions), body.flat(np.cross(spin, positions))
    wings = np.linalg.norm(positions[2] - positions[3])  # no bar between these two
    assert np.abs(body.jacobian(x) @ v).max() < 1e-15
    a = body.columns(body.accelerate(x, v, np.zeros_like(x)))
    relative, along, speed = a[2] - a[3], positions[2] - positions[3], np.cross(spin, positions)
    change = relative @ along + np.sum((speed[2] - speed[3]) ** 2)
    assert abs(change) < 1e-14 * wings**2 + 1e-14
    angular = np.cross(positions, a).sum(axis=0)
    np.testing.assert_allclose(angular, 0.0, atol=1e-14)
