"""Equilibria with closed forms, and what is said when there is none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.statics import StaticProblem, equilibrated, find_equilibrium
from openprc.errors import ConfigError, NotConverged
from openprc.schema.experiment import Experiment

SPAN, RISE, STIFFNESS = 1.0, 0.3, 100.0
REST = np.hypot(SPAN, RISE)


def truss(load=0.0):
    """Return the von Mises truss in its plane, with a load downwards on the apex."""
    build = GeometryBuilder()
    left = build.add_node([-SPAN, 0, 0], fixed=True)
    apex = build.add_node([0, 0, RISE])
    right = build.add_node([SPAN, 0, 0], fixed=True)
    build.add_bar(left, apex, stiffness=STIFFNESS)
    build.add_bar(apex, right, stiffness=STIFFNESS)
    held = np.zeros((3, 3), dtype=bool)
    held[apex, 1] = True
    loads = [[0, 0, 0], [0, 0, -load], [0, 0, 0]]
    return StaticProblem(geometry=build.geometry(), held=held, loads=loads)


def truss_load(z):
    """Return the load that holds the apex at height z: 2 k z (L0 / l - 1)."""
    return 2 * STIFFNESS * z * (REST / np.hypot(SPAN, z) - 1)


Z_CRITICAL = np.sqrt((REST * SPAN**2) ** (2 / 3) - SPAN**2)
LIMIT_LOAD = 2 * STIFFNESS * (REST ** (2 / 3) - SPAN ** (2 / 3)) ** 1.5


@pytest.mark.parametrize("z", [0.3, 0.25, 0.2, 0.18, -0.31, -0.4])
def test_truss_follows_its_load_curve(z):
    start = truss().positions.copy()
    start[1, 2] = 0.3 if z > 0 else -0.3
    found = find_equilibrium(truss(truss_load(z)), start)
    assert found.positions[1, 2] == pytest.approx(z, abs=1e-12)
    assert found.residual <= found.tolerance
    assert found.stability.kind == "stable"
    # The supports carry the load and the thrust.
    np.testing.assert_allclose(found.reactions.sum(axis=0), [0, 0, truss_load(z)], atol=1e-11)
    tension = STIFFNESS * (np.hypot(SPAN, z) - REST)
    np.testing.assert_allclose(found.bar_forces, [tension, tension], atol=1e-11)


def test_truss_snaps_at_its_limit_load():
    np.testing.assert_allclose(LIMIT_LOAD, 0.99499170, atol=5e-9)
    np.testing.assert_allclose(RISE - Z_CRITICAL, 0.129288, atol=5e-7)
    before = find_equilibrium(truss(0.9999 * LIMIT_LOAD))
    beyond = find_equilibrium(truss(1.0001 * LIMIT_LOAD))
    assert Z_CRITICAL < before.positions[1, 2] < Z_CRITICAL + 0.01
    assert beyond.positions[1, 2] < -RISE
    assert truss_load(beyond.positions[1, 2]) == pytest.approx(1.0001 * LIMIT_LOAD, rel=1e-10)


@pytest.mark.parametrize(("offset", "kind"), [(1e-4, "stable"), (-1e-4, "unstable")])
def test_truss_loses_stability_at_its_limit_point(offset, kind):
    z = Z_CRITICAL + offset
    problem = truss(truss_load(z))
    start = problem.positions.copy()
    start[1, 2] = z + 1e-6
    found = find_equilibrium(problem, start, kind="stationary")
    assert found.positions[1, 2] == pytest.approx(z, abs=1e-9)
    assert found.stability.kind == kind
    assert found.stability.n_negative == (kind == "unstable")


def test_truss_barrier_and_the_way_off_its_saddle():
    start = truss().positions.copy()
    start[1, 2] = 0.0
    saddle = find_equilibrium(truss(), start, kind="stationary")
    assert saddle.energy == pytest.approx(STIFFNESS * (REST - SPAN) ** 2, rel=1e-14)
    assert saddle.energy == pytest.approx(0.19386982, abs=5e-9)
    down = find_equilibrium(truss(), start)
    assert down.escapes == 1
    assert abs(down.positions[1, 2]) == pytest.approx(RISE, abs=1e-12)
    assert down.energy < 1e-24


@pytest.mark.parametrize("load", [-0.2, 1e-9, 0.5, 30.0])
def test_ogden_bar_inverts_its_law(load):
    build = GeometryBuilder()
    root, tip = build.add_node([0, 0, 0], fixed=True), build.add_node([0.5, 0, 0])
    build.add_bar(root, tip, stiffness=7.0, law="ogden")
    held = [[True] * 3, [False, True, True]]
    loads = [[0, 0, 0], [load, 0, 0]]
    found = find_equilibrium(StaticProblem(geometry=build.geometry(), held=held, loads=loads))
    strain = (1 + 4 * load / (7.0 * 0.5)) ** 0.25 - 1
    assert found.positions[1, 0] == pytest.approx(0.5 * (1 + strain), abs=1e-14)
    assert found.bar_forces[0] == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("height", [1e-6, 0.3, 0.9, -0.7])
def test_static_crease(height):
    build = GeometryBuilder()
    for point in ([-1, 0, 0], [1, 0, 0], [0, -1, 0]):
        build.add_node(point, fixed=True)
    wing = build.add_node([0, 1, 0])
    for end in (0, 1):
        build.add_bar(end, wing, stiffness=0.0, rigid=True)
    build.add_hinge([0, 1, 2, wing], stiffness=0.4)
    positions = build.geometry().positions.copy()
    positions[wing, 2] = height
    held = np.zeros((4, 3), dtype=bool)
    held[wing, 2] = True
    found = find_equilibrium(
        StaticProblem(geometry=build.geometry(), held=held, positions=positions)
    )
    angle = np.arcsin(height)
    assert np.hypot(*found.positions[wing, 1:]) == pytest.approx(1.0, abs=1e-14)
    force = 0.4 * angle / np.cos(angle)
    assert found.reactions[wing, 2] == pytest.approx(force, rel=1e-10)
    assert abs(found.hinge_moments[0]) == pytest.approx(0.4 * abs(angle), rel=1e-10)
    # With the arms rigid, the supports take the opposite force and moment.
    np.testing.assert_allclose(found.reactions.sum(axis=0), 0.0, atol=1e-13)


def pressed_crease(load):
    """Return a hinge of "enhanced-linear" moment whose wing a load presses down, all arms 1."""
    build = GeometryBuilder()
    for point in ([-1, 0, 0], [1, 0, 0], [0, 1, 0]):
        build.add_node(point, fixed=True)
    wing = build.add_node([0, np.cos(0.9), np.sin(0.9)], mass=0.0)
    for end in (0, 1):
        build.add_bar(end, wing, stiffness=0.0, rigid=True)
    rows = {"stiffness": 0.4, "law": "enhanced-linear", "limits": (0.5, 2 * np.pi - 0.5)}
    build.add_hinge([0, 1, 2, wing], **rows)
    loads = np.zeros((4, 3))
    loads[wing, 2] = -load
    return StaticProblem(geometry=build.geometry(), loads=loads)


@pytest.mark.parametrize("load", [0.1, 1.0, 1e3])
def test_panel_pressed_on_its_neighbour_stops_before_it(load):
    problem = pressed_crease(load)
    found = find_equilibrium(problem)
    opening = np.arctan2(found.positions[3, 2], found.positions[3, 1])

    def moment(angle):
        if angle > 0.5:
            return 0.4 * (0.9 - angle)
        return 0.4 * (0.9 - 0.5 - 1 / np.pi * np.tan(np.pi * (angle - 0.5)))

    expected = brentq(lambda angle: moment(angle) - load * np.cos(angle), 1e-9, 0.9, xtol=1e-15)
    assert opening == pytest.approx(expected, rel=1e-9)
    assert 0 < opening < 0.9
    assert found.stability.kind == "stable"


# --- chains -------------------------------------------------------------------------------------


def chain(links, *, span, length, **bar):
    build = GeometryBuilder()
    for x in np.linspace(0, span, links + 1):
        # Begin below the chord, a little askew.
        build.add_node([x, 0, -np.sin(np.pi * x / span)], mass=1.0 / links)
    for node in range(links):
        build.add_bar(node, node + 1, rest_length=length / links, **bar)
    geometry = build.geometry()
    fixed = np.zeros(links + 1, dtype=bool)
    fixed[[0, -1]] = True
    return replace(geometry, fixed=fixed)


def test_hanging_chain_of_cables_is_the_elastic_polygon():
    links, span, length, stiffness, g = 20, 1.0, 1.3, 500.0, 9.81
    geometry = chain(links, span=span, length=length, stiffness=stiffness, law="cable")
    found = find_equilibrium(StaticProblem(geometry=geometry, gravity=[0, 0, -g]))
    # Every link carries the thrust H and the weight below it.
    vertical = (np.arange(links) - (links - 1) / 2) * g / links

    def link_vectors(thrust):
        tension = np.hypot(thrust, vertical)
        along = (length / links + tension / stiffness) / tension
        return along * thrust, along * vertical

    thrust = brentq(lambda h: link_vectors(h)[0].sum() - span, 1e-3, 100, xtol=1e-15)
    x, z = (np.concatenate([[0], np.cumsum(part)]) for part in link_vectors(thrust))
    np.testing.assert_allclose(found.positions[:, 0], x, atol=1e-12)
    np.testing.assert_allclose(found.positions[:, 2], z, atol=1e-12)
    np.testing.assert_allclose(found.bar_forces, np.hypot(thrust, vertical), rtol=1e-10)
    assert found.stability.kind == "stable"


def test_chain_of_rigid_links_tends_to_the_catenary():
    # Span 2 c sinh^-1(L / (2 c)) for the parameter c, sag c (cosh(span / (2 c)) - 1).
    c = brentq(lambda c: 2 * c * np.arcsinh(1.3 / (2 * c)) - 1.0, 0.05, 5)
    sag = c * (np.cosh(0.5 / c) - 1)
    errors = []
    for links in (8, 16, 32):
        geometry = chain(links, span=1.0, length=1.3, stiffness=0.0, rigid=True)
        found = find_equilibrium(StaticProblem(geometry=geometry, gravity=[0, 0, -9.81]))
        lengths = np.linalg.norm(np.diff(found.positions, axis=0), axis=1)
        np.testing.assert_allclose(lengths, 1.3 / links, rtol=1e-13)
        assert found.bar_forces.min() > 0
        assert found.stability.kind == "stable"
        errors.append(abs(-found.positions[:, 2].min() - sag))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_slack_cable_falls_until_it_is_taut():
    build = GeometryBuilder()
    top = build.add_node([0, 0, 0], fixed=True)
    bob = build.add_node([0.1, 0, 0.5], mass=2.0)
    build.add_bar(top, bob, stiffness=1000.0, rest_length=1.0, law="cable")
    found = find_equilibrium(StaticProblem(geometry=build.geometry(), gravity=[0, 0, -10.0]))
    np.testing.assert_allclose(found.positions[bob], [0, 0, -1.02], atol=1e-12)


def test_tensegrity_prism_has_its_twist():
    build = GeometryBuilder()
    turns = 2 * np.pi * np.arange(3) / 3
    for height, twist in ((0.0, 0.0), (1.0, 0.9)):
        for turn in turns + twist:
            build.add_node([np.cos(turn), np.sin(turn), height])
    for a in range(3):
        b = (a + 1) % 3
        build.add_bar(a, b, stiffness=100.0, rest_length=1.6, law="cable")
        build.add_bar(3 + a, 3 + b, stiffness=100.0, rest_length=1.6, law="cable")
        build.add_bar(a, 3 + a, stiffness=100.0, rest_length=1.0, law="cable")
        build.add_bar(a, 3 + b, stiffness=500.0, rest_length=2.4, law="strut")
    found = find_equilibrium(StaticProblem(geometry=build.geometry()))
    forces = found.bar_forces.reshape(3, 4)
    assert (forces[:, :3] > 1.0).all()
    assert (forces[:, 3] < -1.0).all()
    assert (found.stability.kind, found.stability.n_rigid) == ("stable", 6)
    low, high = found.positions[:3], found.positions[3:]
    axis = high.mean(axis=0) - low.mean(axis=0)
    axis /= np.linalg.norm(axis)
    for a in range(3):
        u, v = low[a] - low.mean(axis=0), high[(a + 1) % 3] - high.mean(axis=0)
        twist = np.degrees(np.arctan2(np.cross(u, v) @ axis, u @ v))
        # pi/2 + pi/n along a strut, whatever the stiffnesses.
        assert twist == pytest.approx(150.0, abs=1e-9)


# --- into an experiment -------------------------------------------------------------------------


def test_equilibrated_experiment_starts_at_rest_where_forces_balance():
    geometry = chain(6, span=1.0, length=1.1, stiffness=80.0)
    moving = np.where(geometry.fixed[:, None], 0.0, 1.0) * np.ones((7, 3))
    scene = Experiment(
        geometry=replace(geometry, velocities=moving),
        duration=1.0,
        dt=0.01,
        save_interval=0.1,
        gravity=(0.0, 0.0, -9.81),
    )
    still = equilibrated(scene)
    problem = StaticProblem.from_experiment(still)
    gradient = problem.gradient(still.geometry.positions)
    assert np.abs(gradient[~problem.held]).max() < 1e-12
    assert not still.geometry.velocities.any()
    np.testing.assert_array_equal(still.geometry.bars.rest_length, geometry.bars.rest_length)
    np.testing.assert_array_equal(still.geometry.positions[[0, -1]], geometry.positions[[0, -1]])
    assert (still.dt, still.gravity) == (scene.dt, scene.gravity)


def test_slow_mechanism_stops_at_the_force_that_counts_as_zero():
    # Two bars in a line: sideways the energy grows with the fourth power only.
    build = GeometryBuilder()
    ends = [build.add_node([x, 0, 0], fixed=True) for x in (-1, 1)]
    middle = build.add_node([0, 0, 0])
    for end in ends:
        build.add_bar(end, middle, stiffness=100.0)
    start = build.geometry().positions.copy()
    start[middle, 2] = 0.1
    problem = StaticProblem(geometry=build.geometry())
    rough = find_equilibrium(problem, start, force_tolerance=1e-4)
    fine = find_equilibrium(problem, start)
    assert rough.tolerance == 1e-4 > rough.residual > fine.residual
    assert rough.iterations < fine.iterations
    # Force k z^3 / L^2 on both sides.
    assert abs(rough.positions[middle, 2]) == pytest.approx(
        (rough.residual / 100) ** (1 / 3), rel=0.1
    )
    assert fine.stability.kind != "unstable"


# --- when there is none -------------------------------------------------------------------------


def test_load_on_a_floating_piece_is_refused():
    build = GeometryBuilder()
    build.add_node([0, 0, 0], fixed=True)
    ends = build.add_nodes([[1, 0, 0], [2, 0, 0]], mass=2.0)
    build.add_bar(*ends, stiffness=1.0)
    problem = StaticProblem(geometry=build.geometry(), gravity=[0, 0, -10.0])
    with pytest.raises(ConfigError, match="a load of -40 N along z on the piece of node 1, which"):
        find_equilibrium(problem)
    # Opposite loads stretch it, and nothing has to hold it.
    pulled = StaticProblem(geometry=build.geometry(), loads=[[0, 0, 0], [-3, 0, 0], [3, 0, 0]])
    found = find_equilibrium(pulled)
    assert np.linalg.norm(np.diff(found.positions[1:], axis=0)) == pytest.approx(4.0, rel=1e-12)


def test_iterations_run_out_in_words():
    with pytest.raises(
        NotConverged, match=r"after 2 iterations \(the iterations are used up\).*of node 1"
    ):
        find_equilibrium(truss(0.99), max_iterations=2)


def test_rigid_elements_that_do_not_fit_are_refused():
    geometry = chain(3, span=1.0, length=0.9, stiffness=0.0, rigid=True)
    with pytest.raises(NotConverged, match="rigid elements cannot all have their length or angle"):
        find_equilibrium(StaticProblem(geometry=geometry))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "maximum"}, "kind: found 'maximum'"),
        ({"load_steps": 0}, "load_steps: 0 steps"),
        ({"start": np.zeros((2, 3))}, r"start: a start of shape \(2, 3\)"),
        ({"start": np.full((3, 3), np.nan)}, "start: NaN or infinity"),
    ],
)
def test_wrong_arguments_are_named(settings, message):
    with pytest.raises(ConfigError, match=message):
        find_equilibrium(truss(), **settings)


def test_body_without_freedom_is_in_equilibrium():
    problem = truss()
    problem = replace(problem, held=np.ones((3, 3), dtype=bool))
    found = find_equilibrium(problem)
    np.testing.assert_array_equal(found.positions, problem.positions)
    assert (found.iterations, found.stability.kind) == (0, "stable")
