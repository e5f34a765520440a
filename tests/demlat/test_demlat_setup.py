"""Building experiments in Python."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from openprc import demlat
from openprc.demlat import SimulationSetup
from openprc.errors import ConfigError, ResultExists
from openprc.schema import Trajectory
from openprc.schema.experiment import load_experiment

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"


def small(folder, *, overwrite=False):
    setup = SimulationSetup(folder, overwrite=overwrite)
    a = setup.add_node([0, 0, 0], fixed=True, label="a")
    b = setup.add_node((3.0, 4.0), mass=0.5, velocity=[0, 1], label="b")
    setup.add_bar(a, b, stiffness=10, damping=0.1, prestress=0.01)
    setup.add_signal("u", [0.0, 1.0], dt=0.5, interpolation="hold")
    setup.add_actuator(b, "u", type="force", axes=[1, 0, 0])
    setup.set_physics(gravity=-9.81, damping=0.2)
    setup.set_simulation_params(duration=1.0, dt=1e-3, save_interval=1e-2)
    return setup


def test_what_was_built_is_what_is_saved(tmp_path):
    small(tmp_path).save()
    scene = load_experiment(tmp_path)
    assert scene.geometry.positions.tolist() == [[0, 0, 0], [3, 4, 0]]
    assert scene.geometry.bars.rest_length.tolist() == [5.0]
    assert scene.geometry.bars.prestress.tolist() == [0.01]
    assert scene.geometry.velocities.tolist() == [[0, 0, 0], [0, 1, 0]]
    assert scene.geometry.labels == ("a", "b")
    assert scene.gravity == (0.0, 0.0, -9.81)
    assert scene.actuators[0].axes == (True, False, False)
    assert scene.signals["u"].unit == "N"
    assert not scene.overwrite


def test_nothing_happens_before_save(tmp_path):
    folder = tmp_path / "x"
    small(folder)
    assert not folder.exists()


def test_overwriting_leaves_foreign_files_alone(tmp_path):
    small(tmp_path).save()
    keep = [tmp_path / "mine.txt", tmp_path / "input/visualization.h5", tmp_path / "output/old.h5"]
    for path in keep:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    setup = SimulationSetup(tmp_path, overwrite=True)
    setup.add_node([1, 2, 3])
    setup.set_simulation_params(duration=1.0, dt=0.1, save_interval=0.5)
    assert all(path.exists() for path in keep)
    assert load_experiment(tmp_path).geometry.n_nodes == 2
    setup.save()
    assert all(path.read_text() == "mine" for path in keep)
    assert load_experiment(tmp_path).geometry.n_nodes == 1
    assert load_experiment(tmp_path).overwrite


def test_without_overwrite_an_experiment_is_loaded_and_extended(tmp_path):
    small(tmp_path).save()
    setup = SimulationSetup(tmp_path)
    assert setup.n_nodes == 2
    c = setup.add_node([0, 8], label="c")
    setup.add_bar(1, c, stiffness=5)
    setup.save()
    scene = load_experiment(tmp_path)
    assert scene.geometry.n_nodes == 3
    assert scene.geometry.bars.stiffness.tolist() == [10, 5]
    assert scene.geometry.bars.damping.tolist() == [0.1, 0]
    assert scene.actuators[0].signal == "u"
    assert scene.damping == 0.2


@pytest.mark.skipif(not UPSTREAM.exists(), reason="recorded files are not at hand")
def test_older_folders_are_loaded_and_saved_elsewhere_only(tmp_path):
    setup = SimulationSetup(UPSTREAM / "yoshimura")
    with pytest.raises(ResultExists, match="older layout, and saving would convert them"):
        setup.save()
    setup.save(tmp_path)
    assert load_experiment(tmp_path).geometry.n_nodes == 18


def test_numpy_integers_are_node_numbers(tmp_path):
    setup = SimulationSetup(tmp_path)
    nodes = np.array(setup.add_nodes(np.eye(4, 3) + [[0, 0, 0]] * 4, mass=0.1))
    setup.add_bar(nodes[0], nodes[1], stiffness=np.float32(2.0))
    setup.add_hinge(nodes, stiffness=np.int64(1), rest_angle=np.float64(3.0))
    setup.add_face(nodes[:3])
    setup.add_signal("u", np.zeros((3, 3), dtype="f4"), dt=np.float32(0.5))
    setup.add_actuator(nodes[3], "u", dof=np.array([1, 0, 1]))
    setup.set_simulation_params(duration=1, dt=0.1, save_interval=1)
    setup.save()
    scene = load_experiment(tmp_path)
    assert scene.actuators[0].node == 3
    assert scene.actuators[0].axes == (True, False, True)
    assert scene.geometry.faces.tolist() == [[0, 1, 2]]


def test_a_hinge_rests_where_it_is_unless_told(tmp_path):
    setup = SimulationSetup(tmp_path)
    setup.add_nodes([[0, 0, 0], [1, 0, 0], [0, 1, 1], [0, -1, 0]])
    setup.add_hinge([0, 1, 2, 3], stiffness=1.0)
    assert setup.geometry().hinges.rest_angle[0] == pytest.approx(0.75 * np.pi)


CALLS = [
    (lambda s: s.add_bar(0, 7, stiffness=1), "node 7[\\s\\S]*a node from 0 to 1"),
    (lambda s: s.add_bar(0, -1, stiffness=1), "node -1"),
    (lambda s: s.add_bar("a", 1, stiffness=1), "node 'a'"),
    (lambda s: s.add_bar(1.5, 1, stiffness=1), "node 1.5"),
    (lambda s: s.add_bar(True, 0, stiffness=1), "node True"),
    (lambda s: s.add_bar(0, 1, stiffness="stiff"), "stiffness: found 'stiff'"),
    (lambda s: s.add_bar(0, 1, stiffness=[1, 2]), "stiffness: found"),
    (lambda s: s.add_hinge([0, 1, 0], stiffness=1), "a hinge with 3 nodes"),
    (lambda s: s.add_face([0, 1]), "a face with 2 nodes"),
    (lambda s: s.add_node([1.0]), r"position: shape \(1,\)"),
    (lambda s: s.add_node([[0, 0, 0]]), r"position: shape \(1, 3\)"),
    (lambda s: s.add_nodes([1.0, 2.0]), r"positions: shape \(2,\)"),
    (lambda s: s.add_signal("u", [1.0], dt=1), "a second signal named 'u'"),
    (lambda s: s.add_actuator(9, "u"), "node 9"),
    (lambda s: s.add_actuator(1, "u", axes=[1, 1]), r"axes: axes \[1, 1\]"),
    (lambda s: s.add_actuator(1, "u", dof=[1, 1, 2]), r"axes \[1, 1, 2\]"),
    (lambda s: s.add_actuator(1, "u", dof=[1, 1, 1], axes=[1, 1, 1]), "both axes and dof"),
    (lambda s: s.set_physics(gravity=[1, 2]), r"gravity of shape \(2,\)"),
    (lambda s: (s.add_node([0, 0, 0]), s.save()), "node 2 has no label and others have one"),
    (lambda s: (s.add_actuator(1, "nope"), s.save()), "no signal is named 'nope'"),
    (lambda s: (s.add_bar(1, 0, stiffness=1), s.save()), "several bars between nodes"),
]


@pytest.mark.parametrize(("call", "words"), CALLS)
def test_mistakes_are_named(tmp_path, call, words):
    setup = small(tmp_path)
    with pytest.raises(ConfigError, match=words):
        call(setup)
    assert list(tmp_path.iterdir()) == []


def test_settings_have_to_be_made(tmp_path):
    setup = SimulationSetup(tmp_path)
    with pytest.raises(ConfigError, match="a node that was added before"):
        setup.add_bar(0, 1, stiffness=1)
    setup.add_node([0, 0, 0])
    with pytest.raises(ConfigError, match=r"call set_simulation_params\(\)"):
        setup.save()


def test_importing_the_package_is_light():
    code = (
        "import sys, openprc.demlat;"
        "from openprc.demlat import SimulationSetup, BarHingeModel, Engine, Simulation;"
        "print([m for m in ('numba', 'scipy', 'pydantic', 'jax') if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def test_unknown_names_are_no_attributes():
    import openprc.demlat

    assert "Engine" in dir(openprc.demlat)
    with pytest.raises(AttributeError, match="no attribute 'Motor'"):
        _ = openprc.demlat.Motor


def test_what_is_stored_can_be_chosen(tmp_path):
    setup = SimulationSetup(tmp_path / "small", overwrite=True)
    a = setup.add_node([0, 0, 0], fixed=True)
    b = setup.add_node([1.1, 0.2, 0])
    setup.add_bar(a, b, stiffness=5.0, rest_length=1.0)
    setup.set_simulation_params(duration=0.1, dt=0.01, save_interval=0.01)
    whole = demlat.Engine(demlat.BarHingeModel).run(setup.save()[0].parents[1]).path
    setup.set_export(precision="float32", velocities=False, elements=False)
    setup.save(tmp_path / "lean")
    assert SimulationSetup(tmp_path / "lean").experiment().stored.precision == "float32"
    lean = demlat.Engine(demlat.BarHingeModel).run(tmp_path / "lean").path
    with Trajectory(whole) as one, Trajectory(lean) as two:
        assert one.element_series("bars") == ("force", "length", "strain")
        assert two.element_series("bars") == ()
        assert two.has("/topology/bars/indices")
        assert not two.has("/time_series/nodes/velocities")
        np.testing.assert_array_equal(two.positions(), one.positions().astype("f4"))
        np.testing.assert_array_equal(two.system("total_energy"), one.system("total_energy"))


def test_an_unknown_storage_precision_is_named(tmp_path):
    setup = SimulationSetup(tmp_path)
    setup.add_node([0, 0, 0])
    setup.set_simulation_params(duration=0.1, dt=0.01, save_interval=0.01)
    setup.set_export(precision="float16")
    with pytest.raises(ConfigError, match=r"export.precision: 'float16'"):
        setup.save()
