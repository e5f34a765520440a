"""Equilibria, modes, stable steps and mechanisms of bodies with bends."""

from dataclasses import replace

import numpy as np
import pytest
from slender_bodies import (
    LENGTH,
    RIGIDITY,
    cantilever,
    crooked_chain,
    experiment,
    numpy_forces,
    tip_deflection,
    triples,
)

from openprc.demlat.planning.mechanisms import mechanisms
from openprc.demlat.planning.plan import make_plan
from openprc.demlat.planning.scene_checks import scene_findings
from openprc.demlat.planning.stability import is_surely_sound, stable_step, step_limit
from openprc.demlat.planning.tangent_operators import TangentOperators
from openprc.demlat.statics import StaticProblem, find_equilibrium, natural_modes
from openprc.demlat.statics.bending import bend_turns
from openprc.errors import ConfigError, Diverged
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import Bars, Bends, Geometry

# --- equilibria ----------------------------------------------------------------------------------

#: Tips under 0.005 N: a Cosserat rod of n elements less its shear, and rigid hinged links.
TIPS = {5: 0.00954815, 10: 0.01133811, 20: 0.01228276, 50: 0.01286544, 100: 0.01306231}


def loaded(geometry, force, *, gravity=(0.0, 0.0, 0.0)):
    loads = np.zeros((geometry.n_nodes, 3))
    loads[-1] = force
    return StaticProblem(geometry=geometry, loads=loads, gravity=gravity)


@pytest.mark.parametrize("n", TIPS)
def test_tips_of_cantilevers(n):
    found = find_equilibrium(loaded(cantilever(n), [0.0, 0.0, -0.005]))
    tip = -found.positions[-1, 2]
    assert tip == pytest.approx(TIPS[n], rel=1e-6)
    assert tip == pytest.approx(tip_deflection(n, 0.005), rel=2e-4)
    assert found.stability.kind == "stable"
    ends = found.positions[-1, 0] - found.positions[1:-1, 0]
    np.testing.assert_allclose(-found.bend_torques, 0.005 * ends, rtol=1e-6)
    np.testing.assert_allclose(found.reactions.sum(axis=0), [0, 0, 0.005], atol=1e-9)


def test_small_deflections_are_the_discrete_beam_in_any_direction():
    turned = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    n, force = 8, 1e-6
    for side in (1, 2):
        problem = loaded(cantilever(n, axis=turned[0]), force * turned[side])
        shift = find_equilibrium(problem).positions[-1] - problem.geometry.positions[-1]
        expected = tip_deflection(n, force) * turned[side]
        np.testing.assert_allclose(shift, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_a_cantilever_whose_rest_is_a_circle_closes():
    n = 20
    geometry, angle = cantilever(n), 2.0 * np.pi / n

    def curled(turn):
        heading = turn * np.arange(n)
        steps = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1) * LENGTH / n
        return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    rest = replace(geometry.bends, rest_angle=np.full(n - 1, np.pi - angle))
    start = replace(geometry, positions=curled(1.3 * angle), bends=rest)
    found = find_equilibrium(StaticProblem(geometry=start))
    np.testing.assert_allclose(found.positions, curled(angle), rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.positions[-1], 0.0, atol=1e-7)
    assert found.energy < 1e-12
    # Nothing resists torsion: the dihedral angles are free.
    assert found.stability.n_negative == 0
    assert found.stability.n_mechanisms == n - 2


def test_a_column_buckles_at_the_load_of_its_discrete_form():
    """``P = 4 (E I / l^2) sin^2(pi / (4 n - 2))`` for n segments of which the first is clamped.

    With rigid links the deflections obey ``w'' + (P l / k) w = 0`` in differences, whose clamped
    and free ends are met by a sine of that wave number (Wang 1951, doi:10.1115/1.4010240, for
    Hencky's chain).
    """
    n = 10
    geometry = cantilever(n)
    l, k = LENGTH / n, RIGIDITY * n / LENGTH  # noqa: E741
    critical = 4.0 * k / l * np.sin(np.pi / (4.0 * n - 2.0)) ** 2
    stiff = replace(geometry, bars=replace(geometry.bars, stiffness=1e2 * geometry.bars.stiffness))
    for share, kind in ((0.999, "stable"), (1.001, "unstable")):
        problem = loaded(stiff, [-share * critical, 0, 0])
        found = find_equilibrium(problem, kind="stationary")
        assert found.stability.kind == kind


def test_the_gradient_and_the_matrix_are_those_of_the_energy():
    geometry = crooked_chain(7, fixed=(0,))
    problem = StaticProblem(geometry=geometry, gravity=(0, 0.3, -1.0))
    rng = np.random.default_rng(2)
    x = geometry.positions + 0.1 * rng.standard_normal(geometry.positions.shape)
    still = experiment(geometry, gravity=(0, 0.3, -1.0))
    np.testing.assert_allclose(
        problem.gradient(x), -numpy_forces(still, x, np.zeros_like(x)), rtol=0, atol=1e-12
    )
    matrix = problem.hessian(x).toarray()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-12)
    for direction in rng.standard_normal((4, len(problem.free))):
        step = np.zeros(x.size)
        step[problem.free] = 1e-6 * direction
        ends = [problem.gradient(x + sign * step.reshape(x.shape)) for sign in (1, -1)]
        slope = (ends[0] - ends[1]).ravel()[problem.free] / 2e-6
        np.testing.assert_allclose(matrix @ direction, slope, rtol=0, atol=1e-6)
        energies = [problem.energy(x + sign * step.reshape(x.shape)) for sign in (1, -1)]
        push = problem.gradient(x).ravel()[problem.free] @ direction
        assert (energies[0] - energies[1]) / 2e-6 == pytest.approx(push, rel=1e-6)


def test_energies_come_apart_by_kind():
    geometry = crooked_chain(5)
    problem = StaticProblem(geometry=geometry)
    bars, hinges, bends, applied = problem.energies(geometry.positions)
    turns = bend_turns(geometry.positions, geometry.bends.indices)
    change = np.pi - turns - geometry.bends.rest_angle
    np.testing.assert_allclose(bends, 0.5 * geometry.bends.stiffness * change**2, rtol=1e-13)
    np.testing.assert_allclose(
        problem.bend_torques(geometry.positions), geometry.bends.stiffness * change, rtol=1e-13
    )
    assert len(bars) == 4
    assert len(hinges) == 0
    assert not applied.any()


def test_loads_on_a_chain_that_nothing_holds_are_refused():
    alone = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [2, 0.5, 0]],
        masses=np.ones(3),
        bends=Bends(indices=[[0, 1, 2]], stiffness=[1.0]),
    )
    with pytest.raises(ConfigError, match="a load of 1 N along y on the piece of node 0"):
        find_equilibrium(loaded(alone, [0, 1.0, 0]))


# --- modes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "first"), [(10, 0.195729), (20, 0.186072)])
def test_bending_frequencies_of_cantilevers(n, first):
    geometry = cantilever(n)
    modes = natural_modes(StaticProblem(geometry=geometry), geometry.positions, n=2)
    np.testing.assert_allclose(modes.frequencies, first, rtol=3e-6)


def test_frequencies_converge_to_the_beam():
    """``1.8751041^2 sqrt(E I / (rho A L^4)) / 2 pi`` of Euler and Bernoulli, in first order."""
    exact = 1.875104068711961**2 * np.sqrt(RIGIDITY / (1000.0 * np.pi * 0.02**2)) / (2.0 * np.pi)
    errors = []
    for n in (40, 80, 160):
        geometry = cantilever(n)
        modes = natural_modes(StaticProblem(geometry=geometry), geometry.positions, n=1)
        errors.append(modes.frequencies[0] / exact - 1.0)
    np.testing.assert_allclose(np.log2(errors[:-1]) - np.log2(errors[1:]), 1.0, atol=0.03)


# --- before a run --------------------------------------------------------------------------------


def dense_stiffness(geometry, problem):
    root = 1.0 / np.sqrt(np.repeat(geometry.masses, 3)[problem.free])
    return problem.hessian(geometry.positions).toarray() * root[:, None] * root


@pytest.mark.parametrize("rest", ["bent", "straight"])
def test_the_stable_step_is_that_of_the_matrix(rest):
    geometry = crooked_chain(8, fixed=(0, 3), rest=rest)
    problem = StaticProblem(geometry=geometry)
    matrix = dense_stiffness(geometry, problem)
    scene = experiment(geometry, integrator="verlet")
    operators = TangentOperators(scene)
    direction = np.random.default_rng(0).standard_normal(operators.n_free)
    np.testing.assert_allclose(operators.stiffness(direction), matrix @ direction, rtol=1e-9)
    largest = np.linalg.eigvalsh(matrix)[-1]
    assert operators.stiffness_bound() >= largest
    assert stable_step(scene) == pytest.approx(2.0 / np.sqrt(largest), rel=1e-6)


def test_the_bend_that_sets_the_step_is_named(simulate):
    geometry = cantilever(6)
    bends = replace(geometry.bends, stiffness=np.where(np.arange(5) == 3, 200.0, 0.01))
    scene = experiment(replace(geometry, bends=bends), integrator="verlet")
    limit = step_limit(scene)
    assert limit.setter == "bend 3 at node 4"
    assert not is_surely_sound(replace(scene, dt=limit.limit))
    assert is_surely_sound(replace(scene, dt=0.3 * limit.limit))
    plan = make_plan(scene)
    assert plan.n_bends == 5
    assert ("bends", "5") in plan.rows()
    kick = np.zeros((7, 3))
    kick[2:, 1] = 1e-4 * (-1.0) ** np.arange(5)
    moved = replace(scene, geometry=replace(scene.geometry, velocities=kick), step_check="warn")

    def run(share):
        dt = share * limit.limit
        return simulate(replace(moved, dt=dt, save_interval=20 * dt, duration=400 * dt))

    assert (np.pi - run(0.97).bend_angle[:, 3]).max() < 1e-4
    with pytest.raises(Diverged, match=r"'verlet' made \S+ J of energy"):
        run(1.03)


def test_the_dashpot_that_sets_the_step_is_named():
    geometry = cantilever(6, bend_damping=1e-6)
    strong = np.where(np.arange(5) == 2, 50.0, 0.0)
    scene = experiment(
        replace(geometry, bends=replace(geometry.bends, damping=strong)), integrator="verlet"
    )
    limit = step_limit(scene)
    assert limit.damped
    assert limit.setter == "bend 2 at node 3"
    row = np.array([6.0, -12.0, 6.0])
    rate = 50.0 * (row**2 / geometry.masses[2:5]).sum()
    assert limit.limit == pytest.approx(1.0 / rate, rel=0.05)
    assert TangentOperators(scene).damping_bound() >= rate


def test_driven_ends_that_meet_the_vertex_leave_the_estimate_alone():
    geometry = crooked_chain(4, fixed=(0,))
    onto = Signal(name="onto", values=geometry.positions[2][None], dt=1.0, interpolation="hold")
    scene = experiment(
        geometry,
        signals={"onto": onto},
        actuators=(Actuator(node=3, signal="onto", type="position"),),
    )
    assert np.isfinite(step_limit(scene).limit)


def test_chains_have_mechanisms_only_without_bends():
    clamped, falling = cantilever(6), {"gravity": (0.0, 0.0, -1.0)}
    assert mechanisms(experiment(clamped)) == mechanisms(experiment(clamped, **falling)) == (0, 0)
    soft = replace(clamped, bends=replace(clamped.bends, stiffness=np.zeros(5)))
    assert mechanisms(experiment(soft)) == (5, 0)
    assert mechanisms(experiment(soft, **falling)) == (10, 0)
    flying = replace(clamped, fixed=np.zeros(7, dtype=bool))
    # A rod cannot be told from one that turns about its axis.
    assert mechanisms(experiment(flying, **falling)) == (0, 5)
    assert mechanisms(experiment(flying)) == (0, 3)
    curved = replace(crooked_chain(6), velocities=np.zeros((6, 3)))
    # Angles leave every dihedral of the chain free.
    assert mechanisms(experiment(curved)) == (3, 6)


def test_bends_connect_pieces_and_idle_ones_are_found():
    geometry = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [2, 0.2, 0], [3, 0, 0]],
        masses=np.ones(4),
        fixed=[True, True, True, False],
        bars=Bars(indices=[[2, 3]], stiffness=[1.0], rest_length=[1.0]),
        bends=Bends(indices=triples(4), stiffness=[1.0, 1.0]),
    )
    found = list(scene_findings(experiment(geometry)))
    assert [finding.code for finding in found] == ["PLAN-IDLE-BENDS"]
    assert found[0].found == "1 bends between fixed nodes (0)"
