"""Poses of flat facets and fold angles from one camera."""

from __future__ import annotations

import numpy as np
import pytest
from rendered_boards import rotation

import openprc.vision as vision
from openprc.errors import CalibrationError
from openprc.vision.calibration.facets import facet_pose, fold_angle

CAMERA = vision.CameraCalibration.from_matrix(
    [[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]],
    [-0.2, 0.08, 0.001, 0.0005],
    frame_shape=(480, 640),
)
FACET = np.array([[0.0, 0.0], [60.0, 0.0], [75.0, 40.0], [15.0, 40.0], [37.0, 20.0]])


def place(turn, shift):
    return CAMERA.project(np.column_stack([FACET, np.zeros(5)]) @ turn.T + shift)


@pytest.mark.parametrize("angles", [(10, 5, 0), (-40, 20, 30), (35, -35, 170)], ids=str)
def test_exact_pose(angles):
    turn, shift = rotation(*angles), np.array([-20.0, 10.0, 400.0])
    pose = facet_pose(place(turn, shift), FACET, CAMERA)
    assert pose.rotation == pytest.approx(turn, abs=1e-7)
    assert pose.translation == pytest.approx(shift, abs=1e-5)
    assert pose.rms < 1e-6
    assert pose.normal @ shift < 0.0


@pytest.mark.parametrize("fold", [0.0, 20.0, 75.0, 120.0])
def test_fold_angle(fold):
    """Two facets that share a crease along y, each turned by half of the fold."""
    shift = np.array([0.0, -20.0, 400.0])
    half = 0.5 * fold
    one = facet_pose(place(rotation(y=half), shift), FACET, CAMERA)
    other = facet_pose(place(rotation(y=-half), shift), FACET, CAMERA)
    assert fold_angle(one, other) == pytest.approx(fold, abs=1e-4)


def test_fold_angle_with_noise():
    rng = np.random.default_rng(0)
    shift = np.array([0.0, -20.0, 400.0])
    found = []
    for _ in range(40):
        poses = [
            facet_pose(
                place(rotation(y=a), shift) + 0.02 * rng.standard_normal((5, 2)), FACET, CAMERA
            )
            for a in (30.0, -30.0)
        ]
        found.append(fold_angle(*poses))
    assert np.mean(found) == pytest.approx(60.0, abs=0.2)
    assert np.std(found) < 0.5


def test_no_pose_from_a_line():
    pixels = place(np.eye(3), np.array([0.0, 0.0, 400.0]))
    with pytest.raises(CalibrationError, match="on a line"):
        facet_pose(pixels[:4] * [1, 0], FACET[:4], CAMERA)
