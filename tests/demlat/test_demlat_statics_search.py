"""Search for stable states: how many there are is known, and so is where."""

import json

import numpy as np
import pytest

from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.statics import StaticProblem, find_equilibrium, find_stable_states
from openprc.demlat.statics.congruence import allowed_motions, turn_matrix
from openprc.errors import ConfigError


def truss():
    build = GeometryBuilder()
    build.add_node([-1, 0, 0], fixed=True)
    build.add_node([0, 0, 0.3])
    build.add_node([1, 0, 0], fixed=True)
    build.add_bar(0, 1, stiffness=100.0)
    build.add_bar(1, 2, stiffness=100.0)
    held = np.zeros((3, 3), dtype=bool)
    held[1, 1] = True
    return build.geometry(), held


def test_truss_has_two_states_and_they_are_reported():
    geometry, held = truss()
    seen = []
    states = find_stable_states(
        StaticProblem(geometry=geometry, held=held, loads=[[0, 0, 0], [0, 0, -0.1], [0, 0, 0]]),
        rng=np.random.default_rng(1),
        n_starts=20,
        amplitude=0.4,
        progress=lambda *numbers: seen.append(numbers),
    )
    assert len(states) == 2
    assert states[0].energy < states[1].energy
    # The load pulls down, so the lower state is the deeper one.
    assert states[0].positions[1, 2] < -0.3 < 0 < states[1].positions[1, 2] < 0.3
    assert states[0].count + states[1].count == 20 == states.n_starts
    assert states.failures == {}
    assert 0 in states[1].starts
    assert all(state.equilibrium.stability.kind == "stable" for state in states)
    assert [numbers[:2] for numbers in seen] == [(i + 1, 20) for i in range(20)]
    assert seen[-1][2] == 2
    told = json.loads(states.to_json())
    assert [state["count"] for state in told["states"]] == [state.count for state in states]
    np.testing.assert_array_equal(told["states"][0]["positions"], states[0].positions)
    assert told["failures"] == []


def test_same_seed_finds_the_same():
    geometry, held = truss()
    problem = StaticProblem(geometry=geometry, held=held)
    runs = [
        find_stable_states(problem, rng=np.random.default_rng(3), n_starts=8).to_json()
        for _ in range(2)
    ]
    assert runs[0] == runs[1]


def kresling(*, sides=6, twist=50.0, height=1.75):
    """Return a Kresling tower on a fixed base and the height of its other stable state."""
    psi, step = np.radians(twist), np.pi / sides
    turns = 2 * np.pi * np.arange(sides) / sides
    build = GeometryBuilder()
    for turn in turns:
        build.add_node([np.cos(turn), np.sin(turn), 0], fixed=True)
    for turn in turns + psi - step:
        build.add_node([np.cos(turn), np.sin(turn), height])
    for a in range(sides):
        b = (a + 1) % sides
        build.add_bar(sides + a, sides + b, stiffness=100.0)
        build.add_bar(a, sides + a, stiffness=100.0)
        build.add_bar(a, sides + b, stiffness=100.0)
    other = np.sqrt(height**2 - 4 * np.cos(psi) * np.cos(step))
    return build.geometry(), other


def folded(geometry, sides, height, twist):
    """Return the tower with its upper ring at that height and relative angle [deg]."""
    x = geometry.positions.copy()
    turns = 2 * np.pi * np.arange(sides) / sides + np.radians(twist) - np.pi / sides
    x[sides:] = np.stack([np.cos(turns), np.sin(turns), np.full(sides, height)], axis=1)
    return x


@pytest.mark.parametrize(
    ("sides", "twist", "height", "other"),
    [(6, 50.0, 1.75, 0.91423104), (6, 45.0, 1.6, 0.33243083), (8, 60.0, 1.5, 0.63422467)],
)
def test_kresling_tower_has_a_second_state_without_strain(sides, twist, height, other):
    geometry, closed_form = kresling(sides=sides, twist=twist, height=height)
    assert closed_form == pytest.approx(other, abs=5e-9)
    problem = StaticProblem(geometry=geometry)
    begin = folded(geometry, sides, other + 0.05, 180 - twist - 4)
    found = find_equilibrium(problem, begin)
    np.testing.assert_allclose(found.positions[sides:, 2], closed_form, atol=1e-9)
    assert found.energy < 1e-20
    assert found.stability.kind == "stable"
    expected = folded(geometry, sides, closed_form, 180 - twist)
    np.testing.assert_allclose(found.positions, expected, atol=1e-9)


def test_search_finds_both_states_of_the_kresling_tower():
    geometry, other = kresling()
    states = find_stable_states(
        StaticProblem(geometry=geometry),
        rng=np.random.default_rng(0),
        n_starts=40,
        amplitude=1.0,
        soft_modes=1,
    )
    heights = sorted(state.positions[6:, 2].mean() for state in states if state.energy < 1e-16)
    assert heights[-1] == pytest.approx(1.75, abs=1e-9)
    assert any(height == pytest.approx(other, abs=1e-9) for height in heights)


# --- duplicates ---------------------------------------------------------------------------------


def tetrahedron():
    build = GeometryBuilder()
    nodes = build.add_nodes([[0, 0, 0], [1.2, 0, 0], [0.2, 1, 0], [0.3, 0.4, 0.9]])
    for a in range(4):
        for b in range(a):
            build.add_bar(nodes[a], nodes[b], stiffness=10.0)
    return build.geometry()


def test_free_body_is_the_same_wherever_it_lies_and_its_mirror_image_is_not():
    geometry = tetrahedron()
    x = geometry.positions
    turn = turn_matrix(np.array([0.6, 0, 0.8]), np.cos(2.0), np.sin(2.0))
    starts = [x, x @ turn.T + [3, -2, 7], x * [1, 1, -1]]
    states = find_stable_states(StaticProblem(geometry=geometry), starts=starts)
    assert sorted(state.starts for state in states) == [(0, 1), (2,)]


def test_supports_and_loads_limit_what_counts_as_the_same():
    geometry = tetrahedron()
    free = allowed_motions(StaticProblem(geometry=geometry))
    assert (free.rotation, free.translations.shape) == ("all", (3, 3))
    pull = np.zeros((4, 3))
    pull[[0, 3], 2] = [-1.0, 1.0]
    pulled = allowed_motions(StaticProblem(geometry=geometry, loads=pull))
    assert (pulled.rotation, pulled.translations.shape) == ("axis", (3, 3))
    np.testing.assert_allclose(np.abs(pulled.axis), [0, 0, 1], atol=1e-12)
    floor = np.zeros((4, 3), dtype=bool)
    floor[:3, 2] = True
    slides = allowed_motions(StaticProblem(geometry=geometry, held=floor, gravity=[0, 0, -1]))
    assert (slides.rotation, slides.translations.shape) == ("axis", (3, 2))
    pinned = np.zeros((4, 3), dtype=bool)
    pinned[:2] = True
    swings = allowed_motions(StaticProblem(geometry=geometry, held=pinned))
    assert (swings.rotation, swings.translations.shape) == ("axis", (3, 0))
    np.testing.assert_allclose(np.abs(swings.axis), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(swings.centre[1:], 0, atol=1e-12)
    heavy = allowed_motions(StaticProblem(geometry=geometry, held=pinned, gravity=[0, 0, -1]))
    assert (heavy.rotation, heavy.translations.shape) == ("none", (3, 0))
    # Node 2 can turn about the pins to first order, and then leaves its plane.
    rail = np.zeros((4, 3), dtype=bool)
    rail[:2], rail[2, 1] = True, True
    assert allowed_motions(StaticProblem(geometry=geometry, held=rail)).rotation == "none"


def test_pinned_body_is_the_same_at_every_angle_about_its_pins():
    geometry = tetrahedron()
    pinned = np.zeros((4, 3), dtype=bool)
    pinned[:2] = True
    problem = StaticProblem(geometry=geometry, held=pinned)
    motions = allowed_motions(problem)
    turn = turn_matrix(np.array([1.0, 0, 0]), np.cos(2.5), np.sin(2.5))
    x = geometry.positions
    assert motions.distance(x @ turn.T, x) < 1e-14
    assert motions.distance(x * [1, 1, -1], x) > 0.1


def test_sliding_body_is_aligned_about_its_own_centre():
    geometry = tetrahedron()
    floor = np.zeros((4, 3), dtype=bool)
    floor[:3, 2] = True
    motions = allowed_motions(StaticProblem(geometry=geometry, held=floor))
    turn = turn_matrix(np.array([0, 0, 1.0]), np.cos(2.5), np.sin(2.5))
    x = geometry.positions
    assert motions.distance(x @ turn.T + [4, 5, 0], x) < 1e-14
    assert motions.distance(x @ turn.T + [4, 5, 0.5], x) == pytest.approx(0.5)


def test_starts_without_equilibrium_are_counted():
    geometry, held = truss()
    problem = StaticProblem(geometry=geometry, held=held)
    away = geometry.positions.copy()
    away[1] = [0.3, 0, 0.7]
    starts = [geometry.positions, away]
    states = find_stable_states(problem, starts=starts, max_iterations=1)
    assert len(states) == 1
    assert list(states.failures) == [1]
    assert "no equilibrium after 1 iterations" in states.failures[1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "rng: no random generator"),
        ({"starts": np.zeros((3, 3))}, r"starts: shape \(3, 3\)"),
        ({"rng": np.random.default_rng(0), "n_starts": 0}, "n_starts: 0 starts"),
        ({"rng": np.random.default_rng(0), "amplitude": -1.0}, r"amplitude: amplitude -1.0"),
    ],
)
def test_wrong_arguments_are_named(settings, message):
    geometry, held = truss()
    with pytest.raises(ConfigError, match=message):
        find_stable_states(StaticProblem(geometry=geometry, held=held), **settings)
