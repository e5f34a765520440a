"""Natural modes and stability against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import roots_laguerre

from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.statics import StaticProblem, find_equilibrium, natural_modes, stability
from openprc.demlat.statics.eigenpairs import DENSE_LIMIT
from openprc.errors import ConfigError


def modes_at_rest(build, **settings):
    problem = StaticProblem(geometry=build.geometry(), **settings)
    return natural_modes(problem, problem.positions)


def test_mass_on_a_spring():
    build = GeometryBuilder()
    root, tip = build.add_node([0, 0, 0], fixed=True), build.add_node([0.4, 0, 0], mass=0.3)
    build.add_bar(root, tip, stiffness=50.0)
    modes = modes_at_rest(build)
    assert modes.kinds == ("rigid-body", "rigid-body", "vibration")
    assert modes.vibrations == pytest.approx([np.sqrt(50.0 / 0.3)], rel=1e-14)
    assert modes.frequencies[-1] == pytest.approx(np.sqrt(50.0 / 0.3) / (2 * np.pi), rel=1e-14)
    np.testing.assert_array_equal(modes.angular_frequencies[:2], 0.0)
    # Unit modal mass.
    assert abs(modes.shapes[-1, tip, 0]) == pytest.approx(1 / np.sqrt(0.3), rel=1e-14)
    assert modes.residual == 0.0


def test_two_free_masses():
    build = GeometryBuilder()
    ends = build.add_node([0, 0, 0], mass=0.2), build.add_node([0, 0, 1.0], mass=0.7)
    build.add_bar(*ends, stiffness=30.0)
    modes = modes_at_rest(build)
    assert (modes.count("rigid-body"), modes.count("mechanism")) == (5, 0)
    assert modes.vibrations == pytest.approx([np.sqrt(30 * (1 / 0.2 + 1 / 0.7))], rel=1e-13)


def hinge(masses, fixed, *, stiffness=0.05, height=0.8):
    build = GeometryBuilder()
    points = [[-1, 0, 0], [1, 0, 0], [0, -height, 0], [0, height, 0]]
    for point, mass, hold in zip(points, masses, fixed, strict=True):
        build.add_node(point, mass=mass, fixed=hold)
    for pair in ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3)):
        build.add_bar(*pair, stiffness=0.0, rigid=True)
    build.add_hinge([0, 1, 2, 3], stiffness=stiffness)
    return build


def test_hinge_with_one_free_wing():
    modes = modes_at_rest(hinge([1, 1, 1, 0.01], [True, True, True, False]))
    assert modes.kinds == ("vibration",)
    assert modes.vibrations == pytest.approx([np.sqrt(0.05 / 0.01) / 0.8], rel=1e-13)
    assert modes.vibrations[0] == pytest.approx(2.79508, abs=5e-6)


@pytest.mark.parametrize("masses", [[0.01] * 4, [0.01, 0.02, 0.005, 0.03]])
def test_free_hinge(masses):
    modes = modes_at_rest(hinge(masses, [False] * 4))
    assert (modes.count("rigid-body"), modes.count("mechanism")) == (6, 0)
    # w^2 = k sum |d(angle)/dx|^2 / m with gradients 1/h at wings and 1/h at crease nodes.
    omega = np.sqrt(0.05 * np.sum(1 / np.array(masses)) / 0.8**2)
    assert modes.vibrations == pytest.approx([omega], rel=1e-12)
    if len(set(masses)) == 1:
        assert omega == pytest.approx(5.59017, abs=5e-6)


def test_gravity_makes_a_hinge_without_stiffness_swing():
    build = hinge([1, 1, 1, 0.01], [True, True, True, False], stiffness=0.0)
    problem = StaticProblem(geometry=build.geometry(), gravity=[0, 0, -9.81])
    found = find_equilibrium(problem)
    np.testing.assert_allclose(found.positions[3], [0, 0, -0.8], atol=1e-12)
    modes = natural_modes(problem, found.positions)
    assert modes.vibrations == pytest.approx([np.sqrt(9.81 / 0.8)], rel=1e-12)
    # Upright it falls instead of swinging.
    upright = problem.positions.copy()
    upright[3] = [0, 0, 0.8]
    modes = natural_modes(problem, upright)
    assert modes.kinds == ("unstable",)
    assert modes.eigenvalues == pytest.approx([-9.81 / 0.8], rel=1e-12)
    assert np.isnan(modes.angular_frequencies[0])
    assert stability(problem, upright).n_negative == 1


def test_truss_vibrates_as_its_closed_form():
    build = GeometryBuilder()
    build.add_node([-1, 0, 0], fixed=True)
    build.add_node([0, 0, 0.3], mass=1.0)
    build.add_node([1, 0, 0], fixed=True)
    build.add_bar(0, 1, stiffness=100.0)
    build.add_bar(1, 2, stiffness=100.0)
    modes = modes_at_rest(build)
    # Out of its plane nothing holds the apex to first order.
    assert modes.kinds == ("rigid-body", "vibration", "vibration")
    length = np.hypot(1, 0.3)
    assert modes.vibrations[0] == pytest.approx(np.sqrt(200.0) * 0.3 / length, rel=1e-13)
    assert modes.vibrations[0] == pytest.approx(4.063713, abs=5e-7)


def test_four_bars_are_a_mechanism():
    build = GeometryBuilder()
    nodes = build.add_nodes([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    for a in range(4):
        build.add_bar(nodes[a], nodes[(a + 1) % 4], stiffness=10.0)
    problem = StaticProblem(geometry=build.geometry())
    modes = natural_modes(problem, problem.positions)
    assert modes.count("rigid-body") == 6
    # It shears, and it folds out of its plane.
    assert modes.count("mechanism") == 2
    assert len(modes.vibrations) == 4
    found = stability(problem, problem.positions)
    assert (found.kind, found.n_rigid, found.n_mechanisms) == ("neutral", 6, 2)
    first = modes.kinds.index("rigid-body")
    moved = modes.shapes[first : first + 6].reshape(6, 12)
    np.testing.assert_allclose(moved @ moved.T, np.eye(6), atol=1e-12)


def test_two_pieces_move_on_their_own():
    build = GeometryBuilder()
    for shift in (0.0, 5.0):
        nodes = build.add_nodes([[0, 0, shift], [1, 0, shift], [0, 1, shift]])
        for a in range(3):
            build.add_bar(nodes[a], nodes[(a + 1) % 3], stiffness=10.0)
    modes = modes_at_rest(build, loads=None)
    assert (modes.count("rigid-body"), modes.count("mechanism")) == (12, 0)


# --- large bodies: shift-invert -----------------------------------------------------------------


def line(count, *, fixed):
    build = GeometryBuilder()
    for x in range(count):
        build.add_node([x, 0, 0], mass=0.5, fixed=fixed and x == 0)
    for x in range(count - 1):
        build.add_bar(x, x + 1, stiffness=20.0)
    return build.geometry()


@pytest.mark.parametrize("fixed", [True, False])
def test_long_chain_of_springs(fixed):
    n = DENSE_LIMIT + 100
    held = np.zeros((n, 3), dtype=bool)
    held[:, 1:] = True
    problem = StaticProblem(geometry=line(n, fixed=fixed), held=held)
    modes = natural_modes(problem, problem.positions, n=6)
    if fixed:
        angles = (2 * np.arange(6) + 1) * np.pi / (2 * (2 * n - 1))
    else:
        angles = np.arange(6) * np.pi / (2 * n)
        assert modes.kinds[0] == "rigid-body"
    expected = 2 * np.sqrt(20.0 / 0.5) * np.sin(angles)
    np.testing.assert_allclose(modes.angular_frequencies, expected, rtol=1e-8)


@pytest.mark.parametrize("links", [4, 160])
def test_hanging_chain_of_rigid_links(links):
    build = GeometryBuilder()
    build.add_node([0, 0, 0], fixed=True)
    for z in range(links):
        build.add_node([0, 0, -0.1 * (z + 1)], mass=0.2)
        build.add_bar(z, z + 1, stiffness=0.0, rigid=True)
    problem = StaticProblem(geometry=build.geometry(), gravity=[0, 0, -9.81])
    modes = natural_modes(problem, problem.positions, n=6)
    # Zeros of the Laguerre polynomial, each for both sideways directions.
    zeros = np.repeat(roots_laguerre(links)[0], 2)[:6]
    np.testing.assert_allclose(modes.eigenvalues, 9.81 / 0.1 * zeros, rtol=1e-7)
    assert modes.kinds == ("vibration",) * 6


def test_upright_chain_of_springs_has_all_its_negative_eigenvalues():
    # Compressed beyond its rest length along a line that holds no bending.
    count = 180
    geometry = line(count, fixed=True)
    positions = geometry.positions * 0.9
    held = np.zeros((count, 3), dtype=bool)
    held[-1] = True
    problem = StaticProblem(geometry=geometry, held=held, positions=positions)
    assert len(problem.free) > DENSE_LIMIT
    found = stability(problem, positions)
    assert found.kind == "unstable"
    assert found.n_negative == 2 * (count - 2)
    # Transverse stiffness N / l of a chain of n - 2 inner nodes under the thrust N.
    thrust = 20.0 * 0.1 / 0.9
    lowest = -4 * thrust * np.sin((count - 2) * np.pi / (2 * (count - 1))) ** 2
    assert found.eigenvalues[0] == pytest.approx(lowest, rel=1e-9)


# --- what is refused ----------------------------------------------------------------------------


def test_wrong_arguments_are_named():
    problem = StaticProblem(geometry=line(3, fixed=True))
    x = problem.positions
    with pytest.raises(ConfigError, match="n: n = 0"):
        natural_modes(problem, x, n=0)
    with pytest.raises(ConfigError, match="n: n = 0"):
        stability(problem, x, n=0)
    with pytest.raises(ConfigError, match=r"masses: shape \(2,\)"):
        natural_modes(problem, x, masses=[1.0, 2.0])
    with pytest.raises(ConfigError, match="masses: mass 0 kg at node 2"):
        natural_modes(problem, x, masses=[0.0, 2.0, 0.0])
    light = replace(problem.geometry, masses=[0.0, 1.0, 1.0])
    assert natural_modes(replace(problem, geometry=light), x).count("vibration") == 2
