"""Bodies with rigid elements in motion: closed forms, invariants, order, and what goes wrong."""

from dataclasses import replace

import numpy as np
import pytest
from rigid_scenes import G, links, panels, pendulum, scene, sheet
from scipy.special import ellipk

from openprc.demlat import BarHingeModel
from openprc.errors import ConfigError, Diverged
from openprc.schema.experiment import Actuator, Collision, Signal

SCHEMES = {"rattle": 2, "rk4-projection": 2, "rk4-dae": 4}


def violation(run, experiment):
    bars = experiment.geometry.bars
    along = np.diff(run.x[:, bars.indices], axis=2)[:, :, 0]
    return np.abs(np.linalg.norm(along, axis=2) / bars.rest_length - 1.0)[:, bars.rigid].max()


def orders(values):
    return np.log2(np.array(values[:-1]) / np.array(values[1:]))


# --- closed forms -----------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "tolerance"), [("rattle", 2e-4), ("rk4-dae", 1e-8)])
def test_a_pendulum_comes_back_after_its_period_of_elliptic_integrals(simulate, name, tolerance):
    angle, length = 2.0, 0.7
    period = 4.0 * np.sqrt(length / G) * ellipk(np.sin(0.5 * angle) ** 2)
    swing = pendulum(
        angle, duration=period, dt=period / 400, save_interval=period / 4, integrator=name
    )
    run = simulate(swing)
    assert np.abs(run.x[-1] - run.x[0]).max() < tolerance
    bob = run.x[:, 1]
    np.testing.assert_allclose(bob[2], bob[0] * [-1, 1, 1], atol=tolerance)
    # Speed and tension from energy, at the bottom and elsewhere.
    cosine = -bob[:, 2] / length
    speed2 = 2.0 * G * length * (cosine - np.cos(angle))
    expected = 0.3 * (G * cosine + speed2 / length)
    np.testing.assert_allclose(run.tension[:, 0], expected, atol=100 * tolerance)
    assert run.tension[0, 0] == pytest.approx(0.3 * G * np.cos(angle), rel=1e-12)  # it pushes
    np.testing.assert_allclose(run.length, length, rtol=1e-13)


def test_a_rigid_plate_swings_as_a_physical_pendulum(simulate):
    # The rigid hinge makes one body of two triangles that turn about the fixed crease.
    still = panels(2.0, fixed=(0, 1), gravity=(0, 0, -G), masses=[1.0, 1.0, 0.5, 0.2])
    wings = still.geometry.positions[2:, 1:]
    masses = still.geometry.masses[2:, np.newaxis]
    inertia, lever = np.sum(masses * wings**2), np.sum(masses * wings, axis=0)
    arm = np.linalg.norm(lever)
    angle = np.arctan2(lever[0], -lever[1])
    period = 4.0 * np.sqrt(inertia / (arm * G)) * ellipk(np.sin(0.5 * angle) ** 2)
    times = {"duration": period, "save_interval": period / 2, "dt": period / 500}
    run = simulate(replace(still, integrator="rk4-dae", **times))
    assert np.abs(run.x[-1] - run.x[0]).max() < 1e-7
    assert np.abs(run.x[1] - run.x[0]).max() > 0.3
    np.testing.assert_allclose(run.angle, 2.0, atol=1e-12)
    # The moment at the start is what keeps the lighter wing from turning on its own.
    turning = -(lever[0] * G) / inertia
    own = turning * 0.5 * np.sum(wings[0] ** 2)
    assert abs(run.moment[0, 0]) == pytest.approx(abs(own + 0.5 * G * wings[0, 0]), rel=1e-10)


def test_a_tumbling_tetrahedron_keeps_what_a_free_body_keeps(simulate):
    rng = np.random.default_rng(3)
    x = rng.normal(size=(4, 3))
    masses = rng.uniform(0.5, 2.0, 4)
    v = np.cross([1.0, -2.0, 0.5], x) + np.array([0.3, 0.2, -0.1])
    free = scene(
        x,
        bars=[(i, j) for i in range(4) for j in range(i)],
        masses=masses,
        velocities=v,
        duration=10.0,
        dt=5e-3,
        save_interval=1.0,
    )
    run = simulate(free)
    momentum = np.einsum("n,tna->ta", masses, run.v)
    spin = np.einsum("n,tna->ta", masses, np.cross(run.x, run.v))
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(spin - spin[0], 0.0, atol=1e-11)
    assert np.abs(run.kinetic / run.kinetic[0] - 1.0).max() < 1e-3
    assert np.abs(run.kinetic[-1] / run.kinetic[0] - 1.0) < 1e-3  # bounded, without a trend
    assert violation(run, free) < 1e-12
    assert np.abs(run.x[-1] - run.x[0]).max() > 1.0


# --- order ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCHEMES)
def test_order_on_a_chain_with_soft_and_damped_elements(simulate, name):
    chain = links(
        4,
        duration=0.4,
        save_interval=0.1,
        rigid_bars=[True, True, True, False],
        stiffness=20.0,
        damping=0.05,
    )
    steps = [0.1 / n for n in (40, 80, 160)]
    truth = simulate(replace(chain, integrator="rk4-dae", dt=0.1 / 1280))
    runs = [simulate(replace(chain, integrator=name, dt=dt)) for dt in steps]
    scale = np.abs(truth.x - truth.x[0]).max()
    for wrong in (
        [np.abs(run.x - truth.x).max() for run in runs],
        [np.abs(run.tension - truth.tension).max() for run in runs],
        [np.abs(run.balance).max() for run in runs],
    ):
        assert orders(wrong)[-1] == pytest.approx(SCHEMES[name], abs=0.35)
    assert np.abs(runs[-1].x - truth.x).max() < 1e-3 * scale
    for run in runs:
        assert violation(run, chain) < 1e-12


def shaken(nodes, positions):
    rng = np.random.default_rng(0)
    lift = 0.01 * rng.uniform(-1, 1, (9, 3))
    lift[0] = 0.0
    signals = [
        Signal(name=f"u{n}", values=positions[n] + lift, dt=0.05, interpolation="cubic")
        for n in nodes
    ]
    return signals, [Actuator(node=int(n), signal=f"u{n}", type="position") for n in nodes]


@pytest.mark.parametrize("name", SCHEMES)
def test_order_on_a_rigid_sheet_shaken_at_its_base(simulate, name):
    body = sheet(driven=shaken, duration=0.2, save_interval=0.05, gravity=(0, 0, -G))
    body = replace(body, damping=0.002)
    truth = simulate(replace(body, integrator="rk4-dae", dt=0.05 / 320))
    runs = [simulate(replace(body, integrator=name, dt=0.05 / n)) for n in (10, 20, 40)]
    wrong = [np.abs(run.x - truth.x).max() for run in runs]
    gap = [np.abs(run.balance).max() for run in runs]
    assert np.mean(orders(wrong)) > SCHEMES[name] - 0.3
    assert np.mean(orders(gap)) > SCHEMES[name] - 0.3
    assert gap[-1] < 0.01 * np.ptp(truth.work_in)
    for run in runs:
        assert violation(run, body) < 1e-12


def test_velocities_that_jump_are_passed_on_and_their_work_is_booked(simulate):
    pulled = Signal(name="u", values=[[0, 0, 0], [0.02, 0, 0], [0.0, 0.03, 0]], dt=0.1)
    chain = links(
        fixed=(),
        gravity=(0, 0, 0),
        duration=0.3,
        save_interval=0.1,
        signals=[pulled],
        actuators=[Actuator(node=0, signal="u")],
    )
    gaps = []
    for n in (10, 20, 40):
        run = simulate(replace(chain, dt=0.1 / n))
        gaps.append(np.abs(run.balance).max())
        assert violation(run, chain) < 1e-12
        # All nodes of the straight chain are taken along at once.
        np.testing.assert_allclose(run.v[0, :, 0], 0.2, rtol=1e-12)
    assert np.ptp(run.work_in) > 1e-4
    assert np.mean(orders(gaps)) > 1.8


def test_stiff_springs_tend_to_the_rigid_bars(simulate):
    rigid = links(duration=0.2, save_interval=0.1)
    truth = simulate(replace(rigid, integrator="rk4-dae", dt=1e-3))
    gaps = []
    for stiffness in (1e3, 1e4, 1e5):
        bars = replace(
            rigid.geometry.bars, rigid=np.zeros(3, dtype=bool), stiffness=np.full(3, stiffness)
        )
        soft = replace(rigid, geometry=replace(rigid.geometry, bars=bars), dt=1e-4)
        run = simulate(replace(soft, integrator="rk4-dae"))
        gaps.append(np.abs(run.x - truth.x).max())
    np.testing.assert_allclose(np.log10(np.array(gaps[:-1]) / gaps[1:]), 1.0, atol=0.15)


# --- stops ------------------------------------------------------------------------------------


def test_a_falling_flap_comes_to_rest_on_its_stop(simulate):
    # The right wing falls about the fixed crease until the hinge reaches its stop.
    flap = panels(
        2.5,
        fixed=(0, 1, 2),
        gravity=(0, 0, -G),
        rigid_hinges=False,
        limits=(0.0, 4.0),
        integrator="rk4-projection",
        duration=2.0,
        dt=2e-3,
        save_interval=0.05,
    )
    run = simulate(flap)
    angle = run.angle[:, 0]
    assert angle[0] == pytest.approx(2.5)
    assert angle.max() < 4.0 + 1e-11
    rested = run.t > 1.0
    np.testing.assert_allclose(angle[rested], 4.0, atol=1e-11)
    np.testing.assert_allclose(run.v[rested], 0.0, atol=1e-10)
    assert violation(run, flap) < 1e-11
    # What it had fallen by then is lost in the impact.
    lost = run.ledger[-1, 4]
    fallen = run.energy[0, 3] - run.energy[-1, 3]
    assert lost == pytest.approx(fallen, rel=1e-2)
    free = simulate(
        replace(flap, geometry=panels(2.5, fixed=(0, 1, 2), rigid_hinges=False).geometry)
    )
    assert free.angle.max() > 4.1


# --- dependent and impossible rigid elements ----------------------------------------------------


def test_redundant_bars_are_left_out_with_a_remark(simulate):
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.8, 0.9, 1.1]])
    over = scene(x, bars=[(i, j) for i in range(5) for j in range(i)], gravity=(0, 0, -1))
    remarks = list(BarHingeModel(over).remarks())
    assert any("1 rigid element(s) are implied by the others" in remark for remark in remarks)
    assert any("not determined: NaN" in remark for remark in remarks)
    run = simulate(over)
    assert np.isnan(run.tension).sum() == len(run.t)
    assert violation(run, over) < 1e-12
    np.testing.assert_allclose(run.x[-1, :, 2] - x[:, 2], -0.5, rtol=1e-12)


def test_lengths_that_contradict_each_other_are_named():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    wrong = scene(x, bars=[(0, 1), (1, 2), (2, 0)], rest={("bar", 1): 1.6})
    with pytest.raises(ConfigError, match=r"bar 1 \(nodes 1-2\) is rigid, .*gap of"):
        list(BarHingeModel(wrong).remarks())
    with pytest.raises(ConfigError, match=r"bar 1 \(nodes 1-2\) is rigid"):
        next(BarHingeModel(wrong).blocks())


def test_velocities_that_break_rigid_elements_are_changed_and_said_to_be():
    spinning = links(velocities=[[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]])
    assert any("initial velocities would break" in r for r in BarHingeModel(spinning).remarks())
    _, first = next(BarHingeModel(spinning).blocks())
    np.testing.assert_allclose(first.v[0], 0.0, atol=1e-14)


def test_a_driven_node_that_pulls_too_far_is_named(simulate):
    away = Signal(name="u", values=[[0.3, 0, 0], [0.4, 0, 0]], dt=0.5)
    taut = links(
        duration=0.5, save_interval=0.1, signals=[away], actuators=[Actuator(node=3, signal="u")]
    )
    with pytest.raises(Diverged, match=r"bar \d \(nodes .*could not be kept rigid by t = .* left"):
        simulate(taut)


# --- refusals ---------------------------------------------------------------------------------


def codes(experiment):
    return [finding.code for finding in BarHingeModel.supports(experiment)]


def test_what_cannot_be_done_is_refused_in_words():
    chain = links()
    assert codes(chain) == []
    refused = BarHingeModel.supports(replace(chain, integrator="rk4"))[0]
    assert refused.code == "DEM-RIGID-BARS"
    assert "rattle, rk4-dae, rk4-projection" in refused.expected
    assert codes(replace(chain, precision="float32")) == ["DEM-RIGID-PRECISION"]
    assert "DEM-RIGID-BARS" in codes(replace(chain, integrator="midpoint"))
    jump = Signal(name="u", values=[[0.0, 0, 0], [0.1, 0, 0]], dt=0.5, interpolation="hold")
    driven = replace(chain, signals={"u": jump}, actuators=(Actuator(node=3, signal="u"),))
    finding = BarHingeModel.supports(driven)[0]
    assert finding.code == "DEM-RIGID-JUMP"
    assert "moves node 3 at once" in finding.found
    stopped = panels(2.0, rigid_hinges=False, limits=(1.0, 5.0))
    assert codes(stopped) == ["DEM-HINGE-STOPS"]
    assert codes(replace(stopped, integrator="rk4-projection")) == []
    flags = np.ones(4, dtype=bool)
    touching = replace(
        chain,
        geometry=replace(chain.geometry, collidable=flags),
        collision=Collision(enabled=True, radius=0.01),
    )
    assert any("contact" in f.found for f in BarHingeModel.supports(touching))
