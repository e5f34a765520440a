"""The stepping of openprc up to 0.1.1: closed forms, its stored runs, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.cli.main import main
from openprc.demlat import BarHingeModel, Engine
from openprc.demlat.observables import hinge_angles, hinge_gradients
from openprc.errors import Diverged, UnsupportedScene
from openprc.schema import Trajectory
from openprc.schema.experiment import Collision, load_experiment, save_experiment

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"
OMEGA = 4.0 * np.pi


@pytest.fixture(scope="session")
def run(simulate):
    def legacy(scene):
        return simulate(replace(scene, integrator="legacy"))

    return legacy


@pytest.fixture(scope="session")
def oscillator(body):
    """Make a mass on a spring with two full periods a second, 0.1 m from rest."""

    def make(dt, **settings):
        return body(
            [[0, 0, 0], [1.1, 0, 0]],
            [1.0, 1.0],
            bars=[(0, 1, OMEGA**2, 1.0, 0.0)],
            fixed=[True, False],
            **({"dt": dt, "save_interval": 0.1} | settings),
        )

    return make


@pytest.fixture(scope="session")
def fold(body, drive):
    """Make a bent plate with a hinge, of which one wing is pushed; it has everything soft."""
    t = np.arange(3000) * 1e-3
    push = np.stack([0 * t, 0.3 * np.sin(9 * t), np.cos(7 * t)], axis=1)
    signal, actuator = drive(push, dt=1e-3, node=3)
    bars = [(0, 1, 300, 1.0, 0.2), (0, 2, 300, 0.99, 0.2), (1, 2, 300, 1.09, 0.2)]
    bars += [(0, 3, 300, 0.99, 0.2), (1, 3, 300, 0.99, 0.2)]
    return body(
        [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0.3]],
        [0.5, 0.5, 0.2, 0.3],
        bars=bars,
        prestress=[0, 0.01, 0, 0, 0],
        hinges=[(0, 1, 2, 3, 2.0, 2.5, 0.0)],
        fixed=[True, True, False, False],
        signals=[signal],
        actuators=[actuator],
        gravity=(0.0, 0.0, -9.81),
        damping=0.3,
        duration=3.001,
        save_interval=1e-3,
    )


def as_stored(run, scene, steps_per_frame):
    """Return positions and velocities as the older program put its frames together.

    Parameters
    ----------
    run : Run
        With a frame for each step, and one more.
    """
    driven = scene.driven_axes("position").any(axis=1)
    frames = []
    for column in (run.x, run.v):
        stored = column[1::steps_per_frame].copy()
        stored[:, driven] = column[:-1:steps_per_frame, driven]
        frames.append(stored)
    return frames


# --- what it was made for ---------------------------------------------------------------------


@pytest.mark.skipif(not UPSTREAM.exists(), reason="recorded files are not at hand")
@pytest.mark.parametrize("name", ["lattice_3x3_gen0", "lattice_4x4_gen0"])
def test_stored_runs_are_reproduced(run, name):
    scene = load_experiment(UPSTREAM / name)
    steps = scene.steps_per_frame
    finer = replace(scene, save_interval=scene.dt, duration=scene.duration + scene.dt)
    x, v = as_stored(run(finer), scene, steps)
    with h5py.File(UPSTREAM / name / "output/simulation.h5") as file:
        stored = file["time_series/nodes/positions"][()].astype("f8")
        speeds = file["time_series/nodes/velocities"][()].astype("f8")
    assert len(x) == 3001
    assert np.abs(x - stored).max() <= 1e-12
    assert np.abs(v - speeds).max() <= 1e-12


def test_a_hinge_moves_as_in_the_older_program(run, fold):
    # Of openprc 0.1.1 on its CPU solver, for the same folder: frame 300 of one every ten steps.
    positions = [
        [0.4081934988498688, -0.5777153372764587, -0.7114928364753723],
        [0.4999999701976776, 0.8554899096488953, -0.013234765268862247],
    ]
    velocities = [
        [-0.0006199959898367524, -0.6526587009429932, 0.503943681716919],
        [0.0, -0.013717912137508392, 0.971770703792572],
    ]
    x, v = as_stored(run(fold), fold, 10)
    np.testing.assert_allclose(x[300, 2:], positions, rtol=0, atol=1e-12)
    np.testing.assert_allclose(v[300, 2:], velocities, rtol=0, atol=1e-12)


# --- closed forms -----------------------------------------------------------------------------


def test_an_oscillator_takes_the_linear_map_of_the_scheme(run, oscillator):
    dt = 1e-3
    result = run(oscillator(dt))
    # The mean of the accelerations of the stages is that of x + h v / 2.
    step = np.array([[1.0, dt], [-dt * OMEGA**2, 1.0 - 0.5 * (dt * OMEGA) ** 2]])
    assert np.linalg.det(step) == pytest.approx(1.0 + 0.5 * (dt * OMEGA) ** 2, rel=1e-14)
    state, many = np.array([0.1, 0.0]), np.linalg.matrix_power(step, 100)
    for frame in range(len(result.x)):
        assert result.x[frame, 1, 0] - 1.0 == pytest.approx(state[0], abs=3e-7)
        assert result.v[frame, 1, 0] == pytest.approx(state[1], abs=3e-6)
        state = many @ state


def test_it_is_of_first_order_and_energy_grows(run, oscillator):
    errors = []
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4])
    for dt in steps:
        result = run(oscillator(dt))
        # After whole periods only the amplitude is wrong, and the scheme's phase is of order 2.
        assert result.potential[-1] / result.potential[0] == pytest.approx(
            np.exp(0.5 * OMEGA**2 * dt), rel=20 * dt
        )
        exact = 1.0 + 0.1 * np.cos(OMEGA * result.t)
        errors.append(np.abs(result.x[:, 1, 0] - exact).max())
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert np.all((orders > 0.95) & (orders < 1.15))
    assert errors[-1] > 5e-4


def test_a_pushed_mass_falls_behind_by_a_step(run, body, drive):
    dt, n, mass = 1e-3, 1000, 0.5
    signal, actuator = drive([2.0], dt=1.0)
    scene = {"signals": [signal], "actuators": [actuator], "dt": dt, "gravity": (0, 0, -9.81)}
    result = run(body([[1, 2, 3]], [mass], **scene))
    fallen = 0.5 * dt**2 * n * (n - 1)
    pull = 2.0 / mass + np.array([0, 0, -9.81])
    np.testing.assert_allclose(result.x[-1, 0], [1, 2, 3] + pull * fallen, atol=2e-6)
    np.testing.assert_allclose(result.v[-1, 0], pull * dt * n, atol=2e-6)
    # Force times velocity at the beginning of each step.
    work = 2.0 * np.array([1.0, 1.0, 1.0]) @ (pull * fallen)
    assert result.work_in[-1] == pytest.approx(work, rel=1e-6)


def test_drag_is_taken_to_fourth_order(run, body):
    h, rate = 0.01, 30.0  # damping divided by the mean mass
    scene = body(
        [[0, 0, 0], [1, 0, 0]], [0.1, 0.3], velocities=[[1, 0, 0], [0, 2, 0]],
        damping=rate * 0.2, dt=h, save_interval=h, duration=0.3,
    )  # fmt: skip
    z = rate * h
    decay = (1.0 - z + z**2 / 2 - z**3 / 6 + z**4 / 24) ** np.arange(31)
    result = run(scene)
    np.testing.assert_allclose(result.v[:, 0, 0], decay, rtol=1e-6)
    np.testing.assert_allclose(result.v[:, 1, 1], 2.0 * decay, rtol=1e-6)


def twin(scene, n_steps):
    """Return positions after each step in float64 and SI units, hinges by their arc tangent."""
    geometry, h = scene.geometry, scene.dt
    bars, hinges = geometry.bars, geometry.hinges
    free = ~geometry.fixed[:, np.newaxis]

    def acceleration(x, v, push):
        force = geometry.masses[:, np.newaxis] * np.array(scene.gravity)
        force -= scene.drag[:, np.newaxis] * v
        force[3] += push
        for e, (i, j) in enumerate(bars.indices):
            along = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
            stretch = np.linalg.norm(x[j] - x[i]) - bars.relaxed_length[e]
            tension = bars.stiffness[e] * stretch + bars.damping[e] * (v[j] - v[i]) @ along
            force[i] += tension * along
            force[j] -= tension * along
        change = hinge_angles(x[np.newaxis], hinges)[0] - hinges.rest_angle
        gradients = hinge_gradients(x[np.newaxis], hinges.indices)[0]
        for e, nodes in enumerate(hinges.indices):
            force[nodes] -= hinges.stiffness[e] * change[e] * gradients[e]
        return free * force / geometry.masses[:, np.newaxis]

    x, v = geometry.positions.copy(), np.zeros_like(geometry.positions)
    states = [x]
    for step in range(n_steps):
        push = scene.signals["u"].values[step]
        a1 = acceleration(x, v, push)
        a2 = acceleration(x + 0.5 * h * v, v + 0.5 * h * a1, push)
        a3 = acceleration(x + 0.5 * h * v, v + 0.5 * h * a2, push)
        a4 = acceleration(x + h * v, v + h * a3, push)
        x, v = x + h * v, v + h / 6.0 * (a1 + 2 * a2 + 2 * a3 + a4)
        states.append(x)
    return np.array(states)


def test_forces_are_those_of_the_model(run, fold):
    result = run(replace(fold, duration=0.3))
    np.testing.assert_allclose(result.x, twin(fold, 300), rtol=0, atol=1e-6)
    assert np.ptp(result.x[:, 3], axis=0).max() > 0.01
    # The quantities of elements come from the unrounded state.
    x, hinges = result.x, fold.geometry.hinges
    np.testing.assert_allclose(result.angle, hinge_angles(x, hinges), atol=1e-6)
    np.testing.assert_allclose(result.moment, 2.0 * (result.angle - 2.5), rtol=1e-9)
    elastic = 0.5 * 2.0 * (result.angle[:, 0] - 2.5) ** 2
    np.testing.assert_allclose(result.energy[:, 2], elastic, rtol=1e-9)


def test_driven_nodes_take_the_nearest_sample(run, body, drive):
    h = 2.0**-10
    values = np.array([[0.5, 1, 2], [3, 5, 7], [11, 13, 17], [19, 23, 29]]) / 64
    signal, actuator = drive(values, dt=2 * h, type="position")
    scene = body(
        [[0, 0, 0], [1, 0, 0]], [1.0, 1.0], bars=[(0, 1, 50.0, 1.0, 0.1)], signals=[signal],
        actuators=[actuator], dt=h, save_interval=h, duration=12 * h,
    )  # fmt: skip
    result = run(scene)
    # Halfway the even one, and after the last one its value stays.
    nearest = [0, 0, 1, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3]
    np.testing.assert_allclose(result.x[:, 0], values[nearest], rtol=1e-6)
    speed = np.diff(np.concatenate([[[0, 0, 0]], values[nearest]]), axis=0) / h
    np.testing.assert_allclose(result.v[:, 0], speed, rtol=1e-5, atol=1e-4)


def test_the_ledger_closes_to_first_order(run, body, drive):
    t = np.arange(4001) * 2.5e-4
    move = np.array([1.0, 0, 0]) + np.stack([0 * t, 0.05 * (1 - np.cos(6 * t)), 0 * t], axis=1)
    signal, actuator = drive(move, dt=2.5e-4, node=1, type="position")
    gaps = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        scene = body(
            [[0, 0, 0], [1, 0, 0], [0.5, 0.8, 0]], [0.1, 0.2, 0.3],
            bars=[(0, 2, 40.0, 0.9, 0.2), (1, 2, 40.0, 0.9, 0.2)], fixed=[True, False, False],
            signals=[signal], actuators=[actuator], damping=0.2, gravity=(0, 0, -9.81), dt=dt,
        )  # fmt: skip
        result = run(scene)
        assert (result.ledger[-1, 1:3] > 0.01).all()
        gaps.append(np.abs(result.balance).max() / result.dissipated[-1])
    assert gaps[0] < 0.05
    assert gaps[0] / gaps[1] == pytest.approx(2.0, abs=0.2)
    assert gaps[1] / gaps[2] == pytest.approx(2.0, abs=0.2)


# --- what it says -----------------------------------------------------------------------------


def test_a_run_that_blows_up_is_stopped(oscillator):
    scene = oscillator(0.05, integrator="legacy", duration=200.0)
    with pytest.raises(Diverged, match=r"node 1 left the range (.|\n)* 'legacy' feeds"):
        list(BarHingeModel(scene).blocks())


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"bar_damping": "printed"}, "bar_damping 'printed' with the integrator 'legacy'"),
        ({"precision": "float32"}, "float32 with the integrator 'legacy'"),
        ({"gravity": (0.0, 1.0, 0.0)}, "gravity that is not along z"),
        ({"collision": Collision(enabled=True, radius=0.1)}, "contact with"),
        ({"bars": {"law": ["cable", *["linear"] * 4]}}, "an element with a law of its own"),
        ({"bars": {"rigid": [True, *[False] * 4]}}, "1 rigid bars with the integrator 'legacy'"),
        ({"hinges": {"damping": [0.1]}}, "a hinge with damping"),
        ({"hinges": {"limit_low": [0.1]}}, "a hinge with limits"),
        ({"actuator": {"type": "velocity"}}, "an actuator of a velocity"),
        ({"actuator": {"axes": (True, False, True)}}, "an actuator of some axes only"),
        ({"second": True}, "a second actuator of node 3"),
    ],
)
def test_what_the_older_program_had_not_is_refused(fold, tmp_path, changes, found):
    geometry = replace(fold.geometry, collidable=np.ones(4, dtype=bool))
    for kind in ("bars", "hinges"):
        if kind in changes:
            elements = replace(getattr(geometry, kind), **changes.pop(kind))
            geometry = replace(geometry, **{kind: elements})
    actuators = tuple(replace(a, **changes.pop("actuator", {})) for a in fold.actuators)
    actuators *= 2 if changes.pop("second", False) else 1
    scene = replace(fold, geometry=geometry, actuators=actuators, integrator="legacy", **changes)
    findings = [one for one in BarHingeModel.supports(scene) if found in one.found]
    assert len(findings) == 1
    assert findings[0].level == "error"
    assert findings[0].expected
    assert "integrator" in findings[0].fix or "one of these" in findings[0].fix


def test_it_is_chosen_for_a_run_and_said_in_the_file(fold, tmp_path):
    save_experiment(replace(fold, duration=0.043, save_interval=0.043), tmp_path)
    before = (tmp_path / "input/config.json").read_text()
    engine = Engine(BarHingeModel)
    with pytest.raises(UnsupportedScene, match=r"one of rk4, .*legacy"):
        engine.run(tmp_path, integrator="banana")
    result = engine.run(tmp_path, integrator="legacy")
    assert (tmp_path / "input/config.json").read_text() == before
    notes = " ".join(result.notes)
    assert "of first order and feeds energy into the motion" in notes
    assert "rounds saved positions and velocities to float32" in notes
    assert "saved every 42 steps for this save_interval, not every 43" in notes
    with Trajectory(result.path) as run:
        assert run.n_frames == 2
        positions = run.positions()
    np.testing.assert_array_equal(positions, positions.astype("f4"))
    with h5py.File(result.path) as file:
        stored = [note.decode() for note in file["provenance/notes"][()]]
        settings = json.loads(file["provenance/config"][()])
    assert stored == list(result.notes)
    assert settings["simulation"]["integrator"] == "legacy"


def test_it_is_chosen_on_the_command_line(fold, tmp_path, capsys):
    scene = replace(fold, duration=0.01, bar_damping="printed")
    save_experiment(scene, tmp_path)
    for more in ([], ["--plan"]):
        with pytest.raises(SystemExit):
            main(["run", str(tmp_path), "--integrator", "legacy", *more])
        printed = capsys.readouterr()
        shown = " ".join((printed.out + printed.err).split())
        assert "bar_damping 'printed' with the integrator 'legacy'" in shown


def test_initial_velocities_are_remarked_on(fold):
    moving = replace(fold.geometry, velocities=np.ones((4, 3)) * [[0], [0], [1], [1]])
    remarks = list(BarHingeModel(replace(fold, geometry=moving, integrator="legacy")).remarks())
    assert any("had no initial velocities" in remark for remark in remarks)
