"""Calibration files: ours, OpenCV's of both versions, ROS's; and files that are none."""

from __future__ import annotations

import json

import numpy as np
import pytest

import openprc.vision as vision
from openprc.errors import CalibrationError, ResultExists, SchemaTooNew, UnreadableFile
from openprc.vision.calibration.calibration_file import (
    calibration_from_dict,
    load_calibration,
    save_calibration,
)
from openprc.vision.opencv import load_cv2

K = np.array([[812.5, 0.0, 321.25], [0.0, 808.0, 238.5], [0.0, 0.0, 1.0]])
DIST = np.array([-0.3, 0.1, 0.001, -0.002, 0.02])
FROM_CV5 = """%YAML 1.2
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 812.5, 0., 321.25, 0., 808., 238.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: [ -0.3, 0.1, 0.001, -0.002, 0.02 ]
avg_reprojection_error: 0.21
"""
FROM_ROS = """image_width: 640
image_height: 480
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [812.5, 0, 321.25, 0, 808, 238.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.1, 0.001, -0.002, 0.02]
"""
FROM_LIST = """%YAML:1.0
---
K: [[812.5, 0, 321.25], [0, 808, 238.5], [0, 0, 1]]
"""


def write(tmp_path, text, name="camera.yml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
@pytest.mark.parametrize("names", [("camera_matrix", "dist_coeffs"), ("K", "D")])
@pytest.mark.parametrize("shape", [(5, 1), (1, 5), (5,)])
def test_what_opencv_writes(tmp_path, ending, names, shape):
    cv2 = load_cv2()
    path = tmp_path / f"kamera_ü.{ending}"
    storage = cv2.FileStorage(f".{ending}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write(names[0], K)
    storage.write(names[1], DIST.reshape(shape))
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    path.write_text(storage.releaseAndGetString(), encoding="utf-8")
    found = vision.CameraCalibration.from_opencv_yaml(path, scale_factor=300.0)
    assert found.matrix.tolist() == K.tolist()
    assert found.dist.tolist() == DIST.tolist()
    assert found.frame_shape == (480, 640)
    assert (found.scale_factor, found.units) == (300.0, "mm")
    assert load_calibration(path).matrix.tolist() == K.tolist()


@pytest.mark.parametrize("text", [FROM_CV5, FROM_ROS], ids=["opencv5", "ros"])
def test_files_of_other_programs(tmp_path, text):
    found = vision.CameraCalibration.from_opencv_yaml(write(tmp_path, text))
    assert found.matrix.tolist() == K.tolist()
    assert found.dist.tolist() == DIST.tolist()
    assert found.frame_shape == (480, 640)


def test_the_error_of_the_calibration_is_kept(tmp_path):
    assert vision.CameraCalibration.from_opencv_yaml(write(tmp_path, FROM_CV5)).rms == 0.21


def test_a_file_without_size_and_distortion(tmp_path):
    path = write(tmp_path, FROM_LIST)
    with pytest.raises(CalibrationError, match="which size of image"):
        vision.CameraCalibration.from_opencv_yaml(path)
    found = vision.CameraCalibration.from_opencv_yaml(path, frame_shape=(480, 640))
    assert found.matrix.tolist() == K.tolist()
    assert "no distortion coefficients" in found.notes[0]


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", UnreadableFile, "empty"),
        ("%YAML:1.0\n---\nK: [1, 2", UnreadableFile, "cannot parse"),
        ("%YAML:1.0\n---\na: 1\nb: 2\n", CalibrationError, "the file has a, b"),
        ("%YAML:1.0\n---\nK: [1, 2, 3]\n", CalibrationError, "has 3 numbers"),
        (FROM_ROS.replace("plumb_bob", "equidistant"), CalibrationError, "fisheye"),
        ("\0\1\2", UnreadableFile, "not text"),
    ],
    ids=["empty", "broken", "no-matrix", "short", "fisheye", "binary"],
)
def test_files_that_are_none(tmp_path, text, error, words):
    path = write(tmp_path, text)
    with pytest.raises(error, match=words) as caught:
        vision.CameraCalibration.from_opencv_yaml(path)
    assert str(path) in str(caught.value)
    assert caught.value.expected
    assert caught.value.fix


def test_missing_files(tmp_path):
    for load in (load_calibration, vision.CameraCalibration.from_opencv_yaml):
        with pytest.raises(UnreadableFile, match="no such file"):
            load(tmp_path / "no.yml")
        with pytest.raises(UnreadableFile, match="folder"):
            load(tmp_path)


# --- our own ------------------------------------------------------------------------------------


def test_ours_there_and_back(tmp_path):
    camera = vision.CameraCalibration.from_matrix(
        K, DIST, frame_shape=(480, 640), scale_factor=1 / 3, rms=0.123, sigma={"fx": 0.5}
    )
    path = save_calibration(tmp_path / "camera.json", camera)
    again = load_calibration(path)
    assert again == camera
    assert again.sigma == {"fx": 0.5}
    assert again.scale_factor == 1 / 3
    with pytest.raises(ResultExists):
        save_calibration(path, camera)
    save_calibration(path, camera, overwrite=True)
    assert [item.name for item in tmp_path.iterdir()] == ["camera.json"]


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"format": "other"}, UnreadableFile, "no calibration"),
        ({"version": 99}, SchemaTooNew, "newer openprc"),
        ({"kind": "tape"}, CalibrationError, "'tape'"),
        ({"p0": None}, CalibrationError, "p0"),
        ({"p1": [10.0, 20.0]}, CalibrationError, "px apart"),
        ({"colour": "red"}, CalibrationError, "colour"),
        ({"units": "kg"}, CalibrationError, "mass"),
    ],
    ids=["format", "version", "kind", "missing", "senseless", "unknown", "unit"],
)
def test_spoiled_files(tmp_path, change, error, words):
    path = tmp_path / "bar.json"
    save_calibration(path, vision.ScaleBar((10, 20), (90, 20), 4.0, "mm"))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(error, match=words) as caught:
        load_calibration(path)
    assert caught.value.file == str(path)


def test_json_that_is_broken(tmp_path):
    with pytest.raises(UnreadableFile, match="not JSON"):
        load_calibration(write(tmp_path, '{"format": ', "a.json"))
    with pytest.raises(UnreadableFile, match="no calibration"):
        load_calibration(write(tmp_path, "[1, 2]", "b.json"))


def test_from_dict_without_a_kind():
    with pytest.raises(CalibrationError, match="kind of calibration is None"):
        calibration_from_dict({})
