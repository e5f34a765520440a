"""Boards in rendered pictures: corners to hundredths of a pixel, cameras within their sigma."""

from __future__ import annotations

import numpy as np
import pytest
from rendered_boards import Rays, charuco, chessboard, circles, facing, poses, render, rotation

import openprc.vision as vision
from openprc.errors import CalibrationError, UnreadableFile
from openprc.vision.calibration.board_images import pictures, read_image
from openprc.vision.calibration.boards import BoardView, Charuco, Chessboard, CircleGrid
from openprc.vision.calibration.camera_fit import calibrate_camera, fit_camera, fit_views
from openprc.vision.opencv import load_cv2

SHAPE = (360, 480)
K = np.array([[520.0, 0.0, 241.3], [0.0, 515.0, 177.2], [0.0, 0.0, 1.0]])
DIST = [-0.25, 0.12, 0.001, -0.0015]
CAMERA = vision.CameraCalibration.from_matrix(K, DIST, frame_shape=SHAPE)
CHESSBOARD = Chessboard(8, 5, 20.0, "mm")
CHARUCO = Charuco(9, 6, 20.0, "mm", marker=14.0, dictionary="DICT_4X4_50")


@pytest.fixture(scope="module")
def rays():
    return Rays(CAMERA)


@pytest.fixture(scope="module")
def views(rays):
    """Eight pictures of a chessboard with noise of two grey levels."""
    rng = np.random.default_rng(0)
    images = []
    for turn, shift in list(poses(CHESSBOARD, 330.0))[:8]:
        clean = render(rays, chessboard(CHESSBOARD), turn, shift, samples=2)
        noisy = clean + 2.0 * rng.standard_normal(clean.shape)
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return images


def rms(view, turn, shift):
    error = view.pixels - CAMERA.project(view.points @ turn.T + shift)
    return np.sqrt(np.mean(np.sum(error**2, axis=1)))


# --- finding boards ---------------------------------------------------------------------------


def test_corners_of_a_chessboard(views):
    for image, (turn, shift) in zip(views, poses(CHESSBOARD, 330.0), strict=False):
        view = CHESSBOARD.find(image)
        assert len(view.ids) == 40
        # OpenCV's cornerSubPix is off by 0.04 to 0.06 px in these pictures.
        assert rms(view, turn, shift) < 0.02


@pytest.mark.parametrize(("z", "seen_as"), [(180, 0), (90, 90), (-100, 80)])
def test_a_chessboard_is_numbered_with_x_to_the_right(rays, z, seen_as):
    """Turned by more than a right angle it is the same board, upside down."""
    turn, shift = facing(420.0, z=z, centre=(70, 40))
    view = CHESSBOARD.find(render(rays, chessboard(CHESSBOARD), turn, shift, samples=2))
    along = view.pixels[7] - view.pixels[0]
    if seen_as != 90:
        assert along[0] > 0.0
    assert abs(
        along @ [np.cos(np.radians(seen_as)), np.sin(np.radians(seen_as))]
    ) > 0.99 * np.hypot(*along)
    down = view.pixels[8] - view.pixels[0]
    assert along[0] * down[1] - along[1] * down[0] > 0.0


@pytest.mark.parametrize("z", [0, 90, 180, 270])
def test_a_square_chessboard_always_begins_at_the_upper_left(rays, z):
    board = Chessboard(5, 5, 20.0)
    turn, shift = facing(330.0, z=z, centre=(40, 40))
    view = board.find(render(rays, chessboard(board), turn, shift, samples=2))
    first, right, below = view.pixels[[0, 4, 20]]
    assert right[0] - first[0] > 50
    assert below[1] - first[1] > 50


def test_corners_of_a_charuco_board_in_part(rays):
    turn, shift = facing(330.0, x=20, y=-15, centre=(90, 60), at=(130.0, 20.0))
    view = CHARUCO.find(render(rays, charuco(CHARUCO), turn, shift, samples=2))
    assert 10 <= len(view.ids) < 40
    assert (np.diff(view.ids) > 0).all()
    assert rms(view, turn, shift) < 0.06


def test_circles(rays):
    board = CircleGrid(8, 5, 20.0)
    turn, shift = facing(330.0, centre=(70, 40))
    view = board.find(render(rays, circles(board), turn, shift, samples=3))
    assert rms(view, turn, shift) < 0.05


@pytest.mark.parametrize(
    "board", [CHESSBOARD, CHARUCO, CircleGrid(8, 5, 20.0)], ids=["chess", "charuco", "circles"]
)
@pytest.mark.parametrize("shape", [(5, 5), (360, 480)], ids=["tiny", "blank"])
def test_a_board_that_is_not_there(board, shape):
    with pytest.raises(CalibrationError, match=r"found[\s\S]*check the counts"):
        board.find(np.full(shape, 128, np.uint8))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Chessboard(1, 6, 20.0), "1 columns"),
        (lambda: Chessboard(9, 2.5, 20.0), "2.5 rows"),
        (lambda: Chessboard(9, 6, -1.0), "above 0"),
        (lambda: Chessboard(9, 6, 20.0, "s"), "unit of time"),
        (lambda: Charuco(9, 6, 20.0, marker=25.0), "smaller than the squares"),
        (lambda: Charuco(9, 6, 20.0, marker=5.0, dictionary="abc"), "'abc'"),
        (lambda: Charuco(9, 6, 20.0, marker=5.0, dictionary="DICT_9").as_opencv(), "DICT_4X4_50"),
    ],
    ids=["columns", "rows", "square", "unit", "marker", "dictionary", "unknown"],
)
def test_boards_that_are_none(make, words):
    with pytest.raises(CalibrationError, match=words):
        make()


# --- cameras ----------------------------------------------------------------------------------


def test_a_camera_from_pictures(views):
    blank = np.full(SHAPE, 90, np.uint8)
    fit = fit_camera([*views, blank], CHESSBOARD, model="k1k2p1p2")
    camera = fit.camera
    assert [len(fit.views), len(fit.rejected)] == [8, 1]
    assert fit.rejected[0][0] == "image 8"
    assert "not found" in fit.rejected[0][1]
    assert camera.rms < 0.03
    values = camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    truth = K[[0, 1, 0, 1], [0, 1, 2, 2]]
    for name, value, true in zip(("fx", "fy", "cx", "cy"), values, truth, strict=True):
        assert camera.sigma[name] < 0.5
        # 4 sigma, and a little for what is no noise in the pictures.
        assert abs(value - true) < 4.0 * camera.sigma[name] + 0.05, name
    edge = np.array([[30.0, 30.0], [450.0, 330.0]])
    assert camera.to_normalized(edge) == pytest.approx(CAMERA.to_normalized(edge), abs=5e-4)
    tilts = [np.degrees(np.arccos(turn[2, 2])) for turn, _ in poses(CHESSBOARD, 330.0)]
    assert [view.tilt for view in fit.views] == pytest.approx(tilts[:8], abs=0.2)
    assert any("8 views were used" in note for note in camera.notes)
    assert fit.as_dict()["views"][0]["points"] == 40


def throws(count, sigma, *, views=10, seed=0, noise_free=False):
    """Cameras fitted to exact corners with Gaussian errors."""
    rng = np.random.default_rng(seed)
    board = CHESSBOARD
    for _ in range(count):
        seen = []
        for i, (turn, shift) in enumerate(list(poses(board, 330.0))[:views]):
            pixels = CAMERA.project(board.points @ turn.T + shift)
            pixels = pixels + (0.0 if noise_free else sigma) * rng.standard_normal(pixels.shape)
            seen.append((f"view {i}", BoardView(np.arange(40), board.points, pixels)))
        yield fit_views(seen, SHAPE, model="k1k2p1p2").camera


def test_sigma_of_a_camera_is_that_of_many_calibrations():
    cameras = list(throws(60, 0.1))
    found = np.array([camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]] for camera in cameras])
    told = np.array([[c.sigma[n] for n in ("fx", "fy", "cx", "cy")] for c in cameras])
    assert told.mean(axis=0) == pytest.approx(found.std(axis=0), rel=0.3)
    assert np.abs(found.mean(axis=0) - K[[0, 1, 0, 1], [0, 1, 2, 2]]).max() < 0.2
    assert np.mean([c.rms for c in cameras]) == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_exact_corners_give_the_camera():
    (camera,) = throws(1, 0.0, noise_free=True)
    assert camera.matrix == pytest.approx(K, abs=2e-3)
    assert camera.dist == pytest.approx(DIST, abs=2e-5)


def tilted_by(tilt):
    """Views of boards that turn about the optical axis, each tilted the same way."""
    seen = []
    for i, at in enumerate(np.random.default_rng(1).uniform(-40, 40, (10, 2))):
        turn, shift = facing(330.0 + 10 * i, x=tilt * (i % 2), z=5.0 * i, centre=(70, 40), at=at)
        pixels = CAMERA.project(CHESSBOARD.points @ turn.T + shift)
        pixels = pixels + 0.05 * np.random.default_rng(i).standard_normal(pixels.shape)
        seen.append((str(i), BoardView(np.arange(40), CHESSBOARD.points, pixels)))
    return seen


@pytest.mark.parametrize("model", ["none", "k1", "k1k2p1p2k3"])
def test_parallel_boards_are_refused(model):
    with pytest.raises(CalibrationError, match="do not determine the focal length"):
        fit_views(tilted_by(0.0), SHAPE, model=model)


def test_nearly_parallel_boards_are_told():
    camera = fit_views(tilted_by(10.0), SHAPE, model="k1k2p1p2").camera
    told = " ".join(camera.notes)
    assert "parallel within 1" in told
    assert "hard to tell apart" in told
    assert abs(camera.matrix[0, 0] - 520.0) < 4.0 * camera.sigma["fx"]


def test_too_few_views(views):
    with pytest.raises(
        CalibrationError, match=r"found in 2 of 3 pictures \(image 2:[\s\S]*at least 3"
    ):
        calibrate_camera([*views[:2], np.zeros(SHAPE, np.uint8)], CHESSBOARD)


def test_pictures_of_two_sizes(views):
    with pytest.raises(CalibrationError, match="image 1 has 200x100 pixels"):
        calibrate_camera([views[0], np.zeros((100, 200), np.uint8)], CHESSBOARD)


def test_no_pictures_and_no_model(tmp_path):
    with pytest.raises(CalibrationError, match="no pictures"):
        calibrate_camera(tmp_path, CHESSBOARD)
    with pytest.raises(CalibrationError, match="no distortion model 'k9'"):
        fit_views([], SHAPE, model="k9")


def test_a_plane_from_a_board(rays):
    turn, shift = facing(330.0, x=25, centre=(70, 40))
    image = render(rays, chessboard(CHESSBOARD), turn, shift, samples=2)
    plane = vision.PlanarTarget.from_board(image, CHESSBOARD, camera=CAMERA)
    assert plane.tilt == pytest.approx(25.0, abs=0.1)
    assert plane.rms < 0.02
    probe = np.array([[35.0, 61.0, 0.0], [120.0, 13.0, 0.0]])
    pixels = CAMERA.project(probe @ turn.T + shift)
    assert plane.to_physical(pixels) == pytest.approx(probe[:, :2], abs=0.02)
    up = vision.PlanarTarget.from_board(image, CHESSBOARD, camera=CAMERA, y_up=True)
    assert up.to_physical(pixels) == pytest.approx(probe[:, :2] * [1, -1], abs=0.02)
    assert up.y_up


# --- pictures ---------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [0, 1, 3])
def test_kinds_of_pictures(dtype, channels):
    ramp = np.tile(np.linspace(0, 255, 64).round(), (32, 1))
    image = (ramp * (257 if dtype == np.uint16 else 1)).astype(dtype)
    if channels:
        image = np.repeat(image[..., None], channels, axis=2)
    found = read_image(image)
    assert found.dtype == np.uint8
    assert np.abs(found.astype(float) - ramp).max() <= 1.0


def test_files_and_folders(tmp_path):
    cv2 = load_cv2()
    image = np.arange(600, dtype=np.uint8).reshape(20, 30)
    for name in ("b.png", "a ü.png"):
        cv2.imencode(".png", image)[1].tofile(tmp_path / name)
    (tmp_path / "notes.txt").write_text("x")
    assert [name for name, _ in pictures(tmp_path)] == ["a ü.png", "b.png"]
    assert np.array_equal(next(pictures([tmp_path / "a ü.png"]))[1], image)
    assert np.array_equal(next(pictures(image))[1], image)
    with pytest.raises(UnreadableFile, match="no picture"):
        read_image(tmp_path / "notes.txt")
    with pytest.raises(UnreadableFile, match="no such file"):
        read_image(tmp_path / "none.png")


@pytest.mark.parametrize(
    "image", [np.zeros(5), np.zeros((0, 4)), np.zeros((2, 3, 7))], ids=["1d", "empty", "7ch"]
)
def test_arrays_that_are_no_pictures(image):
    with pytest.raises(CalibrationError, match="array of float64"):
        read_image(image)


def test_a_picture_with_nan():
    with pytest.raises(CalibrationError, match="not finite"):
        read_image(np.full((4, 4), np.nan))


def test_rotations_of_the_renderer():
    assert rotation(90, 0, 0) @ [0, 1, 0] == pytest.approx([0, 0, 1])
    assert rotation(0, 90, 0) @ [0, 0, 1] == pytest.approx([1, 0, 0])
    assert rotation(0, 0, 90) @ [1, 0, 0] == pytest.approx([0, 1, 0])
