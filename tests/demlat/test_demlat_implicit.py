"""The implicit midpoint rule: closed forms, order, stability at any stiffness, all laws."""

from dataclasses import replace

import numpy as np
import pytest
from from_python import callable_

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import find_integrator
from openprc.demlat.models.barhinge import bend_second as second_derivatives
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


def test_every_law_has_its_tangent(body, counted):
    # With the right tangents a factorisation at each step halves the digits that are missing;
    # with wrong ones the iteration would need many more, or fail.
    positions = np.array([0 * X, X, [0.5, -0.8, 0.2], [0.5, 0.8, 0.3], [0.4, 0.1, 1.0]])
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (4, 0), (4, 1), (4, 2), (4, 3)]
    lengths = [np.linalg.norm(positions[i] - positions[j]) for i, j in pairs]
    scene = body(
        positions,
        [0.1] * 5,
        bars=[(i, j, 50, 0.97 * n, 0.02) for (i, j), n in zip(pairs, lengths, strict=True)],
        hinges=[(0, 1, 2, 3, 0.5, 2.2, 0.01), (0, 4, 2, 3, 0.5, 2.0, 0.0)],
        duration=1.0,
        dt=0.05,
        save_interval=0.05,
        fixed=[True, True, False, False, False],
    )
    g = scene.geometry
    laws = ["linear", "cubic", "cable", "strut", "ogden", "ogden", "cubic", "cable", "linear"]
    bars = replace(
        g.bars, law=np.array(laws), stiffness_cubic=np.full(9, 400.0), damping_cubic=np.full(9, 0.1)
    )
    hinges = replace(
        g.hinges,
        law=np.full(2, "enhanced-linear"),
        limit_low=np.full(2, 2.2),
        limit_high=np.full(2, 2.6),
    )
    run, counts = counted(replace(scene, geometry=replace(g, bars=bars, hinges=hinges)))
    assert np.abs(run.x - run.x[0]).max() > 0.02
    steps, solves, halvings = counts[2], counts[3], counts[5]
    assert halvings == 0
    assert solves <= 8 * steps
    assert np.abs(run.balance).max() < 0.05 * run.energy[0].sum()


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
    with pytest.raises(Diverged, match=r"the implicit step before t = .* in 4096 pieces: node"):
        for _ in BarHingeModel(scene).blocks():
            pass
