"""The implicit midpoint rule: closed forms, order, stability at any stiffness, all laws."""

from dataclasses import replace

import numpy as np
import pytest
from from_python import callable_

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import find_integrator, tangents
from openprc.demlat.integrators.tangents import Tangent
from openprc.demlat.models.barhinge import bend_second as second_derivatives
from openprc.demlat.models.barhinge import dynamics_kernels
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.demlat.models.barhinge.tables import LEDGER, LEDGER_STRIDE
from openprc.demlat.statics.element_shapes import hinge_hessians
from openprc.errors import Diverged
from openprc.schema.experiment import Actuator, Signal

X, Y, Z = np.eye(3)


@pytest.fixture
def counted(simulate, monkeypatch):
    """Run an experiment and return it with what the scheme counted."""
    scheme = find_integrator("midpoint").load()
    make = scheme.for_body.__func__
    made = []

    def for_body(cls, body, settings):
        made.append(make(cls, body, settings))
        return made[-1]

    monkeypatch.setattr(scheme, "for_body", classmethod(for_body))

    def run(experiment):
        return simulate(replace(experiment, integrator="midpoint")), made[-1].counts

    return run


def plate(body, **settings):
    h = 0.8
    positions = np.array([0 * X, X, [0.5, -h, 0.2], [0.5, h, 0.3]])
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    lengths = [np.linalg.norm(positions[i] - positions[j]) for i, j in pairs]
    return body(
        positions,
        [0.1] * 4,
        bars=[(i, j, 50, 1.02 * n, 0.01) for (i, j), n in zip(pairs, lengths, strict=True)],
        hinges=[(0, 1, 2, 3, 0.5, np.pi + 0.5, 0.01)],
        **{"save_interval": 0.25, "duration": 1.0, "dt": 0.25 / 16} | settings,
    )


def test_an_oscillator_turns_as_the_rule_says_it_does(body, counted):
    # tan(phase / 2) = h omega / 2, and the energy is that of the start, at any step.
    k, m, a, h = 100.0, 1.0, 0.1, 0.5
    scene = body(
        [0 * X, (1 + a) * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 0)],
        fixed=[True, False],
        save_interval=h,
        duration=10.0,
        dt=h,
    )
    run, counts = counted(scene)
    phase = 2.0 * np.arctan(0.5 * h * np.sqrt(k / m))
    expected = 1.0 + a * np.cos(phase * np.arange(len(run.t)))
    np.testing.assert_allclose(run.x[:, 1, 0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.energy.sum(axis=1), 0.5 * k * a**2, rtol=1e-12)
    assert counts[4] == 1  # one factorisation does for the whole run of a linear body


def test_second_order_with_hinges_and_dampers(body, simulate, counted):
    scene = plate(body)
    truth = simulate(replace(scene, dt=0.25 / 512))
    wrong, gaps = [], []
    for n in (32, 64, 128):
        run, _ = counted(replace(scene, dt=0.25 / n))
        wrong.append(np.abs(run.x - truth.x).max())
        gaps.append(np.abs(run.balance).max())
    for errors in (wrong, gaps):
        assert np.log2(errors[-2] / errors[-1]) == pytest.approx(2.0, abs=0.15)


def test_driven_nodes_move_along(body, simulate, counted):
    rng = np.random.default_rng(1)
    scene = plate(body, duration=0.5)
    lift = Signal(
        name="u",
        values=scene.geometry.positions[2] + 0.05 * rng.uniform(-1, 1, (9, 3)),
        dt=0.0625,
        interpolation="cubic",
    )
    scene = replace(scene, signals={"u": lift}, actuators=(Actuator(node=2, signal="u"),))
    truth = simulate(replace(scene, dt=0.25 / 512))
    runs = [counted(replace(scene, dt=0.25 / n))[0] for n in (32, 64, 128)]
    wrong = [np.abs(run.x - truth.x).max() for run in runs]
    gaps = [np.abs(run.balance).max() for run in runs]
    assert np.log2(wrong[-2] / wrong[-1]) == pytest.approx(2.0, abs=0.2)
    assert np.log2(gaps[-2] / gaps[-1]) == pytest.approx(2.0, abs=0.3)
    np.testing.assert_allclose(runs[-1].work_in, truth.work_in, atol=0.02 * np.ptp(truth.work_in))


@pytest.mark.parametrize("ratio", [1e6, 1e12, 1e15])
def test_any_ratio_of_stiffnesses(body, counted, ratio):
    # The two nodes of the stiff bar move as one: two masses in two modes.
    scene = body(
        [0 * X, X, 2 * X, 3.2 * X],
        [1.0] * 4,
        bars=[(0, 1, 1.0, 1, 0), (1, 2, ratio, 1, 0), (2, 3, 1.0, 1, 0)],
        fixed=[True, False, False, False],
        duration=2.0,
        dt=0.01,
        save_interval=0.1,
        step_check="warn",
    )
    run, _ = counted(scene)
    half = np.diag([1.0, 1.0]) / np.sqrt([2.0, 1.0])
    squares, modes = np.linalg.eigh(half @ np.array([[2.0, -1.0], [-1.0, 1.0]]) @ half)
    start = modes.T @ np.linalg.solve(half, [0.0, 0.2])
    motion = half @ modes @ (start[:, None] * np.cos(np.sqrt(squares)[:, None] * run.t))
    np.testing.assert_allclose(run.x[:, 3, 0], 3.0 + motion[1], rtol=0, atol=1e-5)
    energy = run.energy.sum(axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


def all_laws(body):
    """A body with every law, some bars slack and one hinge beyond its limit."""
    positions = np.array([0 * X, X, [0.5, -0.8, 0.2], [0.5, 0.8, 0.3], [0.4, 0.1, 1.0]])
    pairs = [(i, j) for i in range(5) for j in range(i)]
    lengths = [np.linalg.norm(positions[i] - positions[j]) for i, j in pairs]
    factors = [0.9, 1.1] * 5
    scene = body(
        positions,
        [0.1, 0.2, 0.3, 0.4, 0.5],
        bars=[(i, j, 50, f * n, 0.2) for (i, j), n, f in zip(pairs, lengths, factors, strict=True)],
        hinges=[(0, 1, 2, 3, 5, 2.2, 0.1), (0, 4, 2, 3, 5, 2.0, 0), (1, 4, 2, 3, 5, 2, 0.2)],
        fixed=[True, False, False, False, False],
        damping=0.3,
        integrator="midpoint",
    )
    g = scene.geometry
    bars = replace(
        g.bars,
        law=np.repeat(["linear", "cubic", "cable", "strut", "ogden"], 2),
        stiffness_cubic=np.full(10, 400.0),
        damping_cubic=np.full(10, 0.1),
    )
    hinges = replace(
        g.hinges,
        law=np.array(["linear", "enhanced-linear", "enhanced-linear"]),
        limit_low=np.array([0.0, 3.0, 0.5]),
        limit_high=np.array([2 * np.pi, 3.5, 6.0]),
    )
    return replace(scene, geometry=replace(g, bars=bars, hinges=hinges))


def test_tangents_of_every_law_are_differences_of_the_forces(body):
    assembly = assemble([all_laws(body)])
    tables, x = assembly.body, assembly.state.x.copy()
    tangent = Tangent.for_body(tables)
    factor, free = tangent.factor, tangent.free
    rates = np.zeros(len(LEDGER) * LEDGER_STRIDE)
    evaluate, fill = callable_(dynamics_kernels.evaluate), callable_(tangents.assemble)

    def force(x, v):
        out = np.zeros_like(x)
        evaluate(tables, x, v, out, rates, 0.0, 0.0, 1.0)
        return out[free]

    def matrix(v, by_x, by_v):
        fill(tangent, tables, x, v, by_x, by_v, False)
        columns = np.repeat(np.arange(len(free)), np.diff(factor.start))
        dense = np.zeros((len(free), len(free)))
        dense[factor.order[factor.row], factor.order[columns]] = factor.values[:-1]
        return dense + dense.T - np.diag(np.diag(dense))

    step = 1e-6
    shift = np.zeros((len(free), x.size))
    shift[np.arange(len(free)), free] = step
    rest = np.zeros_like(x)
    moving = np.where(tables.inverse_mass > 0, np.random.default_rng(0).normal(size=x.size), 0.0)
    mass = np.diag(tables.mass[free])
    np.testing.assert_array_equal(matrix(rest, 0.0, 0.0), mass)
    # How dashpots depend on positions is left out, so the stiffness is compared at rest.
    stiffness = -np.array([force(x + s, rest) - force(x - s, rest) for s in shift]) / (2 * step)
    damping = -np.array([force(x, moving + s) - force(x, moving - s) for s in shift]) / (2 * step)
    for found, expected in (
        (matrix(rest, 1.0, 0.0) - mass, stiffness),
        (matrix(moving, 0.0, 1.0) - mass, damping),
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_second_derivatives_of_the_bend(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(4, 3))
    expected = hinge_hessians(x, np.array([[0, 1, 2, 3]]))[0]
    j, k, i, l = x  # noqa: E741
    parts = np.zeros((5, 3, 3))
    callable_(second_derivatives.bend_second)(tuple(i - j), tuple(k - j), tuple(k - l), parts)
    entry = callable_(second_derivatives.pair_second)
    for number, (first, other) in enumerate(second_derivatives.PAIRS):
        block = [[entry(parts, number, r, c) for c in range(3)] for r in range(3)]
        np.testing.assert_allclose(block, expected[first, :, other], rtol=1e-10, atol=1e-10)


def test_a_step_without_solution_is_named(body, simulate):
    scene = plate(body, velocities=np.full((4, 3), np.nan), integrator="midpoint")
    # The look at the frames, which would name the velocity at t = 0, is left out.
    with pytest.raises(Diverged, match=r"the implicit step before t = .* in 4096 pieces: node"):
        for _ in BarHingeModel(scene)._integrated():
            pass
