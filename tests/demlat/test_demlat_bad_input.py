"""Wrong input: every kind is refused by name, before anything is written."""

import errno
import json
import re
import shutil

import h5py
import numpy as np
import pytest
from spoiled_inputs import config, drop, put, remove, signal

from openprc.demlat import BarHingeModel, Engine, SimulationSetup
from openprc.errors import ConfigError, OpenPRCError, UnreadableFile, UnsupportedScene
from openprc.schema.experiment import load_experiment

BARS, HINGES = "elements/bars", "elements/hinges"


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """An experiment folder in the present layout with one of everything."""
    folder = tmp_path_factory.mktemp("sound")
    setup = SimulationSetup(folder)
    setup.add_node([0, 0, 0], fixed=True)
    setup.add_nodes([[1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0.0]], mass=0.2)
    for pair in ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3)):
        setup.add_bar(*pair, stiffness=20.0, damping=0.1)
    setup.add_hinge([0, 1, 2, 3], stiffness=0.1)
    setup.add_signal("push", [[0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], dt=0.05)
    setup.add_actuator(3, "push", type="force")
    setup.set_simulation_params(duration=0.1, dt=1e-3, save_interval=1e-2)
    setup.save()
    return folder


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    """The same in the layout of the older package, as its own setup writes it."""
    folder = tmp_path_factory.mktemp("older")
    (folder / "input").mkdir()
    with h5py.File(folder / "input/geometry.h5", "w") as file:
        positions = [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0]]
        file["nodes/positions"] = np.array(positions, "f4")
        file["nodes/masses"] = np.full(4, 0.2, "f4")
        file["nodes/attributes"] = np.array([1, 0, 0, 4], "u1")
        file[f"{BARS}/indices"] = np.array([[0, 1], [0, 2], [1, 2], [0, 3], [1, 3]], "i4")
        file[f"{BARS}/stiffness"] = np.full(5, 20.0, "f4")
        file[f"{BARS}/rest_length"] = np.ones(5, "f4")
        file[f"{BARS}/damping"] = np.full(5, 0.1, "f4")
        file[f"{BARS}/prestress"] = np.zeros(5, "f4")
        file[f"{HINGES}/indices"] = np.array([[0, 1, 2, 3]], "i4")
        file[f"{HINGES}/stiffness"] = np.array([0.1], "f4")
        file[f"{HINGES}/angle"] = np.array([3.0], "f4")
    with h5py.File(folder / "input/signals.h5", "w") as file:
        file.attrs["dt_base"] = 0.05
        file["push"] = np.array([[0, 0.1, 0], [0, 0, 0.1]])
    config = {
        "simulation": {"duration": 0.1, "dt_base": 1e-3, "dt_save": 1e-2},
        "global_physics": {"gravity": 0.0, "global_damping": 0.0},
        "material": {"damping_coefficient": 0.0},
        "actuators": [
            {"node_idx": 3, "signal_name": "push", "type": "force", "dof": [1, 1, 1]},
        ],
    }
    (folder / "input/config.json").write_text(json.dumps(config))
    return folder


# --- putting mistakes into files -----------------------------------------------------------------


NAN3 = [np.nan, 0.0, 0.0]
#: name: (spoil, error, file, key, words)
BOTH_LAYOUTS = {
    "NaN position": (
        put("nodes/positions@2", NAN3), ConfigError, "geometry.h5", "nodes/positions",
        "NaN or infinity at node 2",
    ),
    "infinite position": (
        put("nodes/positions@1", [0.0, np.inf, 0.0]), ConfigError, "geometry.h5",
        "nodes/positions", "NaN or infinity at node 1",
    ),
    "mass 0": (
        put("nodes/masses@1", 0.0), ConfigError, "geometry.h5", "nodes/masses",
        "mass 0 kg at node 1",
    ),
    "mass below 0": (
        put("nodes/masses@1", -1.0), ConfigError, "geometry.h5", "nodes/masses",
        "mass -1 kg at node 1",
    ),
    "NaN mass": (
        put("nodes/masses@1", np.nan), ConfigError, "geometry.h5", "nodes/masses", "NaN",
    ),
    "bar beyond the nodes": (
        put(f"{BARS}/indices@1", [0, 99]), ConfigError, "geometry.h5", f"{BARS}/indices",
        "element 1 names node .0, 99.",
    ),
    "bar before the nodes": (
        put(f"{BARS}/indices@1", [0, -1]), ConfigError, "geometry.h5", f"{BARS}/indices",
        "element 1 names node .0, -1.",
    ),
    "bar from a node to itself": (
        put(f"{BARS}/indices@1", [2, 2]), ConfigError, "geometry.h5", f"{BARS}/indices",
        "element 1 uses a node twice",
    ),
    "bar without length": (
        put("nodes/positions@1", [0.0, 0.0, 0.0]), ConfigError, "geometry.h5", f"{BARS}/indices",
        "the nodes of element 0 are at one point",
    ),
    "rest length below 0": (
        put(f"{BARS}/rest_length@1", -1.0), ConfigError, "geometry.h5", f"{BARS}/rest_length",
        "-1 at element 1",
    ),
    "NaN stiffness": (
        put(f"{BARS}/stiffness@1", np.nan), ConfigError, "geometry.h5", f"{BARS}/stiffness",
        "NaN or infinity at element 1",
    ),
    "hinge beyond the nodes": (
        put(f"{HINGES}/indices@0", [0, 1, 2, 99]), ConfigError, "geometry.h5",
        f"{HINGES}/indices", "element 0 names node .0, 1, 2, 99.",
    ),
    "hinge before the nodes": (
        put(f"{HINGES}/indices@0", [0, 1, -1, 3]), ConfigError, "geometry.h5",
        f"{HINGES}/indices", "element 0 names node .0, 1, -1, 3.",
    ),
    "hinge with a node twice": (
        put(f"{HINGES}/indices@0", [0, 1, 2, 2]), ConfigError, "geometry.h5",
        f"{HINGES}/indices", "element 0 uses a node twice",
    ),
    "hinge of five nodes": (
        put(f"{HINGES}/indices", np.arange(5)[None]), ConfigError, "geometry.h5",
        f"{HINGES}/indices", "shape .1, 5.",
    ),
    "no stiffness of bars": (
        drop(f"{BARS}/stiffness"), ConfigError, "geometry.h5", f"{BARS}/stiffness", "is missing",
    ),
    "no rest length of bars": (
        drop(f"{BARS}/rest_length"), ConfigError, "geometry.h5", f"{BARS}/rest_length",
        "is missing",
    ),
    "no indices of hinges": (
        drop(f"{HINGES}/indices"), ConfigError, "geometry.h5", f"{HINGES}/indices", "is missing",
    ),
    "no positions": (
        drop("nodes/positions"), ConfigError, "geometry.h5", "nodes/positions", "is missing",
    ),
    "no masses": (drop("nodes/masses"), ConfigError, "geometry.h5", "nodes/masses", "is missing"),
    "no nodes": (
        put("nodes/positions", np.zeros((0, 3))), ConfigError, "geometry.h5", "nodes", "no nodes",
    ),
    "NaN signal": (
        signal(np.array([[0.0, 0.0, 0.0], NAN3])), ConfigError, "signals.h5", "signals/push",
        "NaN or infinity at sample 1",
    ),
    "empty signal": (
        signal(np.zeros((0, 3))), ConfigError, "signals.h5", "signals/push", "0 samples",
    ),
    "signal of two columns": (
        signal(np.zeros((5, 2))), ConfigError, "signals.h5", "signals/push", "shape .5, 2.",
    ),
    "signal of text": (
        signal(np.array([b"a", b"b"])), ConfigError, "signals.h5", "push", "the type",
    ),
    "no signals.h5": (remove("signals.h5"), UnreadableFile, "signals.h5", None, "does not exist"),
    "no geometry.h5": (
        remove("geometry.h5"), UnreadableFile, "geometry.h5", None, "does not exist",
    ),
    "no config.json": (remove("config.json"), UnreadableFile, "config.json", None, "not exist"),
    "actuator of no type": (
        config("actuators/0/type"), ConfigError, "config.json", "actuators[0].type", "missing",
    ),
    "actuator of type banana": (
        config("actuators/0/type", "banana"), ConfigError, "config.json", "actuators[0].type",
        "found 'banana'",
    ),
    "no duration": (
        config("simulation/duration"), ConfigError, "config.json", "simulation.duration",
        "the key is missing",
    ),
    "duration of text": (
        config("simulation/duration", "1 s"), ConfigError, "config.json", "simulation.duration",
        "found '1 s'",
    ),
    "no times": (config("simulation"), ConfigError, "config.json", "simulation", "missing"),
}  # fmt: skip
PRESENT = BOTH_LAYOUTS | {
    "no signal of that name": (
        config("actuators/0/signal", "pusch"), ConfigError, "config.json", "actuators[0].signal",
        "no signal is named 'pusch'",
    ),
    "the signal is gone": (
        drop("signals/push", file="signals.h5"), ConfigError, "config.json",
        "actuators[0].signal", "no signal is named 'push'",
    ),
    "actuator without a signal": (
        config("actuators/0/signal"), ConfigError, "config.json", "actuators[0].signal",
        "the key is missing",
    ),
    "actuator beyond the nodes": (
        config("actuators/0/node", 99), ConfigError, "config.json", "actuators[0].node",
        "99\n  expected: a node from 0 to 3",
    ),
    "actuator before the nodes": (
        config("actuators/0/node", -1), ConfigError, "config.json", "actuators[0].node", "-1",
    ),
    "force on a fixed node": (
        config("actuators/0/node", 0), UnsupportedScene, "", "actuators[0].axes",
        "a force on x of node 0, which is fixed",
    ),
    "step of 0": (
        config("simulation/dt", 0.0), ConfigError, "config.json", "simulation.dt",
        "found 0.0\n  expected: greater than 0",
    ),
    "step below 0": (
        config("simulation/dt", -1e-3), ConfigError, "config.json", "simulation.dt",
        "found -0.001",
    ),
    "step of NaN": (
        config("simulation/dt", float("nan")), ConfigError, "config.json", None, "the number NaN",
    ),
    "step that does not divide the interval": (
        config("simulation/dt", 3e-3), ConfigError, "config.json", "simulation.save_interval",
        "3.33333 times dt",
    ),
    "gravity of two numbers": (
        config("physics/gravity", [0.0, 1.0]), ConfigError, "config.json", "physics.gravity", "",
    ),
    "NaN rest angle": (
        put(f"{HINGES}/rest_angle@0", np.nan), ConfigError, "geometry.h5",
        f"{HINGES}/rest_angle", "NaN or infinity at element 0",
    ),
}  # fmt: skip
OLDER = BOTH_LAYOUTS | {
    "no attributes": (
        drop("nodes/attributes"), ConfigError, "geometry.h5", "nodes/attributes", "is missing",
    ),
    "NaN rest angle": (
        put(f"{HINGES}/angle@0", np.nan), ConfigError, "geometry.h5", f"{HINGES}/rest_angle",
        "NaN or infinity at element 0",
    ),
    "no time step of signals": (
        lambda folder: h5py.File(folder / "input/signals.h5", "a").attrs.__delitem__("dt_base"),
        ConfigError, "signals.h5", "@dt_base", "the attribute is missing",
    ),
    "actuator without signal_name": (
        config("actuators/0/signal_name"), ConfigError, "config.json",
        "actuators[0].signal_name", "the key is missing",
    ),
    "actuator beyond the nodes": (
        config("actuators/0/node_idx", 99), ConfigError, "config.json", "actuators[0].node",
        "99\n  expected: a node from 0 to 3",
    ),
    "step of 0": (
        config("simulation/dt_base", 0.0), ConfigError, "config.json", "simulation.dt_base",
        "greater than 0",
    ),
    "step below 0": (
        config("simulation/dt_base", -1e-3), ConfigError, "config.json", "simulation.dt_base",
        "greater than 0",
    ),
    "no gravity": (
        config("global_physics/gravity"), ConfigError, "config.json", "global_physics.gravity",
        "the key is missing",
    ),
}  # fmt: skip


def spoiled(original, target, spoil):
    shutil.copytree(original / "input", target / "input")
    spoil(target)
    return target


def refused(folder, command, row):
    """Run it from Python and from the command line; both say the same and write nothing."""
    _, kind, name, key, words = row
    with pytest.raises(OpenPRCError) as caught:
        Engine(BarHingeModel).run(folder)
    error = caught.value
    assert type(error) is kind, error
    assert re.search(words, str(error)), error
    assert name in (error.file or "")
    if key is not None:
        assert key in (error.key or ""), error
    code, _, printed = command("run", folder)
    assert code == 2
    assert printed == f"error: {error}\n"
    assert not (folder / "output").exists()


@pytest.mark.parametrize("name", PRESENT)
def test_the_present_layout_is_refused_by_name(sound, tmp_path, command, name):
    row = PRESENT[name]
    refused(spoiled(sound, tmp_path, row[0]), command, row)


@pytest.mark.parametrize("name", OLDER)
def test_the_older_layout_is_refused_by_name(older, tmp_path, command, name):
    row = OLDER[name]
    refused(spoiled(older, tmp_path, row[0]), command, row)


def test_a_step_that_would_blow_up_is_refused(sound, tmp_path, command):
    times = {"duration": 1.0, "dt": 0.5, "save_interval": 0.5, "integrator": "rk4"}
    row = (
        config("simulation", times), UnsupportedScene, "", "simulation.dt",
        r"dt = 0.5 s with the integrator 'rk4', whose motion would blow up: bar \d",
    )  # fmt: skip
    refused(spoiled(sound, tmp_path, row[0]), command, row)


def test_dashpots_that_the_older_layout_leaves_out_are_said_to_be_none(older, tmp_path):
    folder = spoiled(older, tmp_path, drop(f"{BARS}/damping", f"{BARS}/prestress"))
    notes = load_experiment(folder).notes
    assert f"geometry.h5 has no {BARS}/damping: 0 for every bar" in notes
    assert f"geometry.h5 has no {BARS}/prestress: 0 for every bar" in notes
    result = Engine(BarHingeModel).run(folder)
    assert set(notes) <= set(result.notes)


def test_both_layouts_run_when_nothing_is_wrong(sound, older, tmp_path):
    for name, original in (("new", sound), ("old", older)):
        folder = spoiled(original, tmp_path / name, lambda folder: None)
        assert Engine(BarHingeModel).run(folder).n_frames == 11


# --- what goes wrong while running ---------------------------------------------------------------


def test_a_full_disk_leaves_no_finished_result(sound, tmp_path, command, monkeypatch):
    folder = spoiled(sound, tmp_path, lambda folder: None)

    def full(self, *arguments, **named):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("openprc.schema.writer.TrajectoryWriter.append", full)
    code, _, printed = command("run", folder)
    assert code == 1
    assert "No space left on device" in printed
    assert not (folder / "output/simulation.h5").exists()


def test_a_result_that_is_not_valid_keeps_no_final_name(sound, tmp_path, monkeypatch):
    folder = spoiled(sound, tmp_path, lambda folder: None)

    def reject(*arguments):
        raise ConfigError("not what was promised", expected="a valid file")

    monkeypatch.setattr("openprc.hooks.running.refuse_invalid", reject)
    with pytest.raises(ConfigError, match="not what was promised"):
        Engine(BarHingeModel).run(folder)
    left = [path.name for path in (folder / "output").iterdir()]
    assert left == ["simulation.h5.partial"]
    with h5py.File(folder / "output" / left[0]) as file:
        assert file.attrs["status"] == "failed"


def test_the_matrix_covers_both_layouts():
    """Rows that a script can get wrong as well stand in test_demlat_bad_setup.py."""
    shared = {"NaN position", "mass 0", "mass below 0", "NaN signal", "empty signal", "step of 0"}
    assert shared <= set(PRESENT) & set(OLDER)
