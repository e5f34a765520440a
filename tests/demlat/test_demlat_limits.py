"""What the engine refuses, remarks on, and stops."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine, Simulation
from openprc.demlat.producer import DemlatProducer
from openprc.demlat.stability import stable_step
from openprc.errors import (
    ConfigError,
    Diverged,
    UnreadableFile,
    UnsupportedScene,
)
from openprc.schema.experiment import Collision, load_experiment, save_experiment
from openprc.schema.geometry import Bars, Hinges

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"
X, Y, Z = np.eye(3)


# --- refusals ------------------------------------------------------------------------------------


def one_rigid(scene):
    rigid = np.zeros(len(scene.geometry.bars), dtype=bool)
    rigid[:2] = True
    return replace(scene.geometry, bars=replace(scene.geometry.bars, rigid=rigid))


def refusals(lattice, drive):
    scene = lattice(3)
    dead, dead_push = drive([1.0], dt=1.0, node=0, interpolation="hold")
    clash, pusher = drive([0.1], dt=1.0, node=8, axes=(0, 1, 0), interpolation="hold")
    _, mover = drive([0.1], dt=1.0, node=8, type="position", axes=(0, 1, 0))
    speed, runner = drive([0.1], dt=1.0, node=8, type="velocity")
    fold = {"indices": [[0, 1, 3, 4]], "stiffness": [1.0], "rest_angle": [3.0]}
    flat = lattice(3, velocities=np.zeros((9, 3))).geometry
    line = replace(flat, positions=np.outer(np.arange(9), X), bars=Bars(), hinges=Hinges(**fold))
    return {
        "DEM-RIGID-BARS": (replace(scene, geometry=one_rigid(scene)), "2 rigid bars"),
        "DEM-RIGID-HINGES": (
            replace(scene, geometry=replace(scene.geometry, hinges=Hinges(**fold, rigid=[True]))),
            "1 rigid hinges",
        ),
        "DEM-COLLISION": (
            replace(
                scene,
                collision=Collision(enabled=True),
                geometry=replace(scene.geometry, collidable=np.ones(9, dtype=bool)),
            ),
            "collision between 9 collidable nodes",
        ),
        "DEM-INTEGRATOR": (replace(scene, integrator="verlet"), "the integrator 'verlet'"),
        "DEM-VELOCITY-ACTUATOR": (
            replace(scene, signals={"u": speed}, actuators=(runner,)),
            "a velocity actuator",
        ),
        "DEM-DEAD-FORCE": (
            replace(scene, signals={"u": dead}, actuators=(dead_push,)),
            "a force on x of node 0, which is fixed",
        ),
        "DEM-DEAD-FORCE-2": (
            replace(scene, signals={"u": clash}, actuators=(pusher, mover)),
            "a force on y of node 8, which is position-driven",
        ),
        "DEM-DEGENERATE-HINGE": (
            replace(scene, geometry=line),
            "has a wing on its crease line",
        ),
    }


@pytest.mark.parametrize(
    "code",
    [
        "DEM-RIGID-BARS",
        "DEM-RIGID-HINGES",
        "DEM-COLLISION",
        "DEM-INTEGRATOR",
        "DEM-VELOCITY-ACTUATOR",
        "DEM-DEAD-FORCE",
        "DEM-DEAD-FORCE-2",
        "DEM-DEGENERATE-HINGE",
    ],
)
def test_what_cannot_be_modelled_is_refused_in_words(tmp_path, lattice, drive, code):
    scene, words = refusals(lattice, drive)[code]
    findings = DemlatProducer().supports(scene)
    assert [finding.code for finding in findings] == [code.removesuffix("-2")]
    assert findings[0].level == "error"
    assert findings[0].fix
    save_experiment(scene, tmp_path)
    with pytest.raises(UnsupportedScene, match=words):
        Engine(BarHingeModel).run(tmp_path)
    assert not (tmp_path / "output").exists()


def test_all_refusals_come_together(tmp_path, lattice):
    scene = replace(lattice(3), integrator="verlet")
    save_experiment(replace(scene, geometry=one_rigid(scene)), tmp_path)
    with pytest.raises(UnsupportedScene, match="cannot model 2 things") as caught:
        Engine(BarHingeModel).run(tmp_path)
    assert "rigid bars" in str(caught.value)
    assert "verlet" in str(caught.value)


def test_a_full_scene_has_nothing_to_refuse(folder):
    assert DemlatProducer().supports(load_experiment(folder)) == []


@pytest.mark.parametrize("make", [lambda: Engine("barhinge"), lambda: Engine(BarHingeModel, "tpu")])
def test_the_engine_wants_a_known_model_and_backend(make):
    with pytest.raises(ConfigError, match=r"model|backend"):
        make()


def test_an_experiment_has_to_be_there(tmp_path):
    with pytest.raises(UnreadableFile, match="no experiment here"):
        Simulation(tmp_path)


# --- remarks -------------------------------------------------------------------------------------


def test_other_backends_are_named_as_what_they_are(folder):
    result = Engine(BarHingeModel, backend="cuda").run(folder)
    assert any("no 'cuda' backend" in note for note in result.notes)


def remark_of(scene):
    return list(BarHingeModel(scene).remarks())


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ({"values": [0.1, 0.1], "dt": 0.1}, "signal 'u' ends at 0.1 s of 1 s"),
        ({"values": np.zeros(2000), "dt": 0.00055}, "do not fall on time steps"),
    ],
)
def test_odd_signals_are_remarked_on(lattice, drive, signal, words):
    one, actuator = drive(**signal, node=8)
    scene = replace(lattice(3), signals={"u": one}, actuators=(actuator,))
    assert any(words in remark for remark in remark_of(scene))


def test_a_start_off_the_geometry_is_remarked_on(lattice, drive):
    one, actuator = drive(np.ones((2, 3)), dt=1.0, node=8, type="position")
    scene = replace(lattice(3), signals={"u": one}, actuators=(actuator,))
    assert any("m away from where node 8 is" in remark for remark in remark_of(scene))


def test_collision_without_collidable_nodes_is_remarked_on(lattice):
    scene = replace(lattice(3), collision=Collision(enabled=True))
    assert any("nothing can collide" in remark for remark in remark_of(scene))


# --- stability -----------------------------------------------------------------------------------


def test_the_stability_limit_of_one_bar_is_exact(body):
    k, m = 100.0, 0.5
    scene = body([0 * X, X], [m, m], bars=[(0, 1, k, 1, 0)])
    omega = np.sqrt(2 * k / m)
    assert stable_step(scene, np.zeros(2)) == pytest.approx(2.785 / omega, rel=1e-6)
    damped = body([0 * X, X], [m, m], bars=[(0, 1, k, 1, 50.0)])
    assert stable_step(damped, np.zeros(2)) == pytest.approx(2.785 / (50.0 * 2 / m), rel=1e-6)
    assert stable_step(body([0 * X], [m]), np.zeros(1)) == np.inf


def test_the_stability_limit_of_a_hinge_is_that_of_its_closed_form(body):
    # omega = (2 / h) sqrt(k / m) for four equal masses and two mirror triangles, times
    # sqrt(5 / 4) or so when the crease may translate: take the gradient norm itself.
    k, m, h = 0.05, 0.01, 0.8
    scene = body([0 * X, X, [0.5, -h, 0], [0.5, h, 0]], [m] * 4, hinges=[(0, 1, 2, 3, k, np.pi, 0)])
    gradients = np.array([1 / h, 1 / h, 1 / h, 1 / h])
    omega = np.sqrt(k / m * np.sum(gradients**2))
    assert stable_step(scene, np.zeros(4)) == pytest.approx(2.785 / omega, rel=1e-6)


@pytest.mark.parametrize(("share", "grows"), [(0.97, False), (1.03, True)])
def test_the_limit_separates_stable_from_unstable(body, simulate, share, grows):
    # Without damping the limit is 2 sqrt(2); the estimate uses the smaller 2.785.
    k, m = 100.0, 1.0
    limit = 2 * np.sqrt(2) / 10
    scene = body(
        [0 * X, 1.001 * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 0)],
        fixed=[True, False],
        dt=share * limit,
        save_interval=share * limit,
        duration=200 * share * limit,
    )
    run = simulate(scene)
    energy = run.kinetic + run.potential
    assert (energy[-1] > energy[0]) == grows


def test_too_large_steps_are_warned_about_and_stopped(tmp_path, lattice):
    scene = lattice(3, dt=0.05, save_interval=0.05, duration=50.0)
    save_experiment(scene, tmp_path)
    with pytest.raises(Diverged, match=r"node \d left the range .* at t = \d") as caught:
        Engine(BarHingeModel).run(tmp_path)
    assert "the stability limit" in caught.value.fix
    partial = tmp_path / "output" / "simulation.h5.partial"
    assert not (tmp_path / "output" / "simulation.h5").exists()
    with h5py.File(partial) as file:
        assert file.attrs["status"] == "failed"
        assert file["time_series/nodes/positions"].shape[0] >= 1
        assert np.isfinite(file["time_series/nodes/positions"][()]).all()
        notes = file["provenance/notes"][()]
        assert any(b"above" in note and b"stability limit" in note for note in notes)


def test_sound_steps_are_not_warned_about(lattice):
    assert remark_of(lattice(3, dt=1e-3)) == []
