"""Where flat, rigid facets are and how they are turned, from one camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.homography import fit_homography
from openprc.vision.calibration.mapping import Array, as_points

if TYPE_CHECKING:
    from openprc.vision.calibration.boards import Board
    from openprc.vision.calibration.camera import CameraCalibration


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation of a plane before a camera.

    Attributes
    ----------
    rotation : (3, 3)
        x_camera = rotation (X, Y, 0) + translation.
    translation : (3,) [units of the facet]
    rms : float [px]
        Reprojection error.
    """

    rotation: Array
    translation: Array
    rms: float

    @property
    def normal(self) -> Array:
        """Unit normal that points towards the camera, (3,)."""
        n = self.rotation[:, 2]
        return n if n @ self.translation < 0.0 else -n


def facet_pose(pixels: ArrayLike, points: ArrayLike, camera: CameraCalibration) -> Pose:
    """Find the pose of a flat facet from points on it.

    The homography of the facet gives the pose (Zhang 2000, doi:10.1109/34.888718); Gauss-Newton
    steps on the reprojection error in the undistorted image make it the least-squares one. A second
    minimum, the facet tilted the other way, is tried and the better kept.

    Parameters
    ----------
    pixels : (n, 2) [px]
        At least four points of the facet, no three on a line.
    points : (n, 2) [any unit]
        Where they are on the flat facet.
    camera : CameraCalibration

    Raises
    ------
    CalibrationError
        When the points do not determine a plane.
    """
    seen, flat = as_points(pixels, key="pixels"), as_points(points)
    ideal = camera.to_normalized(seen)
    fit = fit_homography(flat, ideal)
    start = _from_homography(fit.matrix)
    candidates = [start, _other_tilt(start)]
    focal = float(np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]))
    solved = [_refine(rotation, shift, flat, ideal) for rotation, shift in candidates]
    rotation, shift, error = min(solved, key=lambda item: item[2])
    if not np.isfinite(error):
        raise CalibrationError(
            "no pose of the facet explains its points",
            expected="points of a flat, rigid facet in front of the camera",
            fix="check that each pixel stands beside its own point",
            key="points",
        )
    return Pose(rotation, shift, error * focal)


def board_pose(image: NDArray[np.uint8], board: Board, camera: CameraCalibration) -> Pose:
    """Find the pose of a board in a picture (H, W)."""
    view = board.find(image)
    return facet_pose(view.pixels, view.points[:, :2], camera)


def fold_angle(one: Pose, other: Pose) -> float:
    """Return the angle between the normals of two facets [deg]; 0 for a flat sheet.

    Both normals point towards the camera; the sign of a fold (mountain or valley) is not in it.
    """
    a, b = one.normal, other.normal
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _from_homography(h: Array) -> tuple[Array, Array]:
    scale = 0.5 * (np.linalg.norm(h[:, 0]) + np.linalg.norm(h[:, 1]))
    h = h / (scale if h[2, 2] > 0.0 else -scale)
    rough = np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])])
    u, _, v = np.linalg.svd(rough)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v, h[:, 2]


def _other_tilt(pose: tuple[Array, Array]) -> tuple[Array, Array]:
    """The facet mirrored at the plane across the line of sight: nearly the same image."""
    rotation, shift = pose
    sight = shift / np.linalg.norm(shift)
    normal = rotation[:, 2]
    mirrored = 2.0 * (normal @ sight) * sight - normal
    if mirrored @ normal < 0.0:
        mirrored = -mirrored
    axis = np.cross(normal, mirrored)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return pose
    turn = _rotation(axis / sine * np.arctan2(sine, normal @ mirrored))
    return turn @ rotation, shift


def _rotation(vector: Array) -> Array:
    """Rotation about a vector by its length [rad] (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle < 1e-300:
        return np.eye(3)
    k = _cross(vector / angle)
    rotation: Array = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return rotation


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _refine(rotation: Array, shift: Array, flat: Array, ideal: Array) -> tuple[Array, Array, float]:
    """Levenberg-Marquardt on a turn and a shift; also the rms distance."""
    xyz = np.column_stack([flat, np.zeros(len(flat))])

    def predict(r: Array, t: Array) -> tuple[Array, Array]:
        turned = xyz @ r.T
        inside = turned + t
        if (inside[:, 2] <= 0.0).any():
            return turned, np.full(ideal.shape, np.inf)
        return turned, inside[:, :2] / inside[:, 2:]

    turned, image = predict(rotation, shift)
    cost = float(np.sum((ideal - image) ** 2))
    damping = 1e-6
    for _ in range(100):
        if not np.isfinite(cost):
            break
        z = (turned + shift)[:, 2]
        d = np.zeros((len(z), 2, 3))
        d[:, 0, 0] = d[:, 1, 1] = 1.0 / z
        d[:, :, 2] = -image / z[:, np.newaxis]
        # d(exp(w) x)/dw = -[x]_x
        skew = np.array([-_cross(row) for row in turned])
        j = np.concatenate([d @ skew, d], axis=2).reshape(-1, 6)
        normal, right = j.T @ j, j.T @ (ideal - image).reshape(-1)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-30), right)
        new_r, new_t = _rotation(step[:3]) @ rotation, shift + step[3:]
        new_turned, new_image = predict(new_r, new_t)
        new_cost = float(np.sum((ideal - new_image) ** 2))
        if new_cost <= cost:
            small = cost - new_cost <= 1e-15 * cost
            rotation, shift, turned, image, cost = new_r, new_t, new_turned, new_image, new_cost
            damping = max(0.1 * damping, 1e-12)
            if small:
                break
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    return rotation, shift, float(np.sqrt(cost / len(ideal)))
