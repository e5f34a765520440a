"""Fractions of the image, scale bars, cameras: closed forms, frames of another size, messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stereo_rigs import recording

import openprc.vision as vision
from openprc.errors import CalibrationError, UnitError
from openprc.vision.calibration.calibration_file import calibration_from_dict
from openprc.vision.calibration.planar import PlanarTarget

K = np.array([[1500.0, 0.0, 960.0], [0.0, 1480.0, 540.0], [0.0, 0.0, 1.0]])
DIST = [-0.31, 0.12, 0.0008, -0.0011, -0.02]


def camera(**options):
    options = {"scale_factor": 25.0, "physical_units": "mm", **options}
    return vision.CameraCalibration.from_matrix(K, frame_shape=(1080, 1920), **options)


def plane():
    corners = np.array([[300.0, 200.0], [1500.0, 260.0], [1400.0, 900.0], [250.0, 800.0]])
    there = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]])
    lens = camera(dist=DIST)
    return PlanarTarget.from_points(corners, there, "mm", camera=lens)


CALIBRATIONS = {
    "normalized": lambda: vision.NormalizedCalibration((1080, 1920)),
    "isotropic-up": lambda: vision.NormalizedCalibration((1080, 1920), isotropic=True, y_up=True),
    "scale-bar": lambda: vision.ScaleBar(
        (10.0, 20.0), (310.0, 420.0), 100.0, "mm", origin=(50.0, 60.0), y_up=True
    ),
    "camera": camera,
    "camera-distorted-up": lambda: camera(dist=DIST, y_up=True),
    "plane": plane,
}


@pytest.fixture(params=CALIBRATIONS)
def calibration(request):
    return CALIBRATIONS[request.param]()


# --- what all have in common ------------------------------------------------------------------


def test_there_and_back(calibration):
    pixels = np.random.default_rng(0).uniform([100, 100], [1800, 980], (7, 40, 2))
    pixels[2, 3] = np.nan
    there = calibration.to_physical(pixels)
    assert there.shape == pixels.shape
    back = calibration.to_pixels(there)
    known = ~np.isnan(pixels)
    assert np.abs(back - pixels)[known].max() < 1e-9
    assert np.array_equal(np.isnan(there), np.isnan(pixels))


def test_the_points_given_are_left_alone(calibration):
    pixels = np.array([[500.0, 400.0]])
    calibration.to_physical(pixels)
    calibration.to_pixels(pixels * 0.0 + 0.1)
    assert pixels.tolist() == [[500.0, 400.0]]


def test_jacobian_is_the_derivative(calibration):
    pixels = np.random.default_rng(1).uniform([200, 200], [1700, 900], (30, 2))
    step = 1e-3
    measured = np.stack(
        [
            (calibration.to_physical(pixels + e) - calibration.to_physical(pixels - e)) / (2 * step)
            for e in step * np.eye(2)
        ],
        axis=-1,
    )
    assert calibration.jacobian(pixels) == pytest.approx(measured, rel=1e-6, abs=1e-9)


def test_sigma_is_that_of_many_throws(calibration):
    rng = np.random.default_rng(2)
    pixel, sigma = np.array([1300.0, 700.0]), np.array([0.3, 0.1])
    thrown = calibration.to_physical(pixel + sigma * rng.standard_normal((40_000, 2)))
    told = calibration.sigma_to_physical(pixel, sigma)
    assert told == pytest.approx(thrown.std(axis=0), rel=0.02)


def test_files_keep_everything(calibration):
    again = calibration_from_dict(calibration.as_dict())
    assert again == calibration
    assert hash(again) == hash(calibration)
    pixels = np.random.default_rng(3).uniform([200, 200], [1700, 900], (30, 2))
    assert np.abs(again.to_physical(pixels) - calibration.to_physical(pixels)).max() < 1e-12
    assert again.axes == "x,y"


def test_y_up_is_as_said(calibration):
    down = calibration.to_physical([900.0, 600.0]) - calibration.to_physical([900.0, 500.0])
    assert (down[1] < 0.0) == calibration.y_up


def test_turned_up(calibration):
    up = calibration.turned_up()
    pixels = np.array([[500.0, 400.0], [900.0, 800.0]])
    assert up.y_up
    before, after = (np.diff(c.to_physical(pixels), axis=0)[0] for c in (calibration, up))
    assert np.abs(after) == pytest.approx(np.abs(before), abs=1e-9)
    assert after[1] < 0.0 < after[0]
    assert up.to_pixels(up.to_physical(pixels)) == pytest.approx(pixels, abs=1e-9)
    sigma = np.full(pixels.shape, 0.1)
    assert up.sigma_to_physical(pixels, sigma) == pytest.approx(
        calibration.sigma_to_physical(pixels, sigma), abs=1e-12
    )


def test_points_of_another_shape(calibration):
    with pytest.raises(CalibrationError, match=r"shape \(5, 3\)[\s\S]*\(\.\.\., 2\)"):
        calibration.to_physical(np.zeros((5, 3)))


# --- fractions of the image -------------------------------------------------------------------


def test_unit_square():
    unit = vision.NormalizedCalibration((480, 640))
    assert unit.to_physical([640.0, 480.0]).tolist() == [1.0, 1.0]
    assert unit.units == "1"
    assert "distances" in unit.notes[0]
    up = vision.NormalizedCalibration((480, 640), y_up=True)
    assert up.to_physical([[0.0, 480.0], [640.0, 0.0]]).tolist() == [[0.0, 0.0], [1.0, 1.0]]
    even = vision.NormalizedCalibration((480, 640), isotropic=True)
    assert even.to_physical([640.0, 480.0]).tolist() == [1.0, 0.75]
    assert even.notes == ()
    assert vision.NormalizedCalibration((300, 300)).notes == ()


def test_auto_calibration_takes_whatever_has_a_size():
    image = np.zeros((480, 640, 3))
    assert vision.auto_calibration(image) == vision.NormalizedCalibration((480, 640))
    assert vision.auto_calibration((480, 640), isotropic=True).isotropic


@pytest.mark.parametrize("shape", [(480,), (0, 640), "640x480", None, (480, -1)])
def test_no_size_of_an_image(shape):
    with pytest.raises(CalibrationError, match=r"\(height, width\) in pixels"):
        vision.NormalizedCalibration(shape)


# --- scale bar --------------------------------------------------------------------------------


def test_scale_bar():
    bar = vision.ScaleBar((100.0, 100.0), (400.0, 500.0), 100.0, "mm")
    assert bar.length_px == 500.0
    assert bar.scale == 0.2
    moved = np.subtract(*bar.to_physical([[400.0, 500.0], [100.0, 100.0]]))
    assert np.hypot(*moved) == pytest.approx(100.0, rel=1e-15)


def test_scale_bar_origin_and_up():
    bar = vision.ScaleBar((0, 0), (200, 0), 20.0, "cm", origin=(50, 400), y_up=True)
    assert bar.to_physical([50.0, 400.0]).tolist() == [0.0, 0.0]
    assert bar.to_physical([150.0, 300.0]) == pytest.approx([10.0, 10.0])
    assert bar.units == "cm"


def test_scale_bar_sigma_is_that_of_many_bars():
    rng = np.random.default_rng(4)
    ends = np.array([[10.0, 20.0], [90.0, 80.0]]) + rng.normal(0.0, 0.7, (20_000, 2, 2))
    lengths = rng.normal(50.0, 0.3, 20_000)
    scales = lengths / np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    bar = vision.ScaleBar((10, 20), (90, 80), 50.0, "mm", sigma_px=0.7, sigma_length=0.3)
    assert bar.relative_sigma == pytest.approx(scales.std() / scales.mean(), rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"p1": (10.2, 20.0)}, "0.2 px apart"),
        ({"length": 0.0}, "above 0"),
        ({"length": np.nan}, "finite number"),
        ({"p0": (np.inf, 0.0)}, "p0 is inf"),
        ({"sigma_px": -1.0}, "one-sigma of 0 or more"),
        ({"units": "kg"}, "unit of mass"),
    ],
)
def test_no_scale_bar(change, words):
    options = {"p0": (10.0, 20.0), "p1": (90.0, 20.0), "length": 5.0, "units": "mm", **change}
    with pytest.raises(CalibrationError, match=words):
        vision.ScaleBar(**options)


def test_unknown_unit():
    with pytest.raises(UnitError, match="furlong"):
        vision.ScaleBar((0, 0), (9, 0), 1.0, "furlong")


# --- camera -----------------------------------------------------------------------------------


def test_as_printed():
    cal = vision.CameraCalibration.from_matrix(
        K, frame_shape=(1080, 1920), scale_factor=25.0, physical_units="mm"
    )
    assert cal.to_physical([960.0 + 150.0, 540.0 + 74.0]) == pytest.approx([2.5, 1.25], rel=1e-14)
    assert cal.units == "mm"
    assert cal.notes == ()


def test_scale_factor_is_the_distance():
    """A point at 600 mm, 30 mm off the axis, through a lens that distorts."""
    cal = camera(dist=DIST, scale_factor=600.0)
    seen = cal.project([30.0, -20.0, 600.0])
    assert cal.to_physical(seen) == pytest.approx([30.0, -20.0], abs=1e-9)


def test_without_a_scale():
    assert camera(scale_factor=None, physical_units=None).units == "1"
    told = camera(scale_factor=None, physical_units="mm")
    assert "1 mm in front" in told.notes[0]


def test_from_intrinsics():
    cal = vision.CameraCalibration.from_intrinsics(
        1500.0, 1480.0, 960.0, 540.0, dist=DIST, frame_shape=(1080, 1920), scale_factor=25.0
    )
    assert cal == camera(dist=DIST)


def test_skewed_pixels():
    skewed = K.copy()
    skewed[0, 1] = 12.0
    cal = vision.CameraCalibration.from_matrix(skewed, frame_shape=(1080, 1920))
    seen = skewed @ [0.1, 0.2, 1.0]
    assert cal.to_physical(seen[:2]) == pytest.approx([0.1, 0.2], abs=1e-14)


def test_points_behind_the_camera_are_not_seen():
    assert np.isnan(camera().project([1.0, 1.0, -5.0])).all()


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.eye(2), r"shape \(2, 2\)"),
        (np.full((3, 3), np.nan), "not finite"),
        (K.T, "transpose it"),
        (-K, "no intrinsic matrix"),
        ("abc", "shape"),
    ],
    ids=["small", "nan", "transposed", "negative", "text"],
)
def test_no_matrix(matrix, words):
    with pytest.raises(CalibrationError, match=words):
        vision.CameraCalibration.from_matrix(matrix, frame_shape=(1080, 1920))


def test_doubtful_matrices_are_told():
    odd = vision.CameraCalibration.from_matrix(K, frame_shape=(540, 960))
    assert "far from the middle" in odd.notes[0]
    flat = K * [[1.0, 1.0, 1.0], [1.0, 0.7, 1.0], [1.0, 1.0, 1.0]]
    told = vision.CameraCalibration.from_matrix(flat, frame_shape=(1080, 1920)).notes
    assert "differ by more than 5 %" in told[0]


# --- recordings of another size ---------------------------------------------------------------


def test_the_same_size_is_left_alone():
    cal = camera(dist=DIST)
    check = cal.check_frame((1080, 1920))
    assert check.calibration is cal
    assert (check.notes, check.warning) == ((), None)


def test_another_resolution_is_rescaled():
    """Halving by averaging 2 x 2 pixels puts the place (u, v) at ((u + 1/2)/2 - 1/2, ...)."""
    for make in (lambda: camera(dist=DIST), plane):
        cal = make()
        check = cal.check_frame((540, 960))
        assert check.warning is None
        assert "rescaled to the recording's 960x540" in check.notes[0]
        pixels = np.array([[400.0, 300.0], [1200.0, 700.0]])
        small = (pixels + 0.5) / 2 - 0.5
        there = cal.to_physical(pixels)
        assert check.calibration.to_physical(small) == pytest.approx(there, abs=1e-9)
        assert check.calibration.frame_shape == (540, 960)


def test_a_scale_bar_is_rescaled_only_when_its_size_is_known():
    bar = vision.ScaleBar((10, 20), (210, 20), 40.0, "mm", frame_shape=(480, 640))
    check = bar.check_frame((960, 1280))
    assert check.calibration.scale == pytest.approx(0.1)
    unknown = vision.ScaleBar((10, 20), (210, 20), 40.0, "mm")
    assert unknown.check_frame((960, 1280)).calibration is unknown


def test_another_shape_is_told_loudly():
    cal = camera()
    check = cal.check_frame((480, 640))
    assert check.calibration is cal
    assert "made for images of 1920x1080, the recording has 640x480" in check.warning
    assert "will be wrong" in check.warning


def test_the_printed_call_warns_on_a_recording_of_another_shape():
    times = np.arange(3) / 30.0
    result = replace(recording(np.full((3, 2, 2), 320.0), times), frame_shape=(480, 640))
    with pytest.warns(UserWarning, match="positions will be wrong"):
        tset = vision.TrajectorySet.from_tracking_result(result, calibration=camera())
    assert tset.units == "mm"
    half = replace(result, frame_shape=(540, 960))
    tset = vision.TrajectorySet.from_tracking_result(half, calibration=camera())
    assert any("rescaled to the recording's 960x540" in note for note in tset.notes)
