"""`save`, `load`, `info`: one file, valid as a run, whose parts come back one by one."""

from __future__ import annotations

import json
from dataclasses import fields

import h5py
import numpy as np
import pytest

import openprc.vision as vision
from openprc.errors import ConfigError, MissingData, ResultExists, SchemaError, UnreadableFile
from openprc.hooks.validating import validate_run
from openprc.reservoir import StateLoader
from openprc.schema import Trajectory, validate_file
from openprc.schema.derive import pack
from openprc.vision import (
    ArraySource,
    FeatureMap,
    KLTConfig,
    ScaleBar,
    Status,
    TrackingResult,
    TrajectorySet,
)
from openprc.vision.source.time_axis import TimeAxis

T, N = 24, 5


def images():
    rng = np.random.default_rng(0)
    return rng.integers(0, 256, (T, 40, 60), dtype=np.uint8)


def tracking_result():
    axis = TimeAxis.from_stamps(np.delete(np.arange(T + 2), [9, 10]) / 50.0, declared_fps=50.0)
    phase = 2 * np.pi * axis.times[:, None] + np.arange(N)
    positions = np.stack([30 + 5 * np.sin(phase), 20 + 3 * np.cos(phase)], axis=2)
    status = np.zeros((T, N), np.uint8)
    status[0] = Status.REFERENCE
    status[5:8, 1], status[15:, 2], status[3, 4] = Status.LOST, Status.OOB, Status.DRIFT
    positions[np.isin(status, (1, 2, 3))] = np.nan
    rng = np.random.default_rng(1)
    return TrackingResult(
        positions=positions, status=status, timestamps=axis.times, time_axis=axis,
        quality=rng.uniform(0.9, 1, (T, N)).astype("f4"),
        sigma=rng.uniform(0.01, 0.02, (T, N, 2)).astype("f4"),
        template=rng.integers(0, 3, (T, N)).astype("i4"),
        deformation=rng.standard_normal((T, N, 2, 2)).astype("f4"),
        feature_ids=np.array([3, 5, 8, 13, 21]), noise=1.25, config=KLTConfig(fb_threshold=0.4),
        frame_shape=(40, 60), notes=("the tracker says ü",),
    )  # fmt: skip


@pytest.fixture
def parts(tmp_path):
    source = ArraySource(images(), fps=50.0, name="clip")
    points = np.random.default_rng(2).uniform(5, 35, (9, 2))
    features = FeatureMap.from_points(
        points, frame_shape=(40, 60), detector_config={"threshold": 0.5}
    )
    result = tracking_result()
    bar = ScaleBar((0.0, 0.0), (50.0, 0.0), 10.0, "mm")
    tracks = TrajectorySet.from_tracking_result(result, calibration=bar)
    tracks = tracks.select_features([0, 1, 2, 3]).fill_gaps("linear", max_gap=10).smooth(5)
    return {
        "source": source, "feature_map": features, "tracking_result": result,
        "trajectory_set": tracks, "signals": tracks.to_signals(dim=2),
        "signals_meta": {"dim": 2, "units": tracks.units, "washout": None},
    }  # fmt: skip


def same(first, second):
    """Compare two objects field by field."""
    for field in fields(first):
        one, two = getattr(first, field.name), getattr(second, field.name)
        if field.name in ("config", "calibration", "time_axis"):
            assert (one is None) == (two is None), field.name
            assert repr(one) == repr(two), field.name
        elif field.name == "positions_px" and one is not None:
            np.testing.assert_array_equal(one.astype("f4"), two.astype("f4"))
        elif isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, two, err_msg=field.name)
            assert one.dtype == two.dtype, field.name
        else:
            assert one == two, field.name


@pytest.fixture
def saved(parts, tmp_path):
    return vision.save(tmp_path / "experiment_vision.h5", **parts)


# --- a run like any other -----------------------------------------------------------------------


def test_the_file_is_a_valid_run(saved, parts):
    assert [finding.code for finding in validate_file(saved).findings] == ["OPS-I04"]
    assert "error" not in {finding.level for finding in validate_run(saved).findings}
    tracks = parts["trajectory_set"]
    with Trajectory(saved) as run:
        np.testing.assert_array_equal(run.time, tracks.timestamps)
        np.testing.assert_array_equal(run.positions(), tracks.positions)
        np.testing.assert_array_equal(run.observed(), tracks.observed)
        assert (run.position_unit, run.axes, run.dims) == ("mm", ("x", "y"), 2)
        assert run.node("label").tolist() == ["p3", "p5", "p8", "p13"]
        np.testing.assert_array_equal(run.node("id"), [3, 5, 8, 13])
        for name in ("quality", "sigma", "status", "template"):
            found = run.extension("openprc-vision", name)
            np.testing.assert_array_equal(found, getattr(tracks, name).astype(found.dtype))
        assert run.unit("/extensions/openprc-vision/sigma") == "mm"
        notes = run.provenance["notes"]
        assert "the tracker says ü" in notes
        assert any("gaps" in note for note in notes)
        config = run.provenance["config"]
        assert config["tracker"]["fb_threshold"] == 0.4
        assert config["calibration"]["kind"] == "scale-bar"
        assert config["detector"]["name"] == "points"
        assert [item["operation"] for item in config["operations"]] == [
            "calibrate", "select_features", "fill_gaps", "smooth",
        ]  # fmt: skip


def test_the_loader_of_reservoirs_reads_it_unchanged(saved, parts):
    complete = parts["trajectory_set"].select_tracked(1.0)
    loader = StateLoader(saved)
    nodes = [0, 1, 3]
    np.testing.assert_array_equal(loader.positions(nodes), complete.positions)
    with pytest.raises(MissingData):
        loader.positions()


def test_a_tracking_result_alone_is_a_run_in_pixels(parts, tmp_path):
    path = vision.save(tmp_path / "tracks.h5", tracking_result=parts["tracking_result"])
    assert validate_file(path).ok
    with Trajectory(path) as run:
        assert run.position_unit == "px"
        np.testing.assert_array_equal(run.positions(), parts["tracking_result"].positions)


def test_three_dimensions_and_pure_numbers(tmp_path):
    positions = np.random.default_rng(0).standard_normal((6, 2, 3))
    tracks = TrajectorySet(positions, np.arange(6.0), units="1", frame="world")
    path = vision.save(tmp_path / "space.h5", trajectory_set=tracks)
    assert validate_file(path).ok
    same(tracks, vision.load(path)["trajectory_set"])
    with Trajectory(path) as run:
        assert (run.dims, run.frame) == (3, "world")


def test_without_trajectories_it_is_no_run_and_says_so(parts, tmp_path):
    path = vision.save(tmp_path / "points.h5", feature_map=parts["feature_map"])
    assert not vision.info(path)["simulation"]
    assert vision.info(path)["components"] == ["feature_map"]
    with pytest.raises(SchemaError, match="not a file of this contract"):
        Trajectory(path)
    with h5py.File(path) as file:
        assert "no simulation.h5" in file.attrs["comment"]


def test_a_packed_copy_is_the_same(saved, tmp_path, parts):
    path = pack(saved, tmp_path / "packed.h5")
    assert validate_file(path).ok
    same(parts["trajectory_set"], vision.load(path)["trajectory_set"])


# --- parts ---------------------------------------------------------------------------------------


def test_everything_comes_back(saved, parts):
    found = vision.load(saved)
    assert list(found) == [*parts]
    for name in ("feature_map", "tracking_result", "trajectory_set"):
        same(parts[name], found[name])
    np.testing.assert_array_equal(found["signals"], parts["signals"])
    assert found["signals_meta"] == {"dim": 2, "units": "mm", "washout": "null"}
    assert found["source"]["path"] == "clip"
    assert found["source"]["content_hash"] == parts["source"].content_hash()
    assert found["source"]["fps"] == 50.0
    assert found["tracking_result"].time_axis.dropped == ((8, 2, pytest.approx(0.06)),)


@pytest.mark.parametrize(
    "names",
    [("source",), ("feature_map",), ("tracking_result",), ("trajectory_set",), ("signals",),
     ("feature_map", "signals"), ("source", "tracking_result", "trajectory_set")],
    ids="+".join,
)  # fmt: skip
def test_any_combination_is_written_and_read(parts, tmp_path, names):
    path = vision.save(tmp_path / "some.h5", **{name: parts[name] for name in names})
    assert [name for name in vision.load(path) if name != "signals_meta"] == list(names)
    assert vision.info(path)["components"] == list(names)


def test_one_component_is_read_without_the_others(saved):
    with h5py.File(saved, "r+") as file:
        del file["vision/feature_map/keypoints"]
        del file["vision/trajectories/status"]
    assert list(vision.load(saved, components=("tracking_result",))) == ["tracking_result"]
    assert list(vision.load(saved, "signals")) == ["signals", "signals_meta"]
    with pytest.raises(UnreadableFile, match="feature_map/keypoints: no numbers"):
        vision.load(saved)
    with pytest.raises(UnreadableFile, match="trajectories/status: no codes"):
        vision.load(saved, components=["trajectory_set"])


DAMAGE = {
    "tracking/positions": (np.zeros((T, N)), "tracking_result", r"shape \(24, 5\)"),
    "tracking/status": (np.full((T, N), 9), "tracking_result", "the code 9"),
    "tracking/timestamps": (np.zeros(T), "tracking_result", "time is 0.0 at frame 1"),
    "tracking/sigma": (np.zeros((T, N)), "tracking_result", r"tracking/sigma: shape \(24, 5\)"),
    "trajectories/positions": (np.zeros((T, 3, 2)), "trajectory_set", "uint8 of shape"),
    "feature_map/sizes": (np.zeros(3), "feature_map", "feature_map/sizes: 3 rows"),
    "signals/data": (np.zeros(3), "signals", "signals/data: no such array"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_parts_are_named(saved, name):
    value, component, words = DAMAGE[name]
    with h5py.File(saved, "r+") as file:
        del file[f"vision/{name}"]
        file[f"vision/{name}"] = value
    with pytest.raises(UnreadableFile, match=words):
        vision.load(saved, components=component)


@pytest.mark.parametrize(
    ("owner", "name", "component"),
    [
        ("tracking", "tracker_config", "tracking_result"),
        ("tracking", "time_axis", "tracking_result"),
        ("tracking", "notes", "tracking_result"),
        ("trajectories", "calibration", "trajectory_set"),
        ("trajectories", "metadata", "trajectory_set"),
        ("feature_map", "detector_config", "feature_map"),
        ("source", "description", "source"),
    ],
)
def test_damaged_settings_are_named(saved, owner, name, component):
    with h5py.File(saved, "r+") as file:
        file[f"vision/{owner}"].attrs[name] = "{not JSON"
    with pytest.raises(UnreadableFile, match=f"/vision/{owner}@{name}"):
        vision.load(saved, components=component)


def test_settings_of_another_version_are_told(saved):
    with h5py.File(saved, "r+") as file:
        file["vision/tracking"].attrs["tracker_config"] = json.dumps({"turbo": True})
        file["vision/trajectories"].attrs["calibration"] = json.dumps({"kind": "guess"})
    found = vision.load(saved)
    assert found["tracking_result"].config is None
    assert "another version of the tracker: {'turbo': True}" in found["tracking_result"].notes[-1]
    assert found["trajectory_set"].calibration is None
    assert "'guess'" in found["trajectory_set"].notes[-1]
    assert found["trajectory_set"].units == "mm"


@pytest.mark.parametrize(
    ("components", "error", "words"),
    [
        ("tracks", ConfigError, "there is no component 'tracks'"),
        (("signals", "sound"), ConfigError, "there is no component 'sound'"),
        ("signals", MissingData, "the file holds no signals"),
    ],
)
def test_components_that_are_not_there(parts, tmp_path, components, error, words):
    path = vision.save(tmp_path / "some.h5", source=parts["source"])
    with pytest.raises(error, match=words):
        vision.load(path, components=components)


def test_files_of_other_kinds_are_refused(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(3)
    for read in (vision.load, vision.info):
        with pytest.raises(UnreadableFile, match="there is no group /vision"):
            read(path)
        with pytest.raises(UnreadableFile, match="does not exist"):
            read(tmp_path / "nowhere.h5")


def test_outline(saved):
    found = vision.info(saved)
    assert found["components"] == list(vision.storage.parts.PARTS)
    assert found["simulation"]
    assert found["tracking_result_shape"] == [T, N, 2]
    assert found["trajectory_set_shape"] == [T, 4, 2]
    assert found["signals_shape"] == [T, 4, 2]
    assert found["feature_map_shape"] == [9, 2]
    assert (found["units"], found["detector"], found["version"]) == ("mm", "points", "1.0")
    assert found["unknown"] == []
    json.dumps(found)
    with h5py.File(saved, "r+") as file:
        file.create_group("vision/sound")
    assert vision.info(saved)["unknown"] == ["sound"]


# --- writing -------------------------------------------------------------------------------------


def test_nothing_is_replaced_unless_asked(saved, parts):
    before = saved.read_bytes()
    with pytest.raises(ResultExists, match="finished file of this name"):
        vision.save(saved, source=parts["source"])
    assert saved.read_bytes() == before
    vision.save(saved, source=parts["source"], overwrite=True)
    assert vision.info(saved)["components"] == ["source"]


def test_a_failure_leaves_nothing_behind(parts, tmp_path, monkeypatch):
    path = tmp_path / "experiment.h5"

    def fail(group, value):
        raise OSError("the disk is full")

    monkeypatch.setattr("openprc.vision.storage.parts.write_trajectories", fail)
    with pytest.raises(OSError, match="the disk is full"):
        vision.save(path, **parts)
    assert list(tmp_path.iterdir()) == []


def test_no_folder_is_stored(parts, tmp_path, monkeypatch):
    described = {**parts["source"].describe(), "path": str(tmp_path / "clip.avi"),
                 "calibration_images": [str(tmp_path / "one.png")]}  # fmt: skip
    monkeypatch.setattr(parts["source"], "describe", lambda: described, raising=False)
    parts["signals_meta"] = {"made_from": r"C:\lab\run 7\clip.avi", "folder": tmp_path}
    path = vision.save(tmp_path / "experiment.h5", **parts)
    texts: list[str] = []

    def collect(_, item):
        texts.extend(str(value) for value in item.attrs.values())

    with h5py.File(path) as file:
        file.visititems(collect)
        texts.append(str(file["provenance/config"][()]))
    joined = " ".join(texts)
    assert str(tmp_path) not in joined
    assert "lab" not in joined
    found = vision.load(path)
    assert found["source"]["path"] == "clip.avi"
    assert found["source"]["calibration_images"] == ["one.png"]
    assert found["signals_meta"] == {"made_from": "clip.avi", "folder": tmp_path.name}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "there is nothing to save"),
        ({"signals_meta": {"dim": 2}, "source": 1}, "signals_meta without signals"),
        ({"signals": np.zeros(4)}, r"signals of type float64 and shape \(4,\)"),
        ({"signals": np.zeros((4, 2), complex)}, "signals of type complex128"),
        ({"signals": [["a", "b"]]}, "signals of type <U1"),
    ],
)
def test_calls_that_make_no_sense(tmp_path, arguments, words):
    with pytest.raises(ConfigError, match=words):
        vision.save(tmp_path / "run.h5", **arguments)
    assert list(tmp_path.iterdir()) == []


def test_settings_without_json_are_refused(parts, tmp_path):
    with pytest.raises(ConfigError, match="cannot be stored as JSON"):
        vision.save(
            tmp_path / "run.h5", signals=parts["signals"], signals_meta={"hook": {"f": object()}}
        )


def test_no_pickle_and_no_reference_is_in_the_file(saved):
    def check(_, item):
        if isinstance(item, h5py.Dataset):
            assert (
                item.dtype.kind in "fiu" or h5py.check_string_dtype(item.dtype) or item.dtype.names
            )

    with h5py.File(saved) as file:
        file["vision"].visititems(check)
