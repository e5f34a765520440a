"""Two cameras: exact positions, their one-sigma, messages and files."""

from __future__ import annotations

import numpy as np
import pytest
from rendered_boards import VIEWS, Rays, chessboard, poses, render, rotation
from stereo_rigs import converging

import openprc.vision as vision
from openprc.errors import CalibrationError
from openprc.vision.calibration.boards import Chessboard
from openprc.vision.calibration.calibration_file import load_calibration, save_calibration
from openprc.vision.calibration.stereo_fit import fit_stereo

DIST = [-0.2, 0.08, 0.0005, -0.001]
BOARD = Chessboard(8, 5, 20.0, "mm")


def cloud(n=500, seed=0):
    return np.random.default_rng(seed).uniform([-60, -60, 570], [60, 60, 630], (n, 3))


@pytest.mark.parametrize("dist", [None, DIST, [*DIST, 0.01, 0.02, -0.01, 0.003]])
def test_exact_positions(dist):
    rig = converging(25.0, dist=dist)
    points = cloud()
    left, right = rig.to_pixels(points)
    assert np.abs(rig.locate(left, right) - points).max() < 1e-9
    assert rig.triangulate_points(left, right).error.max() < 1e-9
    assert rig.angle == pytest.approx(25.0)
    assert rig.baseline == pytest.approx(2 * 600 * np.sin(np.radians(12.5)))


@pytest.mark.parametrize(
    ("angle", "in_plane", "out_of_plane"),
    [(15.0, 16.0, 110.0), (30.0, 15.0, 55.0), (45.0, 15.0, 37.0)],
)
def test_noise_of_a_twentieth_of_a_pixel(angle, in_plane, out_of_plane):
    """f = 1500 px at 600 mm: one pixel is 0.4 mm, and depth costs 1 / tan(angle / 2) more [um]."""
    rig = converging(angle)
    points = np.tile([0.0, 0.0, 600.0], (20_000, 1)) + 0.2 * cloud(20_000) * [1, 1, 0]
    rng = np.random.default_rng(1)
    pixels = [seen + 0.05 * rng.standard_normal(seen.shape) for seen in rig.to_pixels(points)]
    sigma = np.full(pixels[0].shape, 0.05)
    found = rig.triangulate_points(*pixels, sigma_left=sigma, sigma_right=sigma)
    # Axes half-way between the two cameras.
    middle = rotation(y=angle / 2)
    error = 1e3 * ((found.points - points) @ middle.T).std(axis=0)
    assert error[:2] == pytest.approx(in_plane, rel=0.2)
    assert error[2] == pytest.approx(out_of_plane, rel=0.2)
    assert error[2] / error[0] == pytest.approx(1 / np.tan(np.radians(angle / 2)), rel=0.05)
    told = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert ((found.points - points) / told).std(axis=0) == pytest.approx(1.0, rel=0.03)
    # Four coordinates, three of which the point takes up.
    assert np.sqrt(np.mean(found.error**2)) == pytest.approx(0.025, rel=0.03)


def test_a_better_camera_counts_for_more():
    rig = converging(30.0)
    points = np.tile([10.0, -5.0, 600.0], (4000, 1))
    rng = np.random.default_rng(2)
    spread = (np.full((4000, 2), 0.02), np.full((4000, 2), 0.5))
    pixels = [
        seen + s * rng.standard_normal(seen.shape)
        for seen, s in zip(rig.to_pixels(points), spread, strict=True)
    ]
    alike = rig.triangulate_points(*pixels).points
    weighed = rig.triangulate_points(*pixels, sigma_left=spread[0], sigma_right=spread[1])
    # Up and down both cameras tell the same: the better one decides.
    assert weighed.points[:, 1].std() < 0.2 * alike[:, 1].std()
    told = np.sqrt(np.diagonal(weighed.covariance, axis1=1, axis2=2)).mean(axis=0)
    assert weighed.points.std(axis=0) == pytest.approx(told, rel=0.05)


def test_what_a_camera_does_not_see_is_missing():
    rig = converging(25.0)
    left, right = rig.to_pixels(cloud(4))
    right[1] = np.nan
    left[2, 0] = np.nan
    found = rig.triangulate_points(left, right)
    assert np.isnan(found.points[[1, 2]]).all()
    assert np.isfinite(found.points[[0, 3]]).all()
    assert np.isnan(found.covariance).all()


def test_rays_that_part_are_no_point():
    rig = converging(25.0)
    left, right = rig.to_pixels([[0.0, 0.0, 600.0]])
    # The right camera looks away: the two lines of sight meet behind the cameras.
    assert np.isnan(rig.locate(left, right + np.array([900.0, 0.0]))).all()


def test_world_frame():
    turn = rotation(20, -10, 5)
    rig = converging(25.0, world_rotation=turn, world_translation=[1.0, 2.0, 3.0])
    points = cloud(10)
    plain = converging(25.0)
    pixels = plain.to_pixels(points)
    assert rig.locate(*pixels) == pytest.approx(points @ turn.T + [1, 2, 3], abs=1e-9)
    assert np.allclose(rig.to_pixels(rig.locate(*pixels)), pixels)
    sigma = np.full(pixels[0].shape, 0.05)
    told = [
        r.triangulate_points(*pixels, sigma_left=sigma, sigma_right=sigma) for r in (rig, plain)
    ]
    assert told[0].covariance == pytest.approx(turn @ told[1].covariance @ turn.T, abs=1e-12)


def test_file(tmp_path):
    rig = converging(25.0, dist=DIST, rms=0.1, notes=("a note",), units="cm")
    again = load_calibration(save_calibration(tmp_path / "rig.json", rig))
    assert again.as_dict() == rig.as_dict()
    left, right = rig.to_pixels(cloud())
    assert np.array_equal(again.locate(left, right), rig.locate(left, right))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rotation": np.eye(2)}, r"shape \(2, 2\)"),
        ({"rotation": 2 * np.eye(3)}, "not orthogonal"),
        ({"rotation": np.diag([1, 1, -1])}, "reflection"),
        ({"translation": [0.0, 0.0, 0.0]}, "same place"),
        ({"translation": [1.0, 2.0]}, "2 numbers"),
        ({"translation": [1.0, np.nan, 0.0]}, "translation is nan"),
    ],
    ids=["shape", "scaled", "mirrored", "zero", "two", "nan"],
)
def test_no_rig(change, words):
    rig = converging(25.0)
    values = {"rotation": rig.rotation, "translation": rig.translation, **change}
    with pytest.raises(CalibrationError, match=words):
        vision.StereoRig(rig.left, rig.right, **values)


def test_unequal_numbers_of_points():
    rig = converging(25.0)
    left, right = rig.to_pixels(cloud(5))
    with pytest.raises(CalibrationError, match="left camera has 5 points, the right one 4"):
        rig.triangulate_points(left, right[:4])


# --- from pictures ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pairs():
    """A rig, and pairs of pictures of a board."""
    rig = converging(25.0, f=620.0, shape=(360, 480), distance=420.0, dist=DIST)
    rays, pattern = Rays(rig.left), chessboard(BOARD)
    nearer = [dict(view, at=(0.4 * view["at"][0], 0.8 * view["at"][1])) for view in VIEWS[:5]]
    left, right = [], []
    for turn, shift in poses(BOARD, 420.0, nearer):
        left.append(render(rays, pattern, turn, shift, samples=2))
        there = rig.rotation @ turn, rig.rotation @ shift + rig.translation
        right.append(render(rays, pattern, *there, samples=2))
    return rig, left, right


def test_a_rig_from_pictures(pairs):
    rig, left, right = pairs
    fit = fit_stereo(left, right, BOARD, left=rig.left, right=rig.right)
    assert fit.rig.rms < 0.03
    assert fit.board_rms < 0.02
    assert fit.rig.rotation == pytest.approx(rig.rotation, abs=2e-4)
    assert fit.rig.translation == pytest.approx(rig.translation, abs=0.05)
    points = cloud(50) * [0.5, 0.5, 0.7]
    assert fit.rig.locate(*rig.to_pixels(points)) == pytest.approx(points, abs=0.05)
    assert len(fit.as_dict()["pairs"]) == 5


def test_a_rig_with_both_cameras_from_pictures(pairs):
    rig, left, right = pairs
    blank = np.full((360, 480), 128, np.uint8)
    fit = fit_stereo([*left, left[0]], [*right, blank], BOARD, model="k1k2p1p2")
    assert len(fit.cameras) == 2
    assert len(fit.pairs) == 5
    assert fit.rejected[0][0] == "image 5"
    assert fit.rig.baseline == pytest.approx(rig.baseline, rel=2e-3)
    assert fit.rig.angle == pytest.approx(25.0, abs=0.1)
    assert fit.board_rms < 0.05
    assert any(note.startswith("left: ") for note in fit.rig.notes)


def test_the_frame_of_a_board(pairs):
    rig, left, right = pairs
    placed = rig.in_board_frame(left[0], BOARD)
    seen = [BOARD.find(picture).pixels for picture in (left[0], right[0])]
    assert placed.locate(*seen) == pytest.approx(BOARD.points, abs=0.05)
    up = rig.in_board_frame(left[0], BOARD, y_up=True)
    assert up.locate(*seen) == pytest.approx(BOARD.points * [1, -1, -1], abs=0.05)
    assert (placed.frame, up.frame) == ("board", "board, y up")
    with pytest.raises(CalibrationError, match="in cm, the rig in mm"):
        rig.in_board_frame(left[0], Chessboard(8, 5, 2.0, "cm"))


def test_pairs_that_are_none(pairs):
    rig, left, right = pairs
    with pytest.raises(CalibrationError, match="3 left and 2 right pictures"):
        fit_stereo(left[:3], right[:2], BOARD)
    blank = [np.full((360, 480), 128, np.uint8)] * 3
    with pytest.raises(CalibrationError, match="board in 0 of 3 pairs"):
        fit_stereo(left[:3], blank, BOARD, left=rig.left, right=rig.right)
    other = converging(25.0).left
    with pytest.raises(CalibrationError, match="left camera: the calibration was made for"):
        fit_stereo(left[:3], right[:3], BOARD, left=other, right=rig.right)
