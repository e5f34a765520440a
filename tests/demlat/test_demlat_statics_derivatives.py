"""Energies, forces and stiffnesses of the static model against each other."""

import doctest
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from openprc.demlat.observables import hinge_angles
from openprc.demlat.statics import StaticProblem
from openprc.demlat.statics.element_laws import BarLaws, HingeLaws
from openprc.demlat.statics.element_shapes import (
    bar_directions,
    bar_stiffness,
    hinge_bends,
    hinge_gradients,
    hinge_hessians,
)
from openprc.errors import ConfigError, NotConverged, UnsupportedScene
from openprc.schema.experiment import Actuator, Collision, Experiment, Signal
from openprc.schema.geometry import Bars, Geometry, Hinges

ROW = np.array([[0, 1, 2, 3]], dtype="i4")


def fold(angle, *, scale=1.0):
    """Return nodes j, k, i, l of a skew hinge with that dihedral angle."""
    wing = [0.5, 0.9 * np.cos(angle), 0.9 * np.sin(angle)]
    return scale * np.array([[0, 0, 0], [1.2, 0, 0], [0.4, 1, 0], wing])


def complex_step(x):
    """Return the derivative of the gradient without any cancellation."""
    hessian = np.zeros((4, 3, 4, 3))
    for node in range(4):
        for axis in range(3):
            moved = x.astype(complex)
            moved[node, axis] += 1e-30j
            hessian[:, :, node, axis] = hinge_gradients(moved, ROW)[0].imag / 1e-30
    return hessian


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
@pytest.mark.parametrize(
    "angle", [1e-12, 1e-6, 0.05, 1.0, 3.1, np.pi - 1e-12, np.pi, 4.0, 6.2, 2 * np.pi - 1e-9]
)
def test_hinge_hessian_is_exact_from_shut_to_shut(angle, scale):
    x = fold(angle, scale=scale)
    hessian, exact = hinge_hessians(x, ROW)[0], complex_step(x)
    assert np.abs(hessian - exact).max() < 1e-14 * np.abs(exact).max()
    flat = hessian.reshape(12, 12)
    np.testing.assert_allclose(flat, flat.T, atol=1e-14 * np.abs(flat).max())
    # Moving all nodes together changes no gradient.
    assert np.abs(hessian.sum(axis=2)).max() < 1e-14 * np.abs(exact).max()


def test_bends_are_the_angles_of_the_results():
    x = np.stack([fold(angle) for angle in (0.1, 3.0, np.pi, 5.0)])
    hinges = Hinges(indices=ROW, stiffness=[1.0], rest_angle=[0.0])
    bends = [hinge_bends(frame, ROW)[0] for frame in x]
    np.testing.assert_allclose(np.array(bends) + np.pi, hinge_angles(x, hinges)[:, 0], atol=1e-15)
    assert hinge_bends(fold(np.pi + 1e-13), ROW)[0] == pytest.approx(-1e-13, rel=1e-2) or (
        hinge_bends(fold(np.pi + 1e-13), ROW)[0] == pytest.approx(1e-13, rel=1e-2)
    )


LAWS = ("linear", "cubic", "cable", "strut", "ogden")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("length", [0.6, 1.3])
def test_bar_forces_and_tangents_are_derivatives(law, length):
    cubic = 7.0 if law == "cubic" else 0.0
    laws = BarLaws(
        Bars(
            indices=[[0, 1]],
            stiffness=[3.0],
            rest_length=[2.0],
            prestress=[-0.5],
            law=[law],
            stiffness_cubic=[cubic],
        )
    )
    h = 1e-5
    at = [np.array([length + shift]) for shift in (-h, 0.0, h)]
    energy, force = [laws.energy(l)[0] for l in at], [laws.force(l)[0] for l in at]  # noqa: E741
    assert (energy[2] - energy[0]) / (2 * h) == pytest.approx(force[1], rel=1e-8, abs=1e-12)
    slope = (force[2] - force[0]) / (2 * h)
    assert slope == pytest.approx(laws.tangent(at[1])[0], rel=1e-8, abs=1e-12)
    s = length - 1.0
    expected = {
        "linear": 3 * s,
        "cubic": 3 * s + 7 * s**3,
        "cable": max(3 * s, 0),
        "strut": min(3 * s, 0),
        "ogden": 3 * ((1 + s) ** 4 - 1) / 4,
    }
    assert force[1] == pytest.approx(expected[law], rel=1e-14)


def enhanced():
    return HingeLaws(
        Hinges(
            indices=ROW,
            stiffness=[0.7],
            rest_angle=[2.5],
            law=["enhanced-linear"],
            limit_low=[0.8],
            limit_high=[5.0],
        )
    )


@pytest.mark.parametrize("angle", [0.01, 0.3, 0.8, 2.0, 5.0, 5.5, 6.2])
def test_enhanced_hinge_follows_its_printed_law(angle):
    laws, bend = enhanced(), np.array([angle - np.pi])
    moment = 0.7 * (angle - 2.5)
    if angle < 0.8:
        moment = 0.7 * (0.8 - 2.5 + 1.6 / np.pi * np.tan(np.pi * (angle - 0.8) / 1.6))
    elif angle > 5.0:
        gap = 2 * np.pi - 5.0
        moment = 0.7 * (5.0 - 2.5 + 2 * gap / np.pi * np.tan(np.pi * (angle - 5.0) / (2 * gap)))
    assert laws.force(bend)[0] == pytest.approx(moment, rel=1e-13)
    h = 1e-6
    slope = (laws.energy(bend + h)[0] - laws.energy(bend - h)[0]) / (2 * h)
    assert slope == pytest.approx(moment, rel=1e-6)
    slope = (laws.force(bend + h)[0] - laws.force(bend - h)[0]) / (2 * h)
    assert slope == pytest.approx(laws.tangent(bend)[0], rel=1e-5)


def test_linear_hinge_takes_the_shorter_way_round():
    laws = HingeLaws(Hinges(indices=ROW, stiffness=[2.0], rest_angle=[0.1]))
    assert laws.force(np.array([np.pi - 0.1]))[0] == pytest.approx(-0.4)
    assert laws.energy(np.array([np.pi - 0.1]))[0] == pytest.approx(0.04)


@pytest.fixture(scope="module")
def mixed():
    """Return a body with every law, far from rest."""
    x = np.random.default_rng(0).normal(size=(8, 3))
    bars = Bars(
        indices=[[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 6]],
        stiffness=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        rest_length=[0.5, 0.5, 0.5, 9.0, 0.5, 0.5],
        law=[*LAWS, "linear"],
        stiffness_cubic=[0, 2.0, 0, 0, 0, 0],
    )
    hinges = Hinges(
        indices=[[0, 1, 2, 3], [4, 5, 6, 7], [2, 3, 5, 6]],
        stiffness=[1.0, 2.0, 3.0],
        rest_angle=[1.0, 3.0, 2.0],
        law=["linear", "enhanced-linear", "enhanced-linear"],
        limit_low=[0.0, 2.5, 1.9],
        limit_high=[2 * np.pi, 3.5, 2.1],
    )
    geometry = Geometry(
        positions=x,
        masses=np.arange(1.0, 9.0),
        bars=bars,
        hinges=hinges,
        fixed=[True] + 7 * [False],
    )
    loads = np.random.default_rng(1).normal(size=(8, 3))
    return StaticProblem(geometry=geometry, gravity=[0.1, 0.2, -9.8], loads=loads)


def central(function, x, h=1e-6):
    """Return d(function)/dx by central differences, coordinate after coordinate."""
    columns = []
    for step in h * np.eye(x.size).reshape(-1, *x.shape):
        columns.append((function(x + step) - function(x - step)) / (2 * h))
    return np.array(columns)


def test_gradient_and_hessian_are_derivatives_of_the_energy(mixed):
    x = mixed.positions
    gradient = mixed.gradient(x)
    slope = central(mixed.energy, x).reshape(x.shape)
    assert np.abs(slope - gradient).max() < 1e-8 * np.abs(gradient).max()
    hessian = mixed.hessian(x).toarray()
    second = central(mixed.gradient, x).reshape(24, 24)[3:, 3:]
    assert hessian.shape == (21, 21)
    assert np.abs(second - hessian).max() < 1e-7 * np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-13 * np.abs(hessian).max())


def test_constraints_and_the_lagrangian(mixed):
    geometry = mixed.geometry
    rigid = replace(
        mixed,
        geometry=replace(
            geometry,
            bars=replace(geometry.bars, rigid=[1, 0, 0, 0, 0, 1]),
            hinges=replace(geometry.hinges, rigid=[0, 1, 0]),
        ),
    )
    x, multipliers = mixed.positions + 0.05, np.array([0.3, -2.0, 5.0])
    jacobian = rigid.constraint_jacobian(x).toarray()
    slope = central(rigid.constraints, x).T[:, 3:]
    np.testing.assert_allclose(jacobian, slope, atol=1e-8)
    whole = rigid.constraint_jacobian(x, whole=True).toarray()
    np.testing.assert_array_equal(whole[:, 3:], jacobian)

    def lagrangian_gradient(y):
        return (
            rigid.gradient(y).ravel()
            + rigid.constraint_jacobian(y, whole=True).toarray().T @ multipliers
        )

    hessian = rigid.hessian(x, multipliers).toarray()
    second = central(lagrangian_gradient, x)[3:, 3:]
    assert np.abs(second - hessian).max() < 1e-7 * np.abs(hessian).max()


def test_spring_of_rest_length_zero_may_shrink_to_a_point():
    lengths, unit = bar_directions(np.zeros((2, 3)), np.array([[0, 1]]))
    block = bar_stiffness(lengths, unit, np.zeros(1), np.array([5.0]))[0]
    np.testing.assert_array_equal(block[0, :, 0], 5.0 * np.eye(3))
    np.testing.assert_array_equal(block[0, :, 1], -5.0 * np.eye(3))


# --- what is refused --------------------------------------------------------------------------


def two_nodes(**settings):
    return Geometry(
        positions=[[0, 0, 0], [1, 0, 0]],
        masses=[1.0, 1.0],
        bars=Bars(indices=[[0, 1]], stiffness=[1.0], rest_length=[0.5]),
        **settings,
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"loads": np.zeros(3)}, r"loads: shape \(3,\)\n  expected: \(2, 3\)"),
        ({"gravity": [0, 0, np.nan]}, "gravity: NaN or infinity"),
        ({"held": np.zeros((1, 3))}, r"held: shape \(1, 3\)"),
        ({"positions": np.zeros((3, 3))}, r"positions: shape \(3, 3\)"),
    ],
)
def test_wrong_arrays_are_named(settings, message):
    with pytest.raises(ConfigError, match=message):
        StaticProblem(geometry=two_nodes(), **settings)


def test_arrays_are_frozen_and_fixed_nodes_are_held():
    problem = StaticProblem(geometry=two_nodes(fixed=[True, False]))
    np.testing.assert_array_equal(problem.free, [3, 4, 5])
    with pytest.raises(ValueError, match="read-only"):
        problem.loads[0] = 1.0
    with pytest.raises(ConfigError, match=r"positions: shape \(1, 3\)"):
        problem.place(np.zeros((1, 3)))


def test_collapsed_elements_are_named():
    problem = StaticProblem(geometry=two_nodes())
    with pytest.raises(NotConverged, match=r"nodes \[0, 1\] of bar 0 are at one point"):
        problem.gradient(np.zeros((2, 3)))
    with pytest.raises(NotConverged, match=r"hinge 0 \[0, 1, 2, 3\] has a wing on its crease line"):
        hinge_gradients(np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0, 1, 0.0]]), ROW)


def test_hard_stops_are_refused():
    hinges = Hinges(indices=ROW, stiffness=[1.0], rest_angle=[3.0], limit_low=[1.0])
    geometry = Geometry(positions=fold(3.0), masses=np.ones(4), hinges=hinges)
    with pytest.raises(UnsupportedScene, match="hinge 0 has hard stops"):
        StaticProblem(geometry=geometry)


def experiment(**settings):
    geometry = two_nodes(fixed=[True, False], **settings.pop("nodes", {}))
    times = {"duration": 1.0, "dt": 0.1, "save_interval": 0.1}
    return Experiment(geometry=geometry, **times, **settings)


def test_experiment_is_read_at_a_time():
    ramp = Signal(name="pull", values=[0.0, 4.0], dt=1.0)
    place = Signal(name="place", values=[[1.0, 0, 0], [3.0, 0.2, 0]], dt=1.0)
    scene = experiment(
        gravity=(0.0, -9.81, 0.0),
        signals={"pull": ramp, "place": place},
        actuators=(
            Actuator(node=1, signal="pull", type="force", axes=(False, True, False)),
            Actuator(node=1, signal="pull", type="force", axes=(False, True, False)),
            Actuator(node=1, signal="place", axes=(True, False, False)),
        ),
    )
    problem = StaticProblem.from_experiment(scene, time=0.5)
    np.testing.assert_allclose(problem.loads, [[0, 0, 0], [0, 4.0, 0]])
    np.testing.assert_allclose(problem.positions[1], [2.0, 0, 0])
    # The scene is planar, so it stays in its plane.
    np.testing.assert_array_equal(problem.held[1], [True, False, True])


def test_contact_and_prescribed_velocities_are_refused():
    touching = experiment(
        nodes={"collidable": [True, True]}, collision=Collision(enabled=True, radius=0.1)
    )
    with pytest.raises(UnsupportedScene, match="contact between 2 collidable nodes"):
        StaticProblem.from_experiment(touching)
    moving = experiment(
        signals={"v": Signal(name="v", values=[1.0, 1.0], dt=1.0)},
        actuators=(Actuator(node=1, signal="v", type="velocity"),),
    )
    with pytest.raises(UnsupportedScene, match=r"prescribed velocities at t = 0.5 s"):
        StaticProblem.from_experiment(moving, time=0.5)
    assert StaticProblem.from_experiment(moving).held[1].all()


@pytest.mark.parametrize("name", ["assembly", "equilibrium", "inertia", "modes", "search"])
def test_examples_print_what_they_say(name):
    results = doctest.testmod(import_module(f"openprc.demlat.statics.{name}"))
    assert results.attempted > 5
    assert results.failed == 0


def test_public_names_are_found_on_first_use():
    package = import_module("openprc.demlat.statics")
    assert sorted(package.__all__) == dir(package)
    assert all(callable(getattr(package, name)) for name in package.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'follow_path'"):
        package.follow_path  # noqa: B018
