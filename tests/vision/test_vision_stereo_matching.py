"""Points of the left picture found in the right one."""

from __future__ import annotations

import numpy as np
import pytest
from rendered_boards import Rays, facing, render
from stereo_rigs import converging

import openprc.vision as vision
from openprc.errors import CalibrationError
from openprc.vision.calibration.stereo_matching import REASONS

SHAPE = (300, 400)
RIG = converging(25.0, f=600.0, shape=SHAPE, distance=400.0, dist=[-0.15, 0.05, 0.0005, -0.001])
TURN, SHIFT = facing(400.0, x=10, y=18, z=5)


def speckle(x, y):
    """Waves in many directions, all of 3 to 9 mm: smooth, and nowhere alike."""
    rng = np.random.default_rng(7)
    total = np.zeros_like(x)
    for _ in range(24):
        angle, k, phase = (
            rng.uniform(0, 2 * np.pi),
            2 * np.pi / rng.uniform(3, 9),
            rng.uniform(0, 7),
        )
        total += np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + phase)
    return 128.0 + 40.0 * total / np.sqrt(12.0)


def waves(x, y):
    return 128.0 + 100.0 * np.sin(2 * np.pi * x / 6.0) + 0.0 * y


def seen(pattern, *, samples=2):
    """Both pictures of a tilted plane."""
    rays = Rays(RIG.left)
    there = RIG.rotation @ TURN, RIG.rotation @ SHIFT + RIG.translation
    return [render(rays, pattern, *pose, samples=samples) for pose in ((TURN, SHIFT), there)]


@pytest.fixture(scope="module")
def pictures():
    return seen(speckle)


@pytest.fixture(scope="module")
def points():
    grid = np.stack(np.meshgrid(np.linspace(-60, 60, 5), np.linspace(-45, 45, 4)), -1).reshape(
        -1, 2
    )
    world = np.column_stack([grid, np.zeros(len(grid))]) @ TURN.T + SHIFT
    left, right = RIG.to_pixels(world)
    inside = ((left > 20) & (left < [379, 279]) & (right > 20) & (right < [379, 279])).all(axis=1)
    return world[inside], left[inside], right[inside]


def test_points_are_found(pictures, points):
    world, left, right = points
    found = RIG.correspondences(*pictures, left)
    assert len(left) >= 15
    assert found.found.mean() >= 0.95
    error = np.hypot(*(found.points_right - right)[found.found].T)
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert error.max() < 0.2
    assert np.abs(found.positions - world)[found.found].max() < 0.5
    assert (found.error[found.found] < 0.1).all()
    assert (found.zncc[found.found] > 0.95).all()
    assert found.summary()["found"] == found.found.sum()


def test_points_that_cannot_be_found(pictures, points):
    flat = np.full(SHAPE, 90, np.uint8)
    left = points[1][:3]

    def reasons(*arguments, **options):
        return {REASONS[i] for i in RIG.correspondences(*arguments, **options).reason}

    assert reasons(*pictures, [[3.0, 5.0], [np.nan, 4.0]]) == {"leaves the pictures"}
    assert reasons(flat, pictures[1], left) == {"no texture"}
    other = np.random.default_rng(0).integers(0, 255, SHAPE).astype(np.uint8)
    assert reasons(pictures[0], other, left) == {"does not look like anything on its epipolar line"}
    told = RIG.correspondences(pictures[0], other, left)
    assert np.isnan(told.points_right).all()
    assert np.isnan(told.positions).all()


def test_a_pattern_that_repeats_is_ambiguous(points):
    found = RIG.correspondences(*seen(waves), points[1])
    assert not found.found.any()
    assert (found.reason == 4).mean() > 0.5


def test_a_wrong_depth_finds_nothing(pictures, points):
    found = RIG.correspondences(*pictures, points[1], depth_range=(500.0, 600.0))
    assert not found.found.any()


def test_messages(pictures, points):
    with pytest.raises(CalibrationError, match="exchange them"):
        RIG.correspondences(*pictures, points[1], depth_range=(500.0, 300.0))
    with pytest.raises(CalibrationError, match="right picture has 100x50 pixels"):
        RIG.correspondences(pictures[0], np.zeros((50, 100), np.uint8), points[1])
    parallel = vision.StereoRig(
        RIG.left, RIG.right, rotation=np.eye(3), translation=[-100.0, 0.0, 0.0]
    )
    with pytest.raises(CalibrationError, match="do not meet"):
        parallel.correspondences(*pictures, points[1])
