"""Files that the older tracker saved."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

import openprc.vision as vision
from openprc.errors import UnreadableFile
from openprc.vision import NormalizedCalibration

T, N = 30, 4
TIMES = np.arange(T) / 25.0
STATUS = np.zeros((T, N), "u1")
STATUS[0], STATUS[10:, 1], STATUS[20:, 2], STATUS[5:8, 3] = 5, 1, 3, 4
PIXELS = np.stack([100 + 10 * np.sin(TIMES)[:, None] + np.arange(N) * 20] * 2, axis=-1)


def write(path, *, calibration=None, with_trajectories=True):
    """The layout of that program, written without it."""
    pixels = PIXELS.astype("f4")
    pixels[10:, 1] = np.nan
    with h5py.File(path, "w") as file:
        group = file.create_group("vision/source")
        group.attrs.update(
            {"source_type": "file", "path": "C:/lab/fold.mp4", "fps": 25.0, "width": 640,
             "height": 480, "frame_count": T, "content_hash": "ab" * 32}
        )  # fmt: skip
        group = file.create_group("vision/feature_map")
        for name, value in {
            "keypoints": PIXELS[0].astype("f4"), "descriptors": np.ones((N, 128), "f4"),
            "sizes": np.full(N, 7, "f4"), "angles": np.zeros(N, "f4"),
            "responses": np.arange(N, dtype="f4"), "octaves": np.zeros(N, "i4"),
        }.items():  # fmt: skip
            group.create_dataset(name, data=value, compression="gzip", compression_opts=4)
        group.attrs.update(
            {"detector_name": "sift", "detector_config": json.dumps({"contrast_threshold": 0.04}),
             "ref_frame_index": 0, "frame_shape": (480, 640)}
        )  # fmt: skip
        group = file.create_group("vision/tracking")
        group.create_dataset("positions", data=pixels, compression="gzip")
        group.create_dataset("status", data=STATUS, compression="gzip")
        group["timestamps"] = TIMES
        group.attrs.update(
            {"fps": 25.0, "frame_range": [0, T],
             "tracker_config": json.dumps({"win_size": [21, 21], "max_level": 3, "min_eig": 1e-4})}
        )  # fmt: skip
        if with_trajectories:
            group = file.create_group("vision/trajectories")
            group["positions"] = pixels.astype("f8") / (640.0, 480.0)
            group["positions_px"], group["status"], group["timestamps"] = pixels, STATUS, TIMES
            group["feature_ids"] = np.array([3, 5, 8, 13], "i4")
            group.attrs["fps"] = 25.0
            group.attrs["calibration"] = json.dumps(calibration or {})
            group.attrs["metadata"] = json.dumps({"detector": "sift"})
        group = file.create_group("vision/signals")
        group.create_dataset("data", data=pixels, compression="gzip")
        group.attrs["dim"] = 2
    return path


def test_everything_is_read(tmp_path):
    calibration = {"kind": "normalized", "frame_shape": [480, 640], "units": "normalized"}
    found = vision.load(write(tmp_path / "old.h5", calibration=calibration))
    assert set(found) == {
        "source", "feature_map", "tracking_result", "trajectory_set", "signals", "signals_meta",
    }  # fmt: skip
    assert found["source"]["frame_count"] == T
    features = found["feature_map"]
    assert (features.detector_name, len(features), features.frame_shape) == ("sift", N, (480, 640))
    assert np.isnan(features.track_sigma).all()
    assert features.keypoints.dtype == np.float64
    result = found["tracking_result"]
    seen = np.isin(STATUS, (0, 4, 5))
    np.testing.assert_array_equal(np.isnan(result.positions[..., 0]), ~seen)
    np.testing.assert_allclose(result.positions[seen], PIXELS[seen], rtol=1e-6)
    assert np.isnan(result.sigma).all()
    assert result.config is None
    assert "min_eig" in result.notes[-1]
    tracks = found["trajectory_set"]
    assert tracks.units == "1"
    assert isinstance(tracks.calibration, NormalizedCalibration)
    np.testing.assert_array_equal(tracks.observed, np.where(STATUS == 4, 2, seen))
    np.testing.assert_allclose(tracks.positions[seen], (PIXELS / (640, 480))[seen], rtol=1e-6)
    np.testing.assert_array_equal(tracks.feature_ids, [3, 5, 8, 13])
    assert found["signals_meta"] == {"dim": 2}


def test_an_unknown_calibration_leaves_arbitrary_units(tmp_path):
    found = vision.load(write(tmp_path / "old.h5", calibration={"kind": "fish"}), "trajectory_set")
    assert found["trajectory_set"].units == "arb"
    assert any("'fish'" in note for note in found["trajectory_set"].notes)


def test_outline_of_an_older_file(tmp_path):
    found = vision.info(write(tmp_path / "old.h5"))
    assert found["version"] == "older tracker"
    assert not found["simulation"]
    assert found["source"]["path"] == "C:/lab/fold.mp4"
    assert found["tracking_result_shape"] == [T, N, 2]


def test_what_was_loaded_is_saved_as_a_run(tmp_path):
    tracks = vision.load(write(tmp_path / "old.h5"), "tracking_result")["tracking_result"]
    path = vision.save(tmp_path / "new.h5", tracking_result=tracks)
    assert vision.info(path)["simulation"]


def test_damage_is_named(tmp_path):
    path = write(tmp_path / "old.h5", with_trajectories=False)
    with h5py.File(path, "r+") as file:
        del file["vision/tracking/timestamps"]
    with pytest.raises(UnreadableFile, match="tracking/timestamps: no numbers"):
        vision.load(path, "tracking_result")
