"""Two cameras that look at one place, and recordings of points that they see."""

from __future__ import annotations

import numpy as np
from rendered_boards import rotation

import openprc.vision as vision
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.status import Status


def converging(angle, *, f=1500.0, shape=(1024, 1280), distance=600.0, dist=None, **options):
    """A rig whose axes meet at a distance [mm] at an angle [deg]."""
    height, width = shape
    matrix = [[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]]
    camera = vision.CameraCalibration.from_matrix(matrix, dist, frame_shape=shape)
    turn, meeting = rotation(y=angle), np.array([0.0, 0.0, distance])
    return vision.StereoRig(
        camera, camera, rotation=turn, translation=meeting - turn @ meeting, **options
    )


def recording(pixels, times, *, sigma=0.05, status=None):
    """A tracking result from positions (T, N, 2) [px], NaN where lost."""
    seen = np.isfinite(pixels).all(axis=2)
    found = np.where(seen, Status.TRACKED, Status.LOST).astype(np.uint8)
    return TrackingResult(
        positions=np.asarray(pixels, float),
        status=found if status is None else status,
        timestamps=np.asarray(times, float),
        sigma=np.where(seen[..., None], sigma, np.nan).repeat(2, axis=2).astype(np.float32),
        quality=np.where(seen, 0.99, np.nan).astype(np.float32),
    )


def swinging(times, *, n=6, frequency=1.3, seed=0):
    """Points [mm] near (0, 0, 600) on smooth, aperiodic paths, (T, n, 3)."""
    rng = np.random.default_rng(seed)
    start = rng.uniform([-40, -40, 580], [40, 40, 620], (n, 3))
    t = np.asarray(times)[:, None, None]
    way = rng.uniform(3.0, 8.0, (n, 3))
    slow = np.sin(2 * np.pi * frequency * t + 0.4) + 0.7 * np.sin(2 * np.pi * 0.37 * t**1.2)
    return start + way * slow
