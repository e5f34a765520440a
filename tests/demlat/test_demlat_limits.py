"""What the engine refuses, remarks on, and stops."""

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine, Simulation
from openprc.demlat.models.barhinge.divergence import strained_most, way_out
from openprc.demlat.models.barhinge.support import remarks
from openprc.demlat.planning.stability import stable_step, step_limit
from openprc.demlat.producer import DemlatProducer
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
    fold = {"indices": [[0, 1, 3, 4]], "stiffness": [1.0], "rest_angle": [3.0]}
    flat = lattice(3, velocities=np.zeros((9, 3))).geometry
    line = replace(flat, positions=np.outer(np.arange(9), X), bars=Bars(), hinges=Hinges(**fold))
    return {
        "DEM-RIGID-BARS": (replace(scene, geometry=one_rigid(scene)), "2 rigid bars"),
        "DEM-RIGID-HINGES": (
            replace(scene, geometry=replace(scene.geometry, hinges=Hinges(**fold, rigid=[True]))),
            "1 rigid hinges",
        ),
        "DEM-INTEGRATOR": (replace(scene, integrator="magic"), "the integrator 'magic'"),
        "DEM-DEAD-FORCE": (
            replace(scene, signals={"u": dead}, actuators=(dead_push,)),
            "a force on x of node 0, which is fixed",
        ),
        "DEM-DEAD-FORCE-2": (
            replace(scene, signals={"u": clash}, actuators=(pusher, mover)),
            "a force on y of node 8, which is driven",
        ),
        "DEM-DEGENERATE-HINGE": (
            replace(scene, geometry=line),
            "has a wing on its crease line",
        ),
        "DEM-UNSTABLE-STEP": (
            replace(scene, dt=0.01),
            "would blow up: bar 5 between nodes 5 and 8 sets the stability limit",
        ),
    }


@pytest.mark.parametrize(
    "code",
    [
        "DEM-RIGID-BARS",
        "DEM-RIGID-HINGES",
        "DEM-INTEGRATOR",
        "DEM-DEAD-FORCE",
        "DEM-DEAD-FORCE-2",
        "DEM-DEGENERATE-HINGE",
        "DEM-UNSTABLE-STEP",
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
    scene = replace(lattice(3), dt=0.01)
    save_experiment(replace(scene, geometry=one_rigid(scene)), tmp_path)
    with pytest.raises(UnsupportedScene, match="cannot model 2 things") as caught:
        Engine(BarHingeModel).run(tmp_path)
    assert "rigid bars" in str(caught.value)
    assert "dt = 0.01" in str(caught.value)


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


def remark_of(scene):
    return list(remarks(scene))


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


# --- time steps that are too large ---------------------------------------------------------------


def test_the_refusal_says_what_to_do(lattice):
    scene = lattice(3, dt=0.05, save_interval=0.05)
    (finding,) = DemlatProducer().supports(scene)
    limit = step_limit(scene)
    assert finding.expected == f"at most {limit.limit:.4g} s"
    assert f"take {limit.recommended:.3g} s or less" in finding.fix
    assert "step_check to 'warn'" in finding.fix
    slower = scene.save_interval / np.ceil(scene.save_interval / limit.limit)
    assert DemlatProducer().supports(replace(scene, dt=slower)) == []


def test_a_step_above_the_limit_can_be_forced(tmp_path, lattice):
    scene = lattice(3, dt=0.05, save_interval=0.05, duration=50.0, step_check="warn")
    save_experiment(scene, tmp_path)
    assert load_experiment(tmp_path).step_check == "warn"
    with pytest.raises(Diverged, match=r"node \d left the range .* at t = \d|by t = \d") as caught:
        Engine(BarHingeModel).run(tmp_path)
    assert re.search(r"of the bars there, bar \d+ between nodes \d and \d", caught.value.found)
    assert "the stability limit at the start is 0.00727 s, set by bar 5" in caught.value.fix
    partial = tmp_path / "output" / "simulation.h5.partial"
    assert not (tmp_path / "output" / "simulation.h5").exists()
    with h5py.File(partial) as file:
        assert file.attrs["status"] == "failed"
        assert file["time_series/nodes/positions"].shape[0] >= 1
        assert np.isfinite(file["time_series/nodes/positions"][()]).all()
        notes = file["provenance/notes"][()]
        assert any(b"stability limit" in note and b"divergence" in note for note in notes)


def test_the_command_line_says_the_same_and_keeps_no_result(tmp_path, lattice, command):
    scene = lattice(3, dt=0.05, save_interval=0.05, duration=50.0, step_check="warn")
    save_experiment(scene, tmp_path)
    code, _, errors = command("run", tmp_path)
    assert code == 1
    assert "left the range of plausible positions" in errors
    assert [path.name for path in (tmp_path / "output").iterdir()] == ["simulation.h5.partial"]


def test_only_the_two_words_are_known(tmp_path, lattice):
    with pytest.raises(ConfigError, match=r"simulation.step_check: 'ask'\n.*refuse, warn"):
        save_experiment(lattice(3, step_check="ask"), tmp_path)


def test_divergence_without_a_limit_on_the_step_is_no_matter_of_the_step(body):
    scene = body([0 * X, X], [1.0, 1.0])
    assert "look for a force without bound" in way_out(step_limit(scene), 1.0)


@pytest.mark.parametrize(
    ("hinges", "words"),
    [([(0, 1, 2, 3, 1.0, 3.0, 0)], "it belongs to hinge 0 [0, 1, 2, 3], not to a bar"), ([], "")],
)
def test_nodes_without_bars_are_described_as_well(body, hinges, words):
    positions = np.array([0 * X, X, [0.5, 1, 0], [0.5, -1, 0.1]])
    scene = body(positions, np.ones(4), hinges=hinges)
    assert words in strained_most(scene, positions, 2)
    assert (strained_most(scene, positions, 2) == "") == (not hinges)


def test_steps_that_cost_accuracy_are_remarked_on(lattice):
    limit = stable_step(lattice(3))
    within = remark_of(lattice(3, dt=0.5 * limit, save_interval=0.5 * limit, duration=5 * limit))
    assert any("of the energy of the fastest mode" in remark for remark in within)
    near = remark_of(lattice(3, dt=0.95 * limit, save_interval=0.95 * limit, duration=9.5 * limit))
    assert any("deformation may lower it" in remark for remark in near)


def test_sound_steps_are_not_warned_about(lattice):
    assert remark_of(lattice(3, dt=1e-3)) == []


@pytest.mark.parametrize("name", ["lattice_3x3_gen0", "lattice_4x4_gen0"])
def test_experiments_of_the_older_package_are_stable(name):
    if not (UPSTREAM / name).exists():
        pytest.skip("needs the older package's experiments")
    experiment = load_experiment(UPSTREAM / name)
    assert DemlatProducer().supports(experiment) == []
