"""The lens: against OpenCV, its inverse, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import openprc.vision as vision
from openprc.errors import CalibrationError
from openprc.vision.calibration.distortion import (
    coefficients,
    distort,
    distortion_jacobian,
    undistort,
    valid_radius,
)
from openprc.vision.opencv import load_cv2

K = np.array([[800.0, 0.0, 319.0], [0.0, 790.0, 241.0], [0.0, 0.0, 1.0]])
ALL = [
    -0.3,
    0.1,
    0.001,
    -0.002,
    0.02,
    0.01,
    -0.02,
    0.003,
    0.001,
    0.002,
    -0.001,
    0.0015,
    0.03,
    -0.02,
]


@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_as_opencv(n):
    cv2 = load_cv2()
    dist = np.array(ALL[:n])
    camera = vision.CameraCalibration.from_matrix(K, dist, frame_shape=(480, 640))
    pixels = np.random.default_rng(n).uniform([0, 0], [640, 480], (2000, 2))
    ideal = camera.to_normalized(pixels)
    seen, _ = cv2.projectPoints(
        np.column_stack([ideal, np.ones(2000)]), np.zeros(3), np.zeros(3), K, dist
    )
    assert np.abs(seen.reshape(-1, 2) - pixels).max() < 1e-9
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-14)
    if hasattr(cv2, "undistortPointsIter"):
        back = cv2.undistortPointsIter(pixels[:, None], K, dist, None, None, criteria)
    else:
        back = cv2.undistortPoints(pixels[:, None], K, dist, criteria=criteria)
    assert np.abs(back.reshape(-1, 2) - ideal).max() < 1e-11


@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_jacobian_is_the_derivative(n):
    dist = coefficients(ALL[:n])
    xy = np.random.default_rng(n).uniform(-0.5, 0.5, (50, 2))
    step = 1e-6
    measured = np.stack(
        [(distort(xy + e, dist) - distort(xy - e, dist)) / (2 * step) for e in step * np.eye(2)],
        axis=-1,
    )
    assert distortion_jacobian(xy, dist) == pytest.approx(measured, abs=1e-8)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=2),
    st.lists(st.floats(-0.01, 0.01), min_size=2, max_size=2),
    st.floats(-0.2, 0.2),
)
def test_inverse_inside_the_valid_disc(radial, tangential, k3):
    """Well inside the disc everything comes back; nothing wrong is said to be solved."""
    dist = coefficients([*radial, *tangential, k3])
    reach = min(0.8 * valid_radius(dist), 1.0)
    angle = np.linspace(0.0, 2 * np.pi, 25)
    ring = reach * np.column_stack([np.cos(angle), np.sin(angle)])
    xy = np.concatenate([0.2 * ring, 0.6 * ring, ring])
    ideal, solved = undistort(distort(xy, dist), dist)
    assert np.abs(distort(ideal[solved], dist) - distort(xy, dist)[solved]).max() < 1e-11
    unfolded = np.linalg.det(distortion_jacobian(xy, dist)) > 0.05
    inner = np.hypot(*xy.T) < 0.7 * reach
    assert solved[inner & unfolded].all()
    assert np.abs(ideal - xy)[solved & inner & unfolded].max(initial=0.0) < 1e-9


def test_valid_radius_of_a_barrel():
    """r (1 + k1 r^2) turns back where 1 + 3 k1 r^2 = 0."""
    assert valid_radius(coefficients([-0.3, 0, 0, 0])) == pytest.approx(np.sqrt(1 / 0.9))
    assert valid_radius(coefficients([0.3, 0, 0, 0])) == np.inf
    assert valid_radius(coefficients(None)) == np.inf


def test_points_beyond_the_turning_point_are_refused():
    # The largest image radius of this barrel is 2/3 of the turning point's 1.054: 562 px.
    camera = vision.CameraCalibration.from_matrix(K, [-0.3, 0, 0, 0], frame_shape=(480, 640))
    with pytest.raises(CalibrationError, match=r"1 points lie where[\s\S]*\(1000\.0, 241\.0\) px"):
        camera.to_physical([[320.0, 240.0], [1000.0, 241.0]])
    ideal = camera.to_normalized([[320.0, 240.0], [1000.0, 241.0]], outside="nan")
    assert np.isnan(ideal[1]).all()
    assert np.isfinite(ideal[0]).all()


def test_missing_points_stay_missing():
    dist = coefficients(ALL[:5])
    ideal, solved = undistort([[0.1, 0.2], [np.nan, np.nan]], dist)
    assert np.isnan(ideal[1]).all()
    assert solved.all()


def test_no_points():
    ideal, solved = undistort(np.zeros((0, 2)), coefficients(ALL))
    assert ideal.shape == (0, 2)
    assert solved.shape == (0,)


@pytest.mark.parametrize("dist", [[0.1], [0.1] * 6, [0.1] * 13, [np.nan] * 5])
def test_no_coefficients(dist):
    with pytest.raises(CalibrationError, match="4, 5, 8, 12 or 14"):
        coefficients(dist)


def test_columns_of_opencv_are_taken():
    assert coefficients(np.zeros((5, 1))).shape == (5,)
