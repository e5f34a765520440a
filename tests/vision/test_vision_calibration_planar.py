"""Planes: exact homographies, tilt, how well they are known, and points that make none."""

from __future__ import annotations

import numpy as np
import pytest
from rendered_boards import rotation

import openprc.vision as vision
from openprc.errors import CalibrationError
from openprc.vision.calibration.point_pairs import read_pairs

SHAPE = (480, 640)
K = [[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]]
DIST = [-0.25, 0.1, 0.001, -0.0015]
GRID = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2) * 30.0


def seen(turn, *, dist=None, distance=600.0):
    """Pixels of GRID on a plane turned about its middle, through a known camera."""
    camera = vision.CameraCalibration.from_matrix(K, dist, frame_shape=SHAPE)
    middle = np.array([75.0, 60.0, 0.0])
    xyz = (np.column_stack([GRID, np.zeros(len(GRID))]) - middle) @ turn.T + [0, 0, distance]
    return camera, camera.project(xyz)


@pytest.mark.parametrize("dist", [None, DIST], ids=["no-lens", "lens"])
@pytest.mark.parametrize("angles", [(0, 0, 0), (25, 0, 10), (-15, 30, 200)], ids=str)
def test_positions_and_tilt_are_exact(angles, dist):
    turn = rotation(*angles)
    camera, pixels = seen(turn, dist=dist)
    plane = vision.PlanarTarget.from_points(
        pixels, GRID, "mm", camera=camera if dist else None, frame_shape=SHAPE
    )
    assert plane.rms < 1e-9
    assert plane.to_physical(pixels) == pytest.approx(GRID, abs=1e-9)
    assert plane.to_pixels(GRID) == pytest.approx(pixels, abs=1e-9)
    # The arc cosine loses half of the digits near zero.
    assert plane.tilt == pytest.approx(np.degrees(np.arccos(turn[2, 2])), abs=1e-5)
    assert (plane.units, plane.n_points) == ("mm", 30)


def test_scale_of_a_plane_that_faces_the_camera():
    _, pixels = seen(np.eye(3))
    plane = vision.PlanarTarget.from_points(pixels, GRID, "mm", frame_shape=SHAPE)
    assert plane.scale == pytest.approx(600.0 / 900.0, rel=1e-9)
    assert not plane.y_up
    up = vision.PlanarTarget.from_points(pixels, GRID * [1, -1], "mm")
    assert up.y_up


def test_a_lens_that_is_not_taken_out_shows():
    _, pixels = seen(np.eye(3), dist=DIST)
    assert vision.PlanarTarget.from_points(pixels, GRID).rms > 0.1


def test_sigma_of_the_map_is_that_of_many_calibrations():
    turn = rotation(25, 10, 5)
    _, pixels = seen(turn)
    # Few points, so that it shows how many of them the fit uses up.
    few = [0, 2, 5, 12, 14, 17, 24, 26, 29]
    rng = np.random.default_rng(5)
    probe = np.array([[150.0, 120.0], [320.0, 240.0], [430.0, 300.0]])
    found, told = [], []
    for _ in range(400):
        noisy = pixels[few] + 0.2 * rng.standard_normal((9, 2))
        plane = vision.PlanarTarget.from_points(noisy, GRID[few])
        found.append(plane.to_physical(probe))
        told.append(plane.calibration_sigma(probe))
    spread = np.std(found, axis=0)
    assert np.sqrt(np.mean(np.square(told), axis=0)) == pytest.approx(spread, rel=0.12)


def test_four_points_fit_exactly_and_say_so():
    _, pixels = seen(rotation(20, 0, 0))
    corners = [0, 5, 29, 24]
    plane = vision.PlanarTarget.from_points(pixels[corners], GRID[corners])
    assert plane.to_physical(pixels) == pytest.approx(GRID, abs=1e-8)
    assert plane.rms is None
    assert np.isnan(plane.calibration_sigma(pixels)).all()
    assert "four points fit exactly" in plane.notes[0]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([0, 1, 6], "there are 3 pairs"),
        ([0, 1, 2, 3, 4], "on a line"),
        ([0, 1, 2, 3, 4, 10], "on a line in the plane, or all but one do"),
        ([0, 0, 5, 29], "on a line"),
    ],
    ids=["three", "line", "all-but-one", "twice"],
)
def test_points_that_make_no_plane(rows, words):
    _, pixels = seen(rotation(20, 0, 0))
    with pytest.raises(CalibrationError, match=words):
        vision.PlanarTarget.from_points(pixels[rows], GRID[rows])


def test_points_in_another_order():
    _, pixels = seen(rotation(20, 0, 0))
    with pytest.raises(CalibrationError, match="same order"):
        vision.PlanarTarget.from_points(pixels[[0, 29, 5, 24]], GRID[[0, 5, 29, 24]])


def test_unequal_numbers_and_missing_values():
    _, pixels = seen(np.eye(3))
    with pytest.raises(CalibrationError, match="as many rows"):
        vision.PlanarTarget.from_points(pixels[:-1], GRID)
    pixels[3] = np.nan
    with pytest.raises(CalibrationError, match="not finite"):
        vision.PlanarTarget.from_points(pixels, GRID)


def test_beyond_the_horizon():
    """A plane at 80 degrees whose horizon crosses the image."""
    _, pixels = seen(rotation(80, 0, 0))
    plane = vision.PlanarTarget.from_points(pixels, GRID)
    # Its far side is where depth grows: follow the line of sight until nothing is seen.
    rows = np.linspace(-3000.0, 3000.0, 200)
    column = np.column_stack([np.full(200, 319.5), rows])
    with pytest.raises(CalibrationError, match="beyond its horizon"):
        plane.to_physical(column)


def test_a_camera_of_another_size():
    camera, pixels = seen(np.eye(3), dist=DIST)
    with pytest.raises(CalibrationError, match="made for images of 640x480"):
        vision.PlanarTarget.from_points(pixels, GRID, camera=camera, frame_shape=(480, 480))


def test_a_matrix_without_inverse():
    with pytest.raises(CalibrationError, match="that has an inverse"):
        vision.PlanarTarget(homography=np.ones((3, 3)))


# --- the file of points -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "separator", [",", ";", "\t", " "], ids=["comma", "semicolon", "tab", "blank"]
)
def test_pairs(tmp_path, separator):
    path = tmp_path / "pairs.csv"
    lines = ["u,v,X,Y", "# corners", "1.5,2,0,0", "", "11.5,2,10,0"]
    path.write_text("\n".join(line.replace(",", separator) for line in lines))
    pixels, plane = read_pairs(path)
    assert pixels.tolist() == [[1.5, 2.0], [11.5, 2.0]]
    assert plane.tolist() == [[0.0, 0.0], [10.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2,3\n", "line 1 is '1,2,3'"),
        ("1,2,3,4\n1,2,x,4\n", "line 2"),
        ("1,2,3,nan\n", "four finite numbers"),
        ("u,v,X,Y\n", "no line of four numbers"),
    ],
    ids=["three", "word", "nan", "empty"],
)
def test_files_without_pairs(tmp_path, text, words):
    path = tmp_path / "pairs.csv"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=words):
        read_pairs(path)
