"""Experiment folders: round trip, checks, and both layouts."""

import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest
from experiments import assert_same, experiment, geometry

from openprc.errors import ConfigError
from openprc.schema.experiment import (
    Actuator,
    Signal,
    load_experiment,
    save_experiment,
)
from openprc.schema.geometry import Bars, Geometry, Hinges

# --- round trip ------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["", "input"])
def test_what_is_saved_is_loaded(tmp_path, place):
    files = save_experiment(experiment(), tmp_path)
    assert [file.name for file in files] == ["geometry.h5", "signals.h5", "config.json"]
    loaded = load_experiment(tmp_path / place)
    assert_same(experiment(), loaded)
    assert loaded.path == tmp_path
    assert loaded.sources == files
    assert loaded.layout == "1.0"
    assert sorted(path.name for path in (tmp_path / "input").iterdir()) == [
        "config.json",
        "geometry.h5",
        "signals.h5",
    ]


def test_saving_replaces_its_own_files_only(tmp_path):
    save_experiment(experiment(), tmp_path)
    other = tmp_path / "input" / "notes.txt"
    other.write_text("mine")
    save_experiment(experiment(damping=0.7), tmp_path)
    assert other.read_text() == "mine"
    assert load_experiment(tmp_path).damping == 0.7


def test_a_wrong_experiment_is_not_written(tmp_path):
    with pytest.raises(ConfigError, match="duration"):
        save_experiment(experiment(duration=-1.0), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_records_are_read_only_and_travel_between_processes():
    scene = experiment()
    with pytest.raises(ValueError, match="read-only"):
        scene.geometry.positions[0, 0] = 1.0
    with pytest.raises(AttributeError):
        scene.dt = 1.0
    assert_same(scene, pickle.loads(pickle.dumps(scene)))


def test_later_changes_of_the_callers_arrays_do_not_reach_in():
    values = np.zeros((3, 3))
    signal = Signal(name="u", values=values, dt=1.0)
    values[0] = 5
    assert not signal.values.any()


def test_units_in_the_file_are_converted(tmp_path):
    save_experiment(experiment(), tmp_path)
    with h5py.File(tmp_path / "input/geometry.h5", "r+") as file:
        file["nodes/positions"].attrs["unit"] = "mm"
        file["elements/bars/stiffness"].attrs["unit"] = "N/mm"
    with h5py.File(tmp_path / "input/signals.h5", "r+") as file:
        file["signals/push"].attrs["unit"] = "mN"
    loaded = load_experiment(tmp_path)
    np.testing.assert_allclose(loaded.geometry.positions, 1e-3 * geometry().positions)
    np.testing.assert_allclose(loaded.geometry.bars.stiffness, [1e4, 2e4])
    np.testing.assert_allclose(loaded.signals["push"].values[:, 0], [0, 1e-3, 5e-4])
    assert loaded.signals["push"].unit == "N"


def test_optional_columns_have_their_stated_defaults(tmp_path):
    save_experiment(experiment(), tmp_path)
    with h5py.File(tmp_path / "input/geometry.h5", "r+") as file:
        for key in (
            "nodes/fixed",
            "nodes/velocities",
            "nodes/label",
            "elements/bars/damping",
            "elements/bars/prestress",
            "elements/bars/rigid",
            "elements/hinges",
        ):
            del file[key]
    loaded = load_experiment(tmp_path).geometry
    assert not loaded.fixed.any()
    assert not loaded.velocities.any()
    assert loaded.labels is None
    assert not loaded.bars.damping.any()
    assert not loaded.bars.rigid.any()
    assert len(loaded.hinges) == 0


def test_without_actuators_no_signals_are_needed(tmp_path):
    save_experiment(experiment(actuators=(), signals={}), tmp_path)
    (tmp_path / "input/signals.h5").unlink()
    assert load_experiment(tmp_path).signals == {}


@pytest.mark.parametrize(
    ("changes", "planar"),
    [
        ({}, True),
        ({"gravity": (0.0, -9.81, 0.0)}, True),
        ({"gravity": (0.0, 0.0, -9.81)}, False),
        ({"axes": (True, True, True)}, False),
        ({"z": 0.1}, False),
        ({"vz": 0.1}, False),
    ],
)
def test_a_scene_is_planar_when_nothing_leaves_the_plane(changes, planar):
    axes = changes.pop("axes", (True, True, False))
    nodes = Geometry(
        positions=[[0, 0, 0], [1, 0, changes.pop("z", 0.0)]],
        masses=[1, 1],
        velocities=[[0, 0, 0], [0, 0, changes.pop("vz", 0.0)]],
    )
    scene = experiment(
        **({"gravity": (0.0, 0.0, 0.0)} | changes),
        geometry=nodes,
        actuators=(Actuator(node=1, signal="push", type="force", axes=axes),),
    )
    assert scene.planar == planar


@pytest.mark.parametrize(
    ("duration", "interval", "frames"), [(0.3, 0.1, 4), (0.7, 1e-3, 701), (8.2, 1e-2, 821)]
)
def test_frames_are_counted_by_rounding(duration, interval, frames):
    scene = experiment(duration=duration, save_interval=interval, dt=interval / 4)
    assert scene.n_frames == frames
    assert scene.steps_per_frame == 4
    assert scene.frame_times[-1] == pytest.approx(duration, rel=1e-15)


# --- checks ------------------------------------------------------------------------------------


def bars(**changes):
    columns = {"indices": [[0, 1], [1, 2]], "stiffness": [10.0, 20.0], "rest_length": [1.0, 1.0]}
    return geometry(bars=Bars(**(columns | changes)))


def hinges(**changes):
    columns = {"indices": [[0, 1, 2, 3]], "stiffness": [1.0], "rest_angle": [3.0]}
    return geometry(hinges=Hinges(**(columns | changes)))


NAN = float("nan")
GEOMETRIES = [
    (lambda: geometry(positions=np.zeros((0, 3)), masses=[]), "nodes/positions", "no nodes"),
    (lambda: geometry(positions=np.zeros((4, 2))), "nodes/positions", r"shape \(4, 2\)"),
    (lambda: geometry(masses=[1, 2]), "nodes/masses", r"shape \(2,\)"),
    (lambda: geometry(fixed=[True]), "nodes/fixed", r"shape \(1,\)"),
    (
        lambda: geometry(positions=[[NAN] * 3, *[[1, 0, 0]] * 3]),
        "nodes/positions",
        "NaN or infinity at node 0",
    ),
    (lambda: geometry(masses=[1, np.inf, 1, 1]), "nodes/masses", "NaN or infinity at node 1"),
    (lambda: geometry(masses=[1, 0, 1, 1]), "nodes/masses", "mass 0 kg at node 1"),
    (lambda: geometry(masses=[-1, 1, 1, 1]), "nodes/masses", "mass -1 kg at node 0"),
    (
        lambda: geometry(velocities=np.ones((4, 3))),
        "nodes/velocities",
        "fixed node 0 has a velocity",
    ),
    (lambda: geometry(labels=("a", "b")), "nodes/label", "2 labels"),
    (lambda: geometry(labels=("a", "b", "a", "c")), "nodes/label", "the label 'a' twice"),
    (
        lambda: bars(indices=[[0, 1], [1, 4]]),
        "elements/bars/indices",
        r"element 1 names node \[1, 4\]",
    ),
    (
        lambda: bars(indices=[[0, 1], [-1, 2]]),
        "elements/bars/indices",
        r"element 1 names node \[-1, 2\]",
    ),
    (
        lambda: bars(indices=[[0, 1], [2, 2]]),
        "elements/bars/indices",
        r"element 1 uses a node twice: \[2, 2\]",
    ),
    (
        lambda: bars(indices=[[0, 1], [1, 0]]),
        "elements/bars/indices",
        r"several bars between nodes \[0, 1\]",
    ),
    (lambda: bars(indices=[[0, 1, 2], [1, 2, 3]]), "elements/bars/indices", r"shape \(2, 3\)"),
    (lambda: bars(stiffness=[1.0]), "elements/bars/stiffness", r"shape \(1,\)"),
    (lambda: bars(stiffness=[1.0, NAN]), "elements/bars/stiffness", "NaN or infinity at element 1"),
    (lambda: bars(stiffness=[-1.0, 1]), "elements/bars/stiffness", "-1 at element 0"),
    (lambda: bars(rest_length=[-1.0, 1]), "elements/bars/rest_length", "-1 at element 0"),
    (lambda: bars(damping=[0.0, -2]), "elements/bars/damping", "-2 at element 1"),
    (lambda: bars(prestress=[-1.5, 0]), "elements/bars/prestress", "-1.5 at element 0"),
    (
        lambda: geometry(positions=[[0, 0, 0]] * 2 + [[1, 0, 0], [2, 0, 0]]),
        "elements/bars/indices",
        "element 0 are at one point",
    ),
    (
        lambda: hinges(indices=[[0, 1, 2, 99]]),
        "elements/hinges/indices",
        r"names node \[0, 1, 2, 99\]",
    ),
    (lambda: hinges(indices=[[0, 1, 2, -1]]), "elements/hinges/indices", "element 0 names node"),
    (lambda: hinges(indices=[[0, 1, 2, 2]]), "elements/hinges/indices", "uses a node twice"),
    (lambda: hinges(rest_angle=[NAN]), "elements/hinges/rest_angle", "NaN or infinity"),
    (lambda: hinges(stiffness=[-1.0]), "elements/hinges/stiffness", "-1 at element 0"),
    (lambda: hinges(damping=[-1.0]), "elements/hinges/damping", "-1 at element 0"),
    (lambda: geometry(faces=[[0, 1, 7]]), "elements/faces/indices", "names node"),
    (lambda: geometry(faces=[[0, 1]]), "elements/faces/indices", r"shape \(1, 2\)"),
]


@pytest.mark.parametrize(("make", "key", "words"), GEOMETRIES)
def test_mistakes_in_the_geometry(tmp_path, make, key, words):
    with pytest.raises(ConfigError, match=words) as caught:
        save_experiment(experiment(geometry=make(), actuators=()), tmp_path)
    assert caught.value.key == key
    assert caught.value.expected
    assert caught.value.file.endswith("geometry.h5")


def test_all_mistakes_of_the_geometry_come_together(tmp_path):
    wrong = geometry(
        masses=[1, 0, 1, 1],
        hinges=Hinges(indices=[[0, 1, 2, 9]], stiffness=[1.0], rest_angle=[3.0]),
    )
    with pytest.raises(ConfigError, match="2 mistakes") as caught:
        save_experiment(experiment(geometry=wrong, actuators=()), tmp_path)
    assert "nodes/masses" in caught.value.key
    assert "elements/hinges/indices" in caught.value.key


@pytest.mark.parametrize("held", ["fixed", "driven"])
def test_nodes_that_cannot_move_freely_need_no_mass(tmp_path, held):
    scene = experiment(geometry=geometry(masses=[0, 1, 1, 1] if held == "fixed" else [1, 1, 0, 1]))
    save_experiment(scene, tmp_path)


def signal(**changes):
    return Signal(**({"name": "push", "values": [0.0, 1.0], "dt": 0.1} | changes))


SIGNALS = [
    (lambda: signal(dt=0.0), "signals/push@dt", "0.0"),
    (lambda: signal(dt=-1.0), "signals/push@dt", "-1"),
    (lambda: signal(dt=NAN), "signals/push@dt", "nan"),
    (lambda: signal(values=[]), "signals/push", "0 samples"),
    (lambda: signal(values=np.zeros((0, 3))), "signals/push", "0 samples"),
    (lambda: signal(values=np.zeros((5, 2))), "signals/push", r"shape \(5, 2\)"),
    (lambda: signal(values=np.zeros((5, 2, 2))), "signals/push", r"shape \(5, 2, 2\)"),
    (lambda: signal(values=[0.0, NAN, 1.0]), "signals/push", "NaN or infinity at sample 1"),
    (lambda: signal(interpolation="spline"), "signals/push@interpolation", "'spline'"),
    (lambda: signal(values=[0, 1, 2], interpolation="cubic"), "signals/push", "3 samples"),
    (lambda: signal(unit="furlong"), "signals/push@unit", "'furlong'"),
]


@pytest.mark.parametrize(("make", "key", "words"), SIGNALS)
def test_mistakes_in_signals(tmp_path, make, key, words):
    scene = experiment()
    scene = replace(scene, signals=scene.signals | {"push": make()})
    with pytest.raises(ConfigError, match=words) as caught:
        save_experiment(scene, tmp_path)
    assert caught.value.key == key
    assert caught.value.file.endswith("signals.h5")


def test_names_of_signals_are_plain(tmp_path):
    scene = replace(experiment(), signals={"a/b": signal(name="a/b")}, actuators=())
    with pytest.raises(ConfigError, match="the name 'a/b'"):
        save_experiment(scene, tmp_path)


def actuator(**changes):
    return Actuator(**({"node": 1, "signal": "push", "type": "force"} | changes))


ACTUATORS = [
    ([actuator(node=9)], "actuators[0].node", "9[\\s\\S]*a node from 0 to 3"),
    ([actuator(node=-1)], "actuators[0].node", "-1"),
    (
        [actuator(signal="pusch")],
        "actuators[0].signal",
        "no signal is named 'pusch'[\\s\\S]*did you mean 'push'",
    ),
    ([actuator(type="banana")], "actuators[0].type", "'banana'"),
    ([actuator(axes=(False,) * 3)], "actuators[0].axes", "no axis is enabled"),
    (
        [actuator(node=0, type="position")],
        "actuators[0].node",
        "node 0 is fixed and has a position actuator",
    ),
    (
        [actuator(type="position"), actuator(type="position")],
        "actuators[1].node",
        "the x motion of node 1 is already prescribed",
    ),
    (
        [actuator(type="position"), actuator(type="velocity", axes=(False, False, True))],
        "actuators[1].node",
        "the z motion of node 1",
    ),
]


@pytest.mark.parametrize(("actuators", "key", "words"), ACTUATORS)
def test_mistakes_in_actuators(tmp_path, actuators, key, words):
    with pytest.raises(ConfigError, match=words) as caught:
        save_experiment(experiment(actuators=tuple(actuators)), tmp_path)
    assert key in caught.value.key
    assert caught.value.file.endswith("config.json")


def test_the_unit_of_a_signal_fits_what_it_drives(tmp_path):
    scene = experiment()
    scene = replace(scene, signals=scene.signals | {"push": signal(unit="m")})
    with pytest.raises(ConfigError, match="'force' with signal 'push', which is in 'm'"):
        save_experiment(scene, tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"dt": 0.0}, r"simulation\.dt: 0\.0"),
        ({"dt": -1.0}, r"simulation\.dt: -1"),
        ({"dt": NAN}, r"simulation\.dt: nan"),
        ({"duration": -1.0}, r"simulation\.duration: -1"),
        ({"save_interval": 0.0105}, r"0\.0105 s is 10\.5 times dt"),
        ({"duration": 0.995, "save_interval": 0.1}, r"0\.995 s is 9\.95 times save_interval"),
        ({"damping": -1.0}, r"physics\.damping: -1"),
        ({"gravity": (0.0, NAN, 0.0)}, r"physics\.gravity"),
    ],
)
def test_mistakes_in_settings(tmp_path, changes, words):
    with pytest.raises(ConfigError, match=words):
        save_experiment(experiment(**changes), tmp_path)
