"""Every mistake in a setup is refused by name, and what is right works."""

import json

import h5py
import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine, SimulationSetup
from openprc.errors import ConfigError

BARS, HINGES = "elements/bars", "elements/hinges"


# --- built in Python -----------------------------------------------------------------------------


def start(folder, **times):
    setup = SimulationSetup(folder, overwrite=True)
    setup.add_node([0, 0, 0], fixed=True)
    setup.add_node([1, 0, 0])
    settings = {"duration": 0.1, "dt": 1e-3, "save_interval": 1e-2} | times
    setup.set_simulation_params(**settings)
    return setup


def with_hinge(setup, nodes, **settings):
    setup.add_nodes([[0.5, 1, 0], [0.5, -1, 0]])
    setup.add_hinge(nodes, stiffness=1.0, **settings)


def with_signal(setup, values, *, node=1, **settings):
    setup.add_signal("u", values, dt=0.1)
    setup.add_actuator(node, settings.pop("signal", "u"), **{"type": "force"} | settings)


IN_PYTHON = {
    "NaN position": (lambda s: s.add_node([np.nan, 0, 0]), "nodes/positions: NaN"),
    "mass 0": (lambda s: s.add_node([2, 0, 0], mass=0.0), "nodes/masses: mass 0 kg at node 2"),
    "mass below 0": (lambda s: s.add_node([2, 0, 0], mass=-1), "nodes/masses: mass -1 kg"),
    "bar to no node": (lambda s: s.add_bar(0, 99, stiffness=1.0), "99"),
    "bar before the nodes": (lambda s: s.add_bar(0, -1, stiffness=1.0), "-1"),
    "bar to itself": (lambda s: s.add_bar(1, 1, stiffness=1.0), "uses a node twice"),
    "rest length": (
        lambda s: s.add_bar(0, 1, stiffness=1.0, rest_length=-1.0), "bars/rest_length: -1",
    ),
    "stiffness": (lambda s: s.add_bar(0, 1, stiffness=np.nan), "bars/stiffness: NaN"),
    "hinge to no node": (lambda s: with_hinge(s, [0, 1, 2, 99]), "99"),
    "hinge before the nodes": (lambda s: with_hinge(s, [0, 1, 2, -1]), "-1"),
    "hinge with a node twice": (
        lambda s: with_hinge(s, [0, 1, 2, 2], rest_angle=3.0), "uses a node twice",
    ),
    "hinge of three nodes": (lambda s: with_hinge(s, [0, 1, 2]), "a hinge with 3 nodes"),
    "rest angle": (
        lambda s: with_hinge(s, [0, 1, 2, 3], rest_angle=np.nan), "hinges/rest_angle: NaN",
    ),
    "NaN signal": (lambda s: with_signal(s, [0.0, np.nan]), "signals/u: NaN"),
    "empty signal": (lambda s: with_signal(s, np.zeros((0, 3))), r"signals/u: shape \(0, 3\)"),
    "two columns": (lambda s: with_signal(s, np.zeros((4, 2))), r"signals/u: shape \(4, 2\)"),
    "no signal": (lambda s: with_signal(s, [0.0], signal="v"), "no signal is named 'v'"),
    "banana": (lambda s: with_signal(s, [0.0], type="banana"), r"actuators\[0\].type: 'banana'"),
    "actuator beyond the nodes": (lambda s: with_signal(s, [0.0], node=99), "99"),
    "actuator before the nodes": (lambda s: with_signal(s, [0.0], node=-1), "-1"),
    "half a node": (lambda s: s.add_bar(0, 1.5, stiffness=1.0), "1.5"),
    "gravity": (lambda s: s.set_physics(gravity=[0, 1]), r"gravity of shape \(2,\)"),
    "NaN gravity": (lambda s: s.set_physics(gravity=np.nan), "physics.gravity"),
    "damping": (lambda s: s.set_physics(damping=-1.0), "physics.damping"),
    "step of 0": (lambda s: start(s.directory, dt=0.0).save(), "simulation.dt: 0.0"),
    "step below 0": (lambda s: start(s.directory, dt=-1e-3).save(), "simulation.dt: -0.001"),
    "NaN step": (lambda s: start(s.directory, dt=np.nan).save(), "simulation.dt: nan"),
    "step of text": (lambda s: start(s.directory, dt="1 ms"), "dt = '1 ms'"),
}  # fmt: skip


@pytest.mark.parametrize("name", IN_PYTHON)
def test_setups_refuse_and_write_nothing(tmp_path, name):
    wrong, words = IN_PYTHON[name]

    def build():
        setup = start(tmp_path)
        wrong(setup)
        setup.save()

    with pytest.raises(ConfigError, match=words):
        build()
    assert list(tmp_path.iterdir()) == []


def test_without_times_there_is_nothing_to_save(tmp_path):
    setup = SimulationSetup(tmp_path)
    setup.add_node([0, 0, 0])
    with pytest.raises(ConfigError, match="no duration, dt and save_interval"):
        setup.save()


# --- what has to work ----------------------------------------------------------------------------


def test_gravity_may_be_a_vector(tmp_path):
    setup = start(tmp_path)
    setup.set_physics(gravity=[1.0, -2.0, 0.5])
    setup.save()
    with h5py.File(Engine(BarHingeModel).run(tmp_path).path) as file:
        moved = file["time_series/nodes/positions"][-1, 1]
    assert moved == pytest.approx(np.array([1, 0, 0]) + 0.5 * 0.1**2 * np.array([1, -2, 0.5]))


def test_node_numbers_may_be_numpy_integers(tmp_path):
    setup = SimulationSetup(tmp_path)
    first, second = np.arange(2, dtype=np.int64)
    setup.add_nodes(np.eye(3)[:2])
    setup.add_bar(first, second, stiffness=np.float32(10.0))
    setup.add_signal("u", np.zeros(3, np.float32), dt=np.float32(0.5))
    setup.add_actuator(np.uint8(1), "u", type="force", dof=np.array([1, 0, 0]))
    setup.set_simulation_params(duration=np.float64(0.1), dt=1e-3, save_interval=1e-2)
    setup.save()
    written = json.loads((tmp_path / "input/config.json").read_text())
    assert written["actuators"][0]["node"] == 1
    assert Engine(BarHingeModel).run(tmp_path).n_frames == 11


def test_what_files_can_get_wrong_scripts_can_too():
    shared = {"NaN position", "mass 0", "mass below 0", "NaN signal", "empty signal", "step of 0"}
    assert shared <= set(IN_PYTHON)
