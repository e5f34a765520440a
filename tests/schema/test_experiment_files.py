"""Experiment folders on disk, in the present and the older layout."""

import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
from experiments import UPSTREAM, assert_same, experiment

from openprc.errors import ConfigError, SchemaTooNew, UnreadableFile, UnsafeFile
from openprc.schema.experiment import load_experiment, save_experiment

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
