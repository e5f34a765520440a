"""Points in space from where two cameras see them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from openprc.vision.calibration.distortion import distortion_jacobian
from openprc.vision.calibration.mapping import Array

if TYPE_CHECKING:
    from openprc.vision.calibration.camera import CameraCalibration

_STEPS = 10


@dataclass(frozen=True, slots=True)
class Triangulated:
    """Points in space.

    Attributes
    ----------
    points : (n, 3) [units of the baseline]
        In the frame of the left camera; NaN where a camera does not see the point, or the two
        rays meet behind the cameras.
    error : (n,) [px]
        Root mean square distance between the pixels and those that see the point, over the four
        coordinates.
    covariance : (n, 3, 3)
        From the one-sigma of the pixels; NaN where that is not known.
    """

    points: Array
    error: Array
    covariance: Array


def triangulate_pixels(
    cameras: tuple[CameraCalibration, CameraCalibration],
    rotation: Array,
    translation: Array,
    pixels: tuple[Array, Array],
    sigmas: tuple[Array, Array] | None = None,
) -> Triangulated:
    """Find the points whose images are nearest to the pixels seen.

    The linear solution is improved by Gauss-Newton steps on the reprojection error, weighted by
    the one-sigma of the pixels: the maximum-likelihood estimate for Gaussian errors (Hartley &
    Sturm 1997, doi:10.1006/cviu.1997.0547).

    Parameters
    ----------
    cameras : left and right
    rotation, translation : (3, 3), (3,)
        From the left to the right camera, x_right = R x_left + t.
    pixels : two arrays (n, 2) [px]
        NaN = not seen.
    sigmas : two arrays (n, 2) [px], optional
    """
    n = len(pixels[0])
    points, error = np.full((n, 3), np.nan), np.full(n, np.nan)
    covariance = np.full((n, 3, 3), np.nan)
    both = np.isfinite(pixels[0]).all(axis=1) & np.isfinite(pixels[1]).all(axis=1)
    rows = np.flatnonzero(both)
    if not rows.size:
        return Triangulated(points, error, covariance)
    ideal = [camera.to_normalized(seen[rows]) for camera, seen in zip(cameras, pixels, strict=True)]
    # Derivatives of pixels by ideal directions turn residuals into pixels.
    scale = [
        camera.matrix[:2, :2] @ distortion_jacobian(xy, camera.dist)
        for camera, xy in zip(cameras, ideal, strict=True)
    ]
    poses = ((np.eye(3), np.zeros(3)), (rotation, translation))
    x = _linear(ideal, poses)
    known = sigmas is not None
    spread = [np.ones((len(rows), 2))] * 2 if sigmas is None else [s[rows] for s in sigmas]
    for _ in range(_STEPS):
        rest, slope = _residuals(x, ideal, scale, poses)
        weights = [1.0 / np.where(np.isfinite(s) & (s > 0.0), s, 1.0) for s in spread]
        w = np.concatenate(weights, axis=1)
        j = slope * w[..., np.newaxis]
        normal = np.swapaxes(j, 1, 2) @ j
        usable = np.abs(np.linalg.det(normal)) > 0.0
        normal[~usable] = np.eye(3)
        step = np.linalg.solve(normal, np.swapaxes(j, 1, 2) @ (rest * w)[..., np.newaxis])[..., 0]
        x = x + step
        if not (np.abs(step) > 1e-12 * np.abs(x)).any():
            break
    rest, slope = _residuals(x, ideal, scale, poses)
    depth = [(x @ r.T + t)[:, 2] for r, t in poses]
    front = usable & (depth[0] > 0.0) & (depth[1] > 0.0) & np.isfinite(x).all(axis=1)
    points[rows[front]] = x[front]
    error[rows[front]] = np.sqrt(np.mean(rest[front] ** 2, axis=1))
    if known:
        told = front & np.isfinite(np.concatenate(spread, axis=1)).all(axis=1)
        j = slope[told] / np.maximum(np.concatenate(spread, axis=1)[told], 1e-12)[..., np.newaxis]
        covariance[rows[told]] = np.linalg.inv(np.swapaxes(j, 1, 2) @ j)
    return Triangulated(points, error, covariance)


def _linear(ideal: list[Array], poses: tuple[tuple[Array, Array], ...]) -> Array:
    """Least squares of the distances from the rays times the depth."""
    rows, right = [], []
    for xy, (r, t) in zip(ideal, poses, strict=True):
        for axis in (0, 1):
            rows.append(r[axis] - xy[:, axis, np.newaxis] * r[2])
            right.append(xy[:, axis] * t[2] - t[axis])
    a, b = np.stack(rows, axis=1), np.stack(right, axis=1)
    return np.einsum("nij,nj->ni", np.linalg.pinv(a), b)


def _residuals(
    x: Array, ideal: list[Array], scale: list[Array], poses: tuple[tuple[Array, Array], ...]
) -> tuple[Array, Array]:
    """Seen minus predicted [px], (n, 4), and the derivative of the prediction, (n, 4, 3)."""
    rest, slope = [], []
    for xy, pixel, (r, t) in zip(ideal, scale, poses, strict=True):
        inside = x @ r.T + t
        with np.errstate(divide="ignore", invalid="ignore"):
            predicted = inside[:, :2] / inside[:, 2:]
            d = (r[:2] - predicted[..., np.newaxis] * r[2]) / inside[:, 2, np.newaxis, np.newaxis]
        rest.append(np.einsum("nij,nj->ni", pixel, xy - predicted))
        slope.append(pixel @ d)
    return (
        np.nan_to_num(np.concatenate(rest, axis=1)),
        np.nan_to_num(np.concatenate(slope, axis=1)),
    )
