"""Experiment folders: round trip, checks, and both layouts."""

import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, SchemaTooNew, UnreadableFile, UnsafeFile
from openprc.schema.experiment import (
    Actuator,
    Bars,
    Collision,
    Experiment,
    Geometry,
    Hinges,
    Signal,
    load_experiment,
    save_experiment,
)

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"


def geometry(**changes):
    columns = {
        "positions": [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0]],
        "masses": [0.1, 0.2, 0.3, 0.4],
        "fixed": [True, False, False, False],
        "bars": Bars(
            indices=[[0, 1], [1, 2]],
            stiffness=[10, 20],
            rest_length=[1, 1.1],
            damping=[0.1, 0.2],
            prestress=[0, -0.01],
            rigid=[False, True],
        ),
        "hinges": Hinges(indices=[[0, 1, 2, 3]], stiffness=[0.5], rest_angle=[3.0], damping=[0.01]),
        "faces": [[0, 1, 2], [0, 3, 1]],
        "velocities": [[0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]],
        "labels": ("a", "b", "c", "d"),
    }
    return Geometry(**(columns | changes))


def experiment(**changes):
    settings = {
        "geometry": geometry(),
        "signals": {
            "push": Signal(name="push", values=[0.0, 1.0, 0.5], dt=0.1, interpolation="hold"),
            "move": Signal(name="move", values=np.ones((4, 3)), dt=0.2, interpolation="cubic"),
        },
        "actuators": (
            Actuator(node=1, signal="push", type="force", axes=(False, True, False)),
            Actuator(node=2, signal="move"),
        ),
        "duration": 1.0,
        "dt": 1e-3,
        "save_interval": 1e-2,
        "gravity": (0.0, 0.1, -9.81),
        "damping": 0.3,
        "collision": Collision(enabled=True, radius=0.01),
    }
    return Experiment(**(settings | changes))


def assert_same(one, two):
    for name in ("positions", "masses", "fixed", "velocities", "collidable", "faces"):
        np.testing.assert_array_equal(getattr(one.geometry, name), getattr(two.geometry, name))
    assert one.geometry.labels == two.geometry.labels
    for name in ("indices", "stiffness", "rest_length", "damping", "prestress", "rigid"):
        np.testing.assert_array_equal(
            getattr(one.geometry.bars, name), getattr(two.geometry.bars, name)
        )
    for name in ("indices", "stiffness", "rest_angle", "damping", "rigid"):
        np.testing.assert_array_equal(
            getattr(one.geometry.hinges, name), getattr(two.geometry.hinges, name)
        )
    assert set(one.signals) == set(two.signals)
    for name, signal in one.signals.items():
        other = two.signals[name]
        np.testing.assert_array_equal(signal.values, other.values)
        assert (signal.dt, signal.interpolation) == (other.dt, other.interpolation)
    for name in ("actuators", "duration", "dt", "save_interval", "integrator", "gravity"):
        assert getattr(one, name) == getattr(two, name)
    for name in ("damping", "collision", "overwrite"):
        assert getattr(one, name) == getattr(two, name)


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


# --- files ---------------------------------------------------------------------------------------


def edit_geometry(tmp_path, change):
    save_experiment(experiment(), tmp_path)
    with h5py.File(tmp_path / "input/geometry.h5", "r+") as file:
        change(file)


def replace_dataset(key, values):
    def change(file):
        del file[key]
        if values is not None:
            file[key] = values

    return change


FILES = [
    (
        replace_dataset("nodes/positions", None),
        ConfigError,
        "nodes/positions: the dataset is missing",
    ),
    (
        replace_dataset("nodes/positions", np.array([b"x"])),
        ConfigError,
        "nodes/positions: the type",
    ),
    (
        replace_dataset("elements/bars/indices", np.array([[0.5, 1.0]])),
        ConfigError,
        "the type float64",
    ),
    (
        replace_dataset("elements/bars/indices", np.array([[0, 2**40], [1, 2]])),
        ConfigError,
        "beyond 32 bits",
    ),
    (
        replace_dataset("elements/bars/stiffness", None),
        ConfigError,
        "elements/bars/stiffness: the dataset is missing",
    ),
    (lambda f: f.attrs.__setitem__("kind", "signals"), ConfigError, "of kind 'signals'"),
    (lambda f: f.attrs.__setitem__("openprc_schema", "2.0"), SchemaTooNew, "layout version 2.0"),
    (
        lambda f: f["nodes/positions"].attrs.__setitem__("unit", "kg"),
        Exception,
        "cannot convert 'kg'",
    ),
    (lambda f: f.__setitem__("x", h5py.ExternalLink("/etc/hosts", "/")), UnsafeFile, "link"),
]


@pytest.mark.parametrize(("change", "error", "words"), FILES)
def test_mistakes_in_geometry_files(tmp_path, change, error, words):
    edit_geometry(tmp_path, change)
    with pytest.raises(error, match=words) as caught:
        load_experiment(tmp_path)
    assert caught.value.file.endswith("geometry.h5")


def test_signals_say_their_time_step(tmp_path):
    save_experiment(experiment(), tmp_path)
    with h5py.File(tmp_path / "input/signals.h5", "r+") as file:
        del file["signals/push"].attrs["dt"]
    with pytest.raises(ConfigError, match="signals/push@dt: the attribute is missing"):
        load_experiment(tmp_path)


@pytest.mark.parametrize("missing", ["geometry.h5", "signals.h5", "config.json"])
def test_missing_files_are_named(tmp_path, missing):
    save_experiment(experiment(), tmp_path)
    (tmp_path / "input" / missing).unlink()
    with pytest.raises(UnreadableFile, match=f"{missing}: the file does not exist"):
        load_experiment(tmp_path)


@pytest.mark.parametrize(("make", "words"), [(True, "no experiment here"), (False, "not exist")])
def test_a_folder_without_experiment_is_named(tmp_path, make, words):
    folder = tmp_path / "x"
    if make:
        folder.mkdir()
    with pytest.raises(UnreadableFile, match=words):
        load_experiment(folder)


def test_only_numpy_and_h5py_are_needed_until_a_config_is_read():
    code = (
        "import sys; import openprc.schema.experiment, openprc.schema.experiment_files;"
        "print([m for m in ('pydantic', 'numba', 'scipy') if m in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


# --- the older layout ----------------------------------------------------------------------------


def write_old(folder, *, attributes=(1, 0, 2, 4), **changes):
    """A folder in the older layout, as programs of that time wrote it."""
    (folder / "input").mkdir()
    with h5py.File(folder / "input/geometry.h5", "w") as file:
        datasets = {
            "nodes/positions": np.eye(4, 3, dtype="f4"),
            "nodes/masses": np.full(4, 0.25, "f4"),
            "nodes/attributes": np.array(attributes, "u1"),
            "elements/bars/indices": np.array([[0, 1], [1, 2]], "i4"),
            "elements/bars/stiffness": np.array([50, -1], "f4"),
            "elements/bars/rest_length": np.ones(2, "f4"),
            "elements/bars/damping": np.array([0.5, 0.25], "f4"),
            "elements/hinges/indices": np.array([[0, 1, 2, 3]], "i4"),
            "elements/hinges/stiffness": np.array([0.5], "f4"),
            "elements/hinges/phi0": np.array([3.5], "f4"),
            "elements/hinges/damping": np.array([0.1], "f4"),
        } | changes
        for key, values in datasets.items():
            if values is not None:
                file[key] = values
    with h5py.File(folder / "input/signals.h5", "w") as file:
        file.attrs["dt_base"] = 0.001
        file["sig"] = np.zeros((10, 3))
    config = {
        "simulation": {"duration": 1.0, "dt_base": 0.001, "dt_save": 0.01},
        "global_physics": {"gravity": 0, "global_damping": 0.5},
        "actuators": [{"node_idx": 2, "signal_name": "sig", "type": "position", "dof": [1, 1, 1]}],
    }
    (folder / "input/config.json").write_text(json.dumps(config))


def test_the_older_layout_is_read(tmp_path):
    write_old(tmp_path)
    scene = load_experiment(tmp_path)
    assert scene.layout == "legacy"
    assert scene.geometry.fixed.tolist() == [True, False, False, False]
    assert scene.geometry.bars.rigid.tolist() == [False, True]
    assert scene.geometry.bars.stiffness.tolist() == [50.0, 0.0]
    assert scene.geometry.hinges.rest_angle.tolist() == [3.5]
    assert scene.geometry.hinges.damping.tolist() == [0.0]
    assert scene.signals["sig"].dt == 0.001
    assert scene.signals["sig"].interpolation == "linear"
    assert any("no elements/bars/prestress: 0" in note for note in scene.notes)
    assert any("hinge damping had no effect" in note for note in scene.notes)


def test_bits_and_names_of_the_older_layout(tmp_path):
    write_old(
        tmp_path,
        attributes=(8, 9, 3, 0),
        **{
            "elements/hinges/phi0": None,
            "elements/hinges/angle": np.array([1.5], "f4"),
            "elements/bars/damping": None,
        },
    )
    scene = load_experiment(tmp_path)
    assert scene.geometry.collidable.tolist() == [True, True, False, False]
    # Node 2 has the fixed bit too, but a signal moves it.
    assert scene.geometry.fixed.tolist() == [False, True, False, False]
    assert scene.geometry.hinges.rest_angle.tolist() == [1.5]
    assert any("node 2 has the fixed bit" in note for note in scene.notes)
    assert any("no elements/bars/damping: 0" in note for note in scene.notes)


OLD_MISTAKES = [
    ({"attributes": (2, 0, 2, 0)}, "node 0 is marked position-driven and no actuator drives it"),
    ({"nodes/masses": None}, "nodes/masses: the dataset is missing"),
    ({"nodes/attributes": np.zeros(4)}, "nodes/attributes: the type float64"),
    ({"elements/hinges/damping": np.array([-1.0])}, "negative damping at hinge 0"),
    ({"elements/hinges/phi0": None}, "elements/hinges/phi0: the dataset is missing"),
    ({"elements/hinges/indices": np.array([[0, 1, 2, 99]])}, "names node"),
]


@pytest.mark.parametrize(("changes", "words"), OLD_MISTAKES)
def test_mistakes_in_the_older_geometry(tmp_path, changes, words):
    write_old(tmp_path, **changes)
    with pytest.raises(ConfigError, match=words):
        load_experiment(tmp_path)


def test_the_older_signals_say_dt_base_and_lie_at_the_root(tmp_path):
    write_old(tmp_path)
    with h5py.File(tmp_path / "input/signals.h5", "r+") as file:
        file["group/sig2"] = np.zeros(3)
    with pytest.raises(ConfigError, match="group: a group where a signal was expected"):
        load_experiment(tmp_path)
    with h5py.File(tmp_path / "input/signals.h5", "r+") as file:
        del file["group"], file.attrs["dt_base"]
    with pytest.raises(ConfigError, match="@dt_base: the attribute is missing"):
        load_experiment(tmp_path)


@pytest.mark.skipif(not UPSTREAM.exists(), reason="recorded files are not at hand")
@pytest.mark.parametrize(
    ("name", "nodes", "n_bars", "frames"),
    [
        ("lattice_3x3_gen0", 9, 12, 3001),
        ("lattice_4x4_gen0", 16, 22, 3001),
        ("yoshimura", 18, 42, 2001),
    ],
)
def test_real_older_folders_survive_the_change_of_layout(tmp_path, name, nodes, n_bars, frames):
    scene = load_experiment(UPSTREAM / name)
    assert scene.geometry.n_nodes == nodes
    assert len(scene.geometry.bars) == n_bars
    assert scene.n_frames == frames
    assert scene.layout == "legacy"
    save_experiment(scene, tmp_path)
    again = load_experiment(tmp_path)
    assert again.layout == "1.0"
    assert_same(scene, again)
