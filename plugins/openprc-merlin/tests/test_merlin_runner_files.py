"""Recorded MERLIN runs, run again: every state in balance, every path found anew.

The numbers of limit points are read off the files, which are outputs of MERLIN and MERLIN2.
"""

from __future__ import annotations

from functools import cache
from itertools import islice

import numpy as np
import pytest
from openprc_merlin import containers, workspace
from openprc_merlin.arc_length import arc_length_path
from openprc_merlin.displacement_control import controlled_path
from openprc_merlin.equilibrium_path import Balance, PathSettings, newton
from openprc_merlin.path_control import STATION_ITERATIONS, choose_course, read_drives
from openprc_merlin.runner import _defaults
from openprc_merlin.workspace_experiment import workspace_experiment

from openprc.demlat.statics import StaticProblem

slow = pytest.mark.slow
FORCE = [
    pytest.param("merlin1_miura_folding.mat", marks=slow),
    pytest.param("merlin1_miura_bending.mat", marks=slow),
    pytest.param("merlin1_miura_bistable.mat", marks=slow),
    "merlin1_kresling_folding.mat",
]
DISPLACEMENT = [
    pytest.param("merlin2_gmiura_n5b8_disp.mat", marks=slow),
    "merlin2_simplefold_n4b5_disp.mat",
    "merlin2_kresling_n4b5_disp.mat",
    "merlin2_waterbomb_n5b8_disp.mat",
]
POLYGON = "merlin2_polygon_n5b8_force.mat"
ALL = [getattr(p, "values", (p,))[0] for p in (*FORCE, *DISPLACEMENT)] + [POLYGON]


class Run:
    """A workspace, what was saved of it, and the same body as a static problem."""

    def __init__(self, path):
        self.space = workspace.build(containers.read(path).variables, file=path)
        self.experiment = workspace_experiment(path)
        self.drives = read_drives(self.experiment)
        self.course = choose_course(self.experiment, self.drives, _defaults())
        self.states = self.space.nodes + self.space.displacements
        self.problem = StaticProblem(
            geometry=self.experiment.geometry,
            held=self.drives.held,
            positions=self.drives.stations[0].positions,
        )
        self.factors = np.ones(len(self.states))
        load = self.space.load
        self.reference = np.zeros_like(self.states[0])
        if load.mode == "force":
            self.factors = load.history[:, 0]
            self.reference = load.reference.reshape(-1, 3)

    def balance(self, allowed=STATION_ITERATIONS):
        settings = PathSettings(max_iterations=allowed)
        return Balance(self.problem, self.reference, settings=settings)

    def moved(self, points, dof):
        node, axis = divmod(dof, 3)
        return np.array([p[node, axis] for p in points]) - self.space.nodes[node, axis]


@pytest.fixture(scope="module")
def again(data):
    @cache
    def run(name):
        return Run(data / name)

    return run


@cache
def followed(run):
    """Return the path through the imposed displacements, or along the arc."""
    if run.space.load.mode == "force":
        path = arc_length_path(
            run.balance(15), run.problem.positions, first_factor=run.course.first_factor
        )
        return list(islice(path, len(run.states)))
    stations = run.drives.stations
    return list(
        controlled_path(run.balance(), run.problem.positions, stations[1:], begin=stations[0])
    )


@pytest.mark.parametrize("name", ALL)
def test_every_saved_state_is_in_balance(again, name):
    run = again(name)
    points = [
        run.balance().point(x, factor, iterations=0, n_negative=None)
        for x, factor in zip(run.states, run.factors, strict=True)
    ]
    assert max(point.residual for point in points) < (7e-5 if "folding.mat" in name else 2e-8)
    if run.space.load.mode == "displacement":
        pull = np.array([-p.reactions.ravel()[run.space.load.dofs] for p in points])
        np.testing.assert_allclose(pull, run.space.load.history, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_newton_returns_to_a_saved_state(again, name):
    run = again(name)
    chosen = range(0, len(run.states), max(1, len(run.states) // 6))
    apart = 0.0
    for number in chosen:
        balance = Balance(run.problem, run.factors[number] * run.reference)
        x, iterations, _ = newton(balance, run.states[number])
        apart = max(apart, np.abs(x - run.states[number]).max())
        assert iterations <= 3
    assert apart < 1e-6
    if run.space.load.mode == "displacement":
        return
    # From beside it too, as far as the stiffness allows.
    number = chosen[1]
    wobble = 1e-4 * np.random.default_rng(0).normal(size=run.states[0].shape)
    wobble[run.drives.held] = 0.0
    x, _, _ = newton(
        Balance(run.problem, run.factors[number] * run.reference), run.states[number] + wobble
    )
    assert np.abs(x - run.states[number]).max() < 1e-6


@pytest.mark.parametrize("name", FORCE)
def test_path_along_the_arc_is_that_of_merlin(again, name):
    run = again(name)
    points = followed(run)
    np.testing.assert_allclose([p.factor for p in points], run.factors, atol=1e-5)
    assert (
        max(np.abs(p.positions - x).max() for p, x in zip(points, run.states, strict=True)) < 2e-5
    )
    assert max(p.residual for p in points) < 1e-9


@pytest.mark.parametrize("name", DISPLACEMENT)
def test_path_through_the_displacements_is_that_of_merlin(again, name):
    run = again(name)
    points = followed(run)
    assert (
        max(np.abs(p.positions - x).max() for p, x in zip(points, run.states, strict=True)) < 2e-6
    )
    pull = np.array([-p.reactions.ravel()[run.space.load.dofs] for p in points])
    np.testing.assert_allclose(pull, run.space.load.history, atol=1e-8)
    assert max(p.residual for p in points) < 1e-8


def turns(u, load):
    """Return where the load turns: increment, displacement and load of cubic fits beside it."""
    found = []
    for i in np.flatnonzero(np.diff(np.sign(np.diff(load)))) + 1:
        near = slice(max(i - 2, 0), i + 3)
        s = np.arange(near.start, near.start + len(load[near])) - i
        cubic = np.polyfit(s, load[near], 3)
        roots = np.roots(np.polyder(cubic))
        at = roots[np.abs(roots - 0.0).argmin()].real
        found.append((i + 1, np.polyval(np.polyfit(s, u[near], 3), at), np.polyval(cubic, at)))
    return found


def check_turns(run, dof, expected):
    points = followed(run)
    u = run.moved([p.positions for p in points], dof)
    load = np.array([p.factor for p in points])
    found = turns(u, load)
    assert [number for number, _, _ in found] == [number for number, _, _ in expected]
    for number, where, height in expected:
        # At the very increments of the file ...
        assert u[number - 1] == pytest.approx(where, rel=1e-3)
        assert load[number - 1] == pytest.approx(height, rel=1e-3)
    for (_, _, smooth), (_, _, height) in zip(found, expected, strict=True):
        # ... and not far from where the continuous path turns.
        assert smooth == pytest.approx(height, rel=1e-2, abs=2e-3)
    return u, load, points


def test_kresling_tower_snaps_back(again):
    run = again("merlin1_kresling_folding.mat")
    expected = [
        (25, -0.5203, 0.35792),
        (34, -0.6065, -0.09577),
        (100, -1.3786, 0.34198),
        (132, -1.2339, -0.0892),
    ]
    points = followed(run)
    u = run.moved([p.positions for p in points], 3 * 40 + 2)
    load = np.array([p.factor for p in points])
    for number, where, height in expected:
        assert (u[number - 1], load[number - 1]) == (
            pytest.approx(where, rel=1e-3),
            pytest.approx(height, rel=1e-3),
        )
    # The top moves back up while the tower goes on folding.
    assert (np.diff(u) > 0).any()


@slow
def test_pop_through_of_the_miura_sheet(again):
    run = again("merlin1_miura_bistable.mat")
    expected = [(44, -0.9402, 2.31178), (91, -1.2742, -1.75007)]
    u, load, points = check_turns(run, 3 * 60 + 2, expected)
    assert (u[-1], load[-1]) == (pytest.approx(-2.6256, rel=1e-3), pytest.approx(2.7450, rel=1e-3))
    energy = run.problem.energy(points[-1].positions)
    assert energy == pytest.approx(2.46337, rel=1e-5)
    negative = np.array([p.n_negative for p in points])
    assert set(negative[:43]) == {0}
    assert set(negative[45:90]) == {1}
    assert set(negative[92:]) == {0}


def test_limit_point_does_not_depend_on_the_steps(again):
    # A third of MERLIN's steps; the peak is flat, so its height is sharp and its place is not.
    run = again("merlin1_kresling_folding.mat")
    path = arc_length_path(run.balance(15), run.problem.positions, first_factor=0.011)
    points = list(islice(path, 90))
    u = run.moved([p.positions for p in points], 3 * 40 + 2)
    increment, where, height = turns(u, np.array([p.factor for p in points]))[0]
    assert increment > 2 * 25
    assert height == pytest.approx(0.35792, rel=1e-3)
    assert where == pytest.approx(-0.5203, rel=2e-2)


@slow
def test_bent_miura_sheet_ends_where_merlin_does(again):
    run = again("merlin1_miura_bending.mat")
    last = followed(run)[-1]
    dof = run.space.load.dofs[0]
    assert run.moved([last.positions], dof)[0] == pytest.approx(-0.7204, rel=1e-3)
    assert last.factor == pytest.approx(78.528, rel=1e-4)


@slow
def test_folded_miura_sheet_pushes_as_rigid_panels_do(again):
    # E(g) = K/2 sum L (rho - rho0)^2 of one-parameter kinematics, F = -dE/dW (Schenk & Guest).
    run = again("merlin1_miura_folding.mat")
    points = followed(run)
    a, tangent, k = 2.0, np.tan(np.pi / 3), 0.1

    def width(g):
        return 10 * a * np.cos(g) * tangent / np.sqrt(1 + np.cos(g) ** 2 * tangent**2)

    def energy(g):
        start = np.radians(15.0)
        major = 2 * (g - start)
        minor = 2 * (np.arctan(0.5 * np.tan(g)) - np.arctan(0.5 * np.tan(start)))
        return 0.5 * k * 180 * (major**2 + minor**2)

    rest = run.space.nodes
    low, high = rest[:, 0].argmin(), rest[:, 0].argmax()
    ratios = []
    for number in (11, 41):
        x = points[number - 1].positions
        spread = x[high, 0] - x[low, 0]
        lower, upper = np.radians(1.0), np.radians(89.0)
        for _ in range(60):
            middle = 0.5 * (lower + upper)
            lower, upper = (middle, upper) if width(middle) > spread else (lower, middle)
        g, d = lower, 1e-5
        force = -(energy(g + d) - energy(g - d)) / (width(g + d) - width(g - d))
        ratios.append(11 * points[number - 1].factor / force)
    np.testing.assert_allclose(ratios, 1.0, atol=1e-3)


def test_waterbomb_pops_through_and_breaks_its_symmetry(again):
    run = again("merlin2_waterbomb_n5b8_disp.mat")
    points = followed(run)
    u = run.moved([p.positions for p in points], 2)
    pull = np.array([-p.reactions[0, 2] for p in points])
    at = {round(value, 3): number for number, value in enumerate(u)}
    assert pull[at[-10.5]] == pytest.approx(9.866, rel=1e-3)
    assert pull[at[-29.5]] == pytest.approx(-9.860, rel=1e-3)
    assert pull[at[-41.0]] == pytest.approx(21.66, rel=1e-3)
    assert abs(pull[at[-41.5]]) < 0.01
    negative = [p.n_negative for p in points]
    # MERLIN followed a branch that had lost its stability five units before.
    assert negative[at[-36.0]] == 0
    assert set(negative[at[-36.5] : at[-41.5]]) == {4}


def test_waterbomb_leaves_the_branch_where_it_loses_its_stability(again):
    run = again("merlin2_waterbomb_n5b8_disp.mat")
    stations = run.drives.stations[:76]
    points = list(
        controlled_path(
            run.balance(),
            run.problem.positions,
            stations[1:],
            begin=stations[0],
            unstable="settle",
        )
    )
    assert {p.n_negative for p in points} == {0}
    assert np.abs(points[71].positions - run.states[71]).max() < 1e-6
    assert abs(points[72].reactions[0, 2]) < 0.05 < abs(run.space.load.history[72, 0])


@slow
def test_point_loaded_miura_ends_where_merlin_does(again):
    run = again("merlin2_gmiura_n5b8_disp.mat")
    last = followed(run)[-1]
    dof = run.space.load.dofs[0]
    assert run.moved([last.positions], dof)[0] == pytest.approx(-30.108, rel=1e-4)
    assert -last.reactions.ravel()[dof] == pytest.approx(0.40952, rel=1e-4)
    assert run.problem.energy(last.positions) == pytest.approx(7.51669, rel=1e-5)


def test_bent_hexagon_passes_through_every_saved_state(again):
    # Flat, it has no stiffness against its load: steps differ from MERLIN's, the path does not.
    run = again(POLYGON)
    dof = run.space.load.dofs[0]
    path = arc_length_path(run.balance(15), run.problem.positions, first_factor=1e-5)
    points = []
    for point in path:
        points.append(point)
        if run.moved([point.positions], dof)[0] < -12.3:
            break
    u = -run.moved([p.positions for p in points], dof)
    load = np.array([p.factor for p in points])
    where = -run.moved(run.states, dof)
    smooth = np.array([_local(u, load, w) for w in where])
    np.testing.assert_allclose(smooth[1:], run.factors[1:], rtol=1e-4)


def _local(u, load, at):
    """Interpolate with a cubic through four neighbours, in the power that the law has."""
    i = int(np.clip(np.searchsorted(u, at) - 2, 0, len(u) - 4))
    near = slice(i, i + 4)
    x = u[near] ** (1 / 3)
    basis = [
        np.prod([(at ** (1 / 3) - x[m]) / (x[n] - x[m]) for m in range(4) if m != n])
        for n in range(4)
    ]
    return float(np.dot(basis, load[near]))
