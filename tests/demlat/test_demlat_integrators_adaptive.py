"""Schemes that choose their steps: tolerance, dense output, knots, what stops them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import INTEGRATORS, dop853, rk45
from openprc.demlat.models.barhinge import assembly
from openprc.errors import Diverged

X, Y, Z = np.eye(3)
SCHEMES = ["rk45", "dop853"]
TABLES = {"rk45": rk45.TABLE, "dop853": dop853.TABLE}
STIFFNESS, STRETCH, OMEGA = 100.0, 0.1, 10.0


@pytest.fixture(scope="module")
def oscillator(body):
    def make(*, damping=0.0, stretch=STRETCH, **settings):
        times = {"save_interval": 0.1, "duration": 2.0, "dt": 0.05} | settings
        return body(
            [0 * X, (1 + stretch) * X],
            [1.0, 1.0],
            bars=[(0, 1, STIFFNESS, 1.0, damping)],
            fixed=[True, False],
            **times,
        )

    return make


def effort(experiment):
    """Run in memory and return what it took."""
    model = BarHingeModel(experiment)
    for _ in model.blocks():
        pass
    return model.effort


# --- tables -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_tables_are_those_that_scipy_has(scheme):
    table = TABLES[scheme]
    peer = {"rk45": scipy.integrate.RK45, "dop853": scipy.integrate.DOP853}[scheme]
    n, columns = table.stages, peer.A.shape[1]
    np.testing.assert_allclose(table.weights[:n, :columns], peer.A[:n], rtol=1e-15)
    np.testing.assert_allclose(table.weights[n, :n], peer.B, rtol=1e-15)
    np.testing.assert_allclose(table.nodes[:n], peer.C[:n], atol=1e-14)
    assert table.nodes[n] == pytest.approx(1.0, abs=1e-14)
    assert INTEGRATORS[scheme].order == table.order
    assert INTEGRATORS[scheme].stages == n


@pytest.mark.parametrize("scheme", SCHEMES)
def test_tables_integrate_polynomials_up_to_their_order(scheme):
    table = TABLES[scheme]
    n = table.stages
    for power in range(table.order):
        whole = table.weights[n] @ table.nodes**power
        assert whole == pytest.approx(1 / (power + 1), abs=1e-14)
        if power < table.order - 1:
            twice = table.double_weights[n] @ table.nodes**power
            assert twice == pytest.approx(1 / (power + 1) / (power + 2), abs=1e-14)
    # The estimates vanish for what both members of a pair integrate.
    for power in range({"rk45": 4, "dop853": 3}[scheme]):
        np.testing.assert_allclose(table.error @ table.nodes**power, 0, atol=1e-14)


@pytest.mark.parametrize(("scheme", "order"), [("rk45", 4), ("dop853", 7)])
def test_interpolants_are_exact_for_polynomials_up_to_their_order(scheme, order):
    table = TABLES[scheme]
    for s in (0.1, 0.5, 0.83):
        basis = np.cumprod([(s, 1 - s)[row % 2] for row in range(len(table.dense))])
        for power in range(order):
            value = basis @ table.dense @ table.nodes**power
            assert value == pytest.approx(s ** (power + 1) / (power + 1), abs=1e-13)


# --- tolerance --------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_errors_are_in_proportion_to_the_tolerance(oscillator, simulate, scheme, damping):
    scene = oscillator(damping=damping, integrator=scheme)
    rate = damping / 2
    omega = np.sqrt(OMEGA**2 - rate**2)
    tolerances = 10.0 ** -np.arange(3, 12)
    errors, gaps = [], []
    for tolerance in tolerances:
        run = simulate(replace(scene, tolerance=tolerance))
        exact = np.cos(omega * run.t) + rate / omega * np.sin(omega * run.t)
        exact *= STRETCH * np.exp(-rate * run.t)
        errors.append(np.abs(run.x[:, 1, 0] - 1 - exact).max() / STRETCH)
        gaps.append(np.abs(run.balance).max() / (0.5 * STIFFNESS * STRETCH**2))
    for values in (errors, gaps):
        slope = np.polyfit(np.log(tolerances), np.log(values), 1)[0]
        assert slope == pytest.approx(1.0, abs=0.15)
        assert (np.array(values) < 30 * tolerances).all()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_neither_the_place_nor_the_units_of_a_scene_change_its_steps(oscillator, scheme):
    scene = oscillator(integrator=scheme, tolerance=1e-7)
    geometry = scene.geometry
    far = replace(geometry, positions=geometry.positions + 1024.0 * Y)
    bars = replace(geometry.bars, stiffness=geometry.bars.stiffness * 1000)
    heavy = replace(geometry, masses=geometry.masses * 1000, bars=bars)
    known = effort(scene)
    assert known["steps"] > 20
    assert effort(replace(scene, geometry=heavy)) == known
    assert abs(effort(replace(scene, geometry=far))["steps"] - known["steps"]) <= 1


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_first_guess_of_the_step_that_is_far_too_long_does_no_harm(oscillator, simulate, scheme):
    scene = oscillator(integrator=scheme, tolerance=1e-8, save_interval=2.0, dt=2.0)
    run = simulate(scene)
    exact = 1 + STRETCH * np.cos(OMEGA * run.t)
    np.testing.assert_allclose(run.x[:, 1, 0], exact, atol=1e-7)
    assert effort(scene)["rejected"] > 0


# --- dense output -----------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_frames_between_steps_are_as_exact_as_steps(oscillator, simulate, scheme):
    scene = oscillator(integrator=scheme, tolerance=1e-8, damping=0.5)
    dense = replace(scene, save_interval=0.00125, dt=0.00125)
    run = simulate(dense)
    rate = 0.25
    omega = np.sqrt(OMEGA**2 - rate**2)
    decay = STRETCH * np.exp(-rate * run.t)
    place = decay * (np.cos(omega * run.t) + rate / omega * np.sin(omega * run.t))
    speed = -decay * OMEGA**2 / omega * np.sin(omega * run.t)
    assert np.abs(run.x[:, 1, 0] - 1 - place).max() < 1e-8
    assert np.abs(run.v[:, 1, 0] - speed).max() < 1e-7
    assert np.abs(run.balance).max() < 1e-7
    # Frames cut no steps.
    assert effort(dense)["steps"] < len(run.t) / 5
    assert abs(effort(dense)["steps"] - effort(scene)["steps"]) < 10


# --- other references -------------------------------------------------------------------------


def scipy_frames(scene):
    """Frames (T, N, 3) of a body of bars by SciPy, from forces written for being read."""
    geometry, bars = scene.geometry, scene.geometry.bars
    shape, (i, j) = geometry.positions.shape, bars.indices.T
    masses, gravity = geometry.masses[:, np.newaxis], np.array(scene.gravity)

    def rate(_, state):
        x, v = state.reshape(2, *shape)
        d = x[j] - x[i]
        length = np.linalg.norm(d, axis=1)
        unit = d / length[:, np.newaxis]
        tension = bars.stiffness * (length - bars.rest_length)
        tension += bars.damping * np.sum(unit * (v[j] - v[i]), axis=1)
        force = masses * gravity - scene.drag[:, np.newaxis] * v
        np.add.at(force, i, tension[:, np.newaxis] * unit)
        np.add.at(force, j, -tension[:, np.newaxis] * unit)
        a = np.where(geometry.fixed[:, np.newaxis], 0.0, force / masses)
        return np.concatenate([v, a]).ravel()

    start = np.concatenate([geometry.positions, geometry.velocities]).ravel()
    times = scene.frame_times
    solution = scipy.integrate.solve_ivp(
        rate, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13
    )
    return solution.y.T.reshape(-1, 2, *shape)[:, 0]


@pytest.fixture(scope="module")
def truss(lattice):
    return lattice(
        3,
        damping=0.02,
        gravity=(0.0, 0.0, -9.81),
        duration=0.5,
        save_interval=0.05,
        dt=0.05,
    )


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_nonlinear_truss_moves_as_scipy_has_it(truss, simulate, scheme):
    scene = replace(truss, damping=0.01)
    exact = scipy_frames(scene)
    motion = np.abs(exact - exact[0]).max()
    tolerances, errors, steps = 10.0 ** -np.arange(4, 10), [], []
    for tolerance in tolerances:
        chosen = replace(scene, integrator=scheme, tolerance=tolerance)
        errors.append(np.abs(simulate(chosen).x - exact).max() / motion)
        steps.append(effort(chosen)["steps"])
    assert (np.array(errors) < 100 * tolerances).all()
    # Against the number of steps it is the declared order that shows.
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(INTEGRATORS[scheme].order, rel=0.1)


def test_vectors_and_single_elements_give_the_same(lattice, simulate, monkeypatch):
    scene = lattice(
        6,
        damping=0.02,
        gravity=(0.0, 0.0, -9.81),
        duration=0.1,
        save_interval=0.01,
        dt=0.01,
        integrator="dop853",
        tolerance=1e-11,
    )
    assert len(scene.geometry.bars) > assembly.LEAST_ELEMENTS
    wide = simulate(scene)
    monkeypatch.setattr(assembly, "LEAST_ELEMENTS", 10_000)
    narrow = simulate(scene)
    np.testing.assert_allclose(wide.x, narrow.x, atol=1e-10)
    np.testing.assert_allclose(wide.v, narrow.v, atol=1e-8)
    np.testing.assert_allclose(wide.ledger, narrow.ledger, atol=1e-9)
    assert np.abs(wide.balance).max() < 1e-9 * wide.kinetic.max()


# --- knots ------------------------------------------------------------------------------------


def held_response(times, values, dt):
    """Displacement of the oscillator at rest under forces held for `dt` each, in closed form."""
    x = np.zeros(len(times))
    place, speed = 0.0, 0.0
    for number, force in enumerate(values):
        rest = force / STIFFNESS
        last = number == len(values) - 1
        inside = (times >= number * dt) & (last | (times < (number + 1) * dt))
        s = OMEGA * (times[inside] - number * dt)
        x[inside] = rest + (place - rest) * np.cos(s) + speed / OMEGA * np.sin(s)
        c, s = np.cos(OMEGA * dt), np.sin(OMEGA * dt)
        place, speed = (
            rest + (place - rest) * c + speed / OMEGA * s,
            speed * c - OMEGA * (place - rest) * s,
        )
    return x


@pytest.mark.parametrize("dt", [0.1, 0.037])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_forces_that_switch_are_followed_to_the_tolerance(oscillator, simulate, drive, scheme, dt):
    values = np.where(np.random.default_rng(2).random(25) < 0.5, -5.0, 5.0)
    signal, actuator = drive(values, dt=dt, node=1, axes=(1, 0, 0), interpolation="hold")
    scene = oscillator(stretch=0.0, integrator=scheme, tolerance=1e-10)
    run = simulate(replace(scene, signals={"u": signal}, actuators=(actuator,)))
    exact = held_response(run.t, values, dt)
    assert np.abs(run.x[:, 1, 0] - 1 - exact).max() < 1e-8 * np.abs(exact).max()
    assert np.abs(run.balance).max() < 1e-8 * np.ptp(run.work_in)


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("kind", ["force", "position", "velocity"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_driven_trusses_move_as_with_small_fixed_steps(
    truss, simulate, drive, scheme, kind, interpolation
):
    values = np.random.default_rng(1).uniform(-1, 1, (11, 3))
    if kind == "position":
        values = truss.geometry.positions[8] + 0.01 * values
    signal, actuator = drive(values, dt=0.05, node=8, type=kind, interpolation=interpolation)
    still = truss.geometry.velocities * 0.0
    scene = replace(
        truss,
        geometry=replace(truss.geometry, velocities=still),
        signals={"u": signal},
        actuators=(actuator,),
        save_interval=0.025,
        dt=0.025,
    )
    exact = simulate(replace(scene, integrator="rk4", dt=0.025 / 512))
    run = simulate(replace(scene, integrator=scheme, tolerance=1e-9))
    motion = np.abs(exact.x - exact.x[0]).max()
    assert np.abs(run.x - exact.x).max() < 3e-7 * motion
    # Frames on a jump show what holds from then on; the jump's energy is the actuator's work.
    np.testing.assert_allclose(run.x[:, 8], exact.x[:, 8], atol=3e-7 * motion)
    assert np.abs(run.balance).max() < 1e-6 * np.ptp(run.work_in)
    assert np.abs(run.work_in - exact.work_in).max() < 1e-6 * np.ptp(run.work_in)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_pulse_after_a_long_rest_is_not_stepped_over(oscillator, simulate, drive, scheme):
    # A cubic signal has no knots to stop at, and a body at rest would allow any step.
    values = np.zeros(201)
    values[160:165] = 1.0, 3.0, 5.0, 3.0, 1.0
    signal, actuator = drive(values, dt=0.1, node=1, axes=(1, 0, 0), interpolation="cubic")
    scene = oscillator(
        stretch=0.0, integrator=scheme, tolerance=1e-8, duration=20.0, save_interval=1.0, dt=1.0
    )
    scene = replace(scene, signals={"u": signal}, actuators=(actuator,))
    exact = simulate(replace(scene, integrator="rk4", dt=1e-3))
    run = simulate(scene)
    assert np.abs(exact.x[-1, 1, 0] - 1) > 1e-3
    np.testing.assert_allclose(run.x, exact.x, atol=1e-8)


# --- what stops a run -------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_tolerance_below_rounding_is_refused(oscillator, scheme):
    scene = oscillator(integrator=scheme, tolerance=1e-15)
    (finding,) = BarHingeModel.supports(scene)
    assert finding.code == "DEM-TOLERANCE"
    assert "at least 2.2e-15" in finding.expected
    assert BarHingeModel.supports(replace(scene, tolerance=1e-14)) == []
    # Fixed steps have no use for it.
    assert BarHingeModel.supports(replace(scene, integrator="pefrl")) == []


def test_a_force_that_no_step_is_short_enough_for_is_reported(oscillator, simulate, drive):
    signal, actuator = drive([0.0, 1e40], dt=0.5, node=1, axes=(0, 1, 0), interpolation="hold")
    scene = oscillator(integrator="dop853")
    scene = replace(scene, signals={"u": signal}, actuators=(actuator,))
    with pytest.raises(Diverged, match=r"no step small enough at t = 0.5 s for node 1 along y"):
        simulate(scene)
    with pytest.raises(Diverged, match=r"loosen the tolerance of 1e-06"):
        simulate(scene)


def test_a_body_that_runs_away_is_named(oscillator, simulate):
    # A dashpot that feeds energy in; the checks of files would not let it pass.
    scene = oscillator(integrator="dop853")
    geometry = scene.geometry
    bars = replace(geometry.bars, damping=np.array([-20.0]))
    scene = replace(scene, geometry=replace(geometry, bars=bars), duration=100.0)
    with pytest.raises(Diverged, match="node 1 left the range of plausible positions along x"):
        simulate(scene)


def test_the_file_says_what_the_run_took(oscillator, tmp_path):
    from openprc.hooks import run_experiment
    from openprc.schema.experiment import save_experiment

    scene = oscillator(integrator="rk45", tolerance=1e-5)
    save_experiment(scene, tmp_path)
    known = effort(scene)
    notes = " ".join(run_experiment(tmp_path).notes)
    assert f"rk45 took {known['steps']} steps" in notes
    assert f"{known['evaluations']} evaluations" in notes
