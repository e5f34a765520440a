"""Recordings and vision files of the older packages."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from older_files import convert, motion, notes, write_run

from openprc.errors import (
    UnreadableFile,
)
from openprc.schema.legacy import LegacyImporter

# --- planar runs, recordings ---


def test_plane_run_has_two_dimensions(tmp_path):
    path = write_run(tmp_path / "a.h5", motion(planar=True), stored_drive=True)
    with h5py.File(path, "r+") as file:
        file["time_series/actuation_signals/1"][:, 2] = 0.0
    with convert(path, tmp_path / "run.h5") as run:
        assert run.dims == 2
        np.testing.assert_array_equal(run.positions(), motion(planar=True)[..., :2])
        assert run.input().columns == ("x", "y")
        assert "two dimensions" in notes(run)


def write_laboratory(path, *, missing=False):
    t = np.arange(60) / 29.97
    places = np.zeros((60, 3, 3))
    places[..., 0] = 100.0 * np.arange(3) + 5 * np.sin(t)[:, None]
    places[..., 1] = 50.0
    if missing:
        places[10:13, 1, 0] = np.nan
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 29.97
        file["time_series/time"] = t
        file["time_series/nodes/positions"] = places
        file["time_series/actuation_signals/2"] = np.cos(t)[:, None]
    return path


def test_laboratory_gaps_become_the_mask(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5", missing=True)
    with convert(path, tmp_path / "run.h5") as run:
        expected = np.ones((60, 3), "u1")
        expected[10:13, 1] = 0
        np.testing.assert_array_equal(run.observed(), expected)
        assert np.isnan(run.positions()[10:13, 1]).all()
        assert "3 of 180 places are missing" in notes(run)
        assert "leave that node out" not in notes(run)


def test_unit_of_a_recording_can_be_said(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5")
    with convert(path, tmp_path / "run.h5", unit="mm") as run:
        assert run.position_unit == "mm"
        assert run.input().unit == "mm"


def test_infinite_place_is_refused(tmp_path):
    path = write_laboratory(tmp_path / "lab.h5")
    with h5py.File(path, "r+") as file:
        file["time_series/nodes/positions"][7, 2, 1] = np.inf
    with pytest.raises(UnreadableFile, match=r"node 2 is at .* in frame 7"):
        convert(path, tmp_path / "run.h5")


def test_uneven_recording_keeps_its_times(tmp_path):
    path = tmp_path / "tracking_data.h5"
    stored = 1.7e9 + np.cumsum(np.random.default_rng(1).uniform(0.02, 0.05, 80))
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 30.0
        file["time"] = stored
        file["trajectories"] = np.random.default_rng(2).normal(size=(80, 4, 3))
    with convert(path, tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(run.time, stored - stored[0])
        assert not run.uniform
        assert run.dims == 3


def test_displacement_is_one_channel(tmp_path):
    path = tmp_path / "displacement_slice.h5"
    values = np.sin(np.arange(90.0))
    with h5py.File(path, "w") as file:
        file.attrs.update({"fps": 29.97, "duration": 3.0, "start_frame": 374})
        file["displacement"] = values
    with convert(path, tmp_path / "run.h5") as run:
        assert run.dims == 0
        np.testing.assert_array_equal(run.channel("displacement")[:, 0], values)
        np.testing.assert_allclose(run.time, np.arange(90) / 29.97, rtol=1e-15)
        assert "frame 0 is frame 374" in notes(run)
        assert "arb" in notes(run)


def test_displacement_without_a_rate_is_refused(tmp_path):
    path = tmp_path / "displacement_slice.h5"
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 0.0
        file["displacement"] = np.zeros(5)
    with pytest.raises(UnreadableFile, match=r"the frame rate is 0.0"):
        convert(path, tmp_path / "run.h5")


# --- the older video tracker ---


STATUS = np.ones((30, 4), "u1") * 0
STATUS[0] = 5
STATUS[10:, 1] = 1
STATUS[20:, 2] = 3
STATUS[5:8, 3] = 4


def write_vision(path, *, calibration=None, part="trajectories", scale=(1.0, 1.0)):
    t = np.arange(30) / 25.0
    pixels = np.stack([100 + 10 * np.sin(t)[:, None] + [0, 20, 40, 60]] * 2, axis=-1)
    places = pixels / scale
    places[10:, 1] = np.nan
    with h5py.File(path, "w") as file:
        group = file.create_group(f"vision/{part}")
        group["positions"] = places
        group["status"] = STATUS
        group["timestamps"] = t
        group.attrs["fps"] = 25.0
        if part == "trajectories":
            group["positions_px"] = pixels.astype("f4")
            group["feature_ids"] = np.array([3, 5, 8, 13], "i4")
            group.attrs["calibration"] = json.dumps(calibration)
        source = file.create_group("vision/source")
        source.attrs["path"] = "C:\\clips\\fold.mp4"
    return pixels


def test_vision_file_goes_back_to_pixels(tmp_path):
    path = tmp_path / "vision.h5"
    calibration = {"kind": "normalized", "frame_shape": [480, 640]}
    pixels = write_vision(path, calibration=calibration, scale=(640.0, 480.0))
    assert LegacyImporter().sniff(path) == 1.0
    with convert(path, tmp_path / "run.h5") as run:
        assert (run.position_unit, run.dims) == ("px", 2)
        seen = run.observed()
        np.testing.assert_array_equal(seen == 0, np.isin(STATUS, (1, 2, 3)))
        np.testing.assert_array_equal(seen == 2, STATUS == 4)
        np.testing.assert_allclose(run.positions()[seen > 0], pixels[seen > 0], rtol=1e-15)
        assert np.isnan(run.positions()[seen == 0]).all()
        np.testing.assert_array_equal(run.node("id"), [3, 5, 8, 13])
        assert "10 places of points marked as lost have numbers" in notes(run)
        assert "video fold.mp4" in notes(run)
        assert "clips" not in notes(run)


@pytest.mark.parametrize(
    ("stated", "unit"), [("mm", "mm"), ("camera_normalized", "arb"), ("furlong", "arb")]
)
def test_vision_file_with_a_camera(tmp_path, stated, unit):
    path = tmp_path / "vision.h5"
    write_vision(path, calibration={"kind": "camera", "physical_units": stated})
    with convert(path, tmp_path / "run.h5") as run:
        assert run.position_unit == unit


def test_vision_file_with_raw_tracks_only(tmp_path):
    path = tmp_path / "vision.h5"
    pixels = write_vision(path, part="tracking")
    with convert(path, tmp_path / "run.h5") as run:
        seen = run.observed()
        np.testing.assert_array_equal(run.positions()[seen > 0], pixels[seen > 0])
        assert run.dt == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("status", np.full((30, 4), 9, "u1"), "the code 9"),
        ("status", np.zeros((30, 3), "u1"), r"uint8 of shape \(30, 3\)"),
        ("timestamps", np.zeros(30), "time is 0.0 at frame 1"),
        ("timestamps", np.arange(29.0), "29 times"),
        ("positions", np.zeros((30, 8)), r"shape \(30, 8\)"),
    ],
)
def test_damaged_vision_file_is_named(tmp_path, name, value, words):
    path = tmp_path / "vision.h5"
    write_vision(path, part="tracking")
    with h5py.File(path, "r+") as file:
        del file[f"vision/tracking/{name}"]
        file[f"vision/tracking/{name}"] = value
    with pytest.raises(UnreadableFile, match=words):
        convert(path, tmp_path / "run.h5")


def test_vision_file_with_an_empty_calibration_has_arbitrary_lengths(tmp_path):
    path = tmp_path / "vision.h5"
    write_vision(path, calibration={})
    with convert(path, tmp_path / "run.h5") as run:
        assert run.position_unit == "arb"
        assert "no calibration is stored and no unit of length" in notes(run)


def test_vision_file_without_a_calibration_is_named(tmp_path):
    path = tmp_path / "vision.h5"
    write_vision(path, calibration=None)
    with pytest.raises(UnreadableFile, match="expected: a JSON object"):
        convert(path, tmp_path / "run.h5")
