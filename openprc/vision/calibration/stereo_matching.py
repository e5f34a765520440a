"""The points of one camera's picture in the other's, along the epipolar line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.board_images import read_image
from openprc.vision.calibration.mapping import Array, as_points, finite
from openprc.vision.opencv import load_cv2

if TYPE_CHECKING:
    from openprc.vision.calibration.stereo import StereoRig

#: Why a point has no partner.
REASONS = (
    "found",
    "leaves the pictures",
    "no texture",
    "does not look like anything on its epipolar line",
    "looks like several places on its epipolar line",
    "refinement did not converge",
    "off its epipolar line",
)
# Places this far apart [px] whose correlations differ by less than this are ambiguous.
_APART, _RIVAL = 5.0, 0.05
_LEAST_ZNCC, _REFINED_ZNCC, _LARGEST_ERROR = 0.6, 0.8, 1.5
_LONGEST = 4000


@dataclass(frozen=True, slots=True)
class Correspondences:
    """Where points of the left picture are in the right one.

    Attributes
    ----------
    points_left, points_right : (N, 2) [px]
        NaN in the right one where a point was not found.
    positions : (N, 3) [units of the rig]
        In its world frame.
    zncc : (N,)
        Zero-normalised cross-correlation of the two windows.
    error : (N,) [px]
        Reprojection error.
    reason : (N,)
        Index into `REASONS`.
    """

    points_left: Array
    points_right: Array
    positions: Array
    zncc: Array
    error: Array
    reason: NDArray[np.uint8]

    @property
    def found(self) -> NDArray[np.bool_]:
        """Which points have a partner, (N,)."""
        return self.reason == 0

    def summary(self) -> dict[str, int]:
        """Return how many points ended for which reason."""
        return {text: int((self.reason == i).sum()) for i, text in enumerate(REASONS)}


def match(
    rig: StereoRig,
    image_left: Any,
    image_right: Any,
    points_left: ArrayLike,
    *,
    depth_range: tuple[float, float] | None = None,
    subset: int = 31,
) -> Correspondences:
    """Find points of the left picture in the right one.

    For each point a small patch that faces both cameras is moved along its line of sight (plane
    sweep; Collins 1996, doi:10.1109/CVPR.1996.517097), and where the two pictures of it correlate
    best the place is refined with an affine warp. A point is kept when it is unique and lies on
    its epipolar line.

    Parameters
    ----------
    rig : StereoRig
    image_left, image_right : pictures of one moment
    points_left : (N, 2) [px]
    depth_range : (float, float), optional [units of the rig]
        Nearest and farthest distance along the left camera's axis. By default 0.7 to 1.4 times
        that at which the two axes are nearest to each other.
    subset : int [px]
        Side of the window, odd.

    Raises
    ------
    CalibrationError
        When the cameras are parallel and no depth range is given.
    """
    from openprc.vision.tracking.correlation import (  # noqa: PLC0415 - compiles
        Correlator,
        RefineSettings,
    )

    pictures = [read_image(image_left), read_image(image_right)]
    for camera, picture, side in zip(
        (rig.left, rig.right), pictures, ("left", "right"), strict=True
    ):
        if picture.shape != camera.frame_shape:
            raise CalibrationError(
                f"the {side} picture has {picture.shape[1]}x{picture.shape[0]} pixels, its camera "
                f"{camera.frame_shape[1]}x{camera.frame_shape[0]}",
                expected="pictures of the size that the rig was calibrated with",
                fix="use pictures of the calibrated cameras",
                key=f"image_{side}",
            )
    points = as_points(points_left, key="points_left").reshape(-1, 2)
    depths = _depths(rig, depth_range)
    n = len(points)
    guesses = np.full((n, 6), np.nan)
    zncc, reason = np.full(n, np.nan), np.zeros(n, np.uint8)
    for i, point in enumerate(points):
        reason[i], zncc[i], guesses[i] = _sweep(rig, pictures, point, depths, subset)
    tried = np.flatnonzero(reason == 0)
    right = np.full((n, 2), np.nan)
    if tried.size:
        correlator = Correlator(
            RefineSettings(subset=subset, model="affine", max_znssd=2.0 * (1.0 - _REFINED_ZNCC))
        )
        ids = correlator.add_templates(correlator.prepare(pictures[0]), points[tried])
        refined = correlator.refine(correlator.prepare(pictures[1]), ids, guesses[tried])
        moved = np.hypot(*(refined.positions - guesses[tried, :2]).T)
        zncc[tried] = refined.zncc
        good = refined.accepted & (refined.zncc >= _REFINED_ZNCC) & (moved < 0.25 * subset)
        reason[tried[~good]] = 5
        right[tried[good]] = refined.positions[good]
    found = rig.triangulate_points(points, right)
    off = (reason == 0) & ~(found.error <= _LARGEST_ERROR)
    reason[off] = 6
    right[reason != 0] = np.nan
    found.points[reason != 0] = np.nan
    return Correspondences(points, right, found.points, zncc, found.error, reason)


def _depths(rig: StereoRig, depth_range: tuple[float, float] | None) -> tuple[float, float]:
    if depth_range is not None:
        near, far = (finite(value, key="depth_range", above=0.0) for value in depth_range)
        if near >= far:
            raise CalibrationError(
                f"the depths go from {near:g} to {far:g}",
                expected="the nearest, then the farthest",
                fix="exchange them",
                key="depth_range",
            )
        return near, far
    # Where the left axis (0, 0, z) is nearest to the right one, c + s d.
    d = rig.rotation[2]
    c = -rig.rotation.T @ rig.translation
    cosine = d[2]
    bottom = 1.0 - cosine**2
    z = (c[2] - cosine * (c @ d)) / bottom if bottom > 1e-4 else -1.0
    if z <= 0.0:
        raise CalibrationError(
            "the axes of the two cameras do not meet in front of them",
            expected="a range of distances to look in",
            fix="pass depth_range=(nearest, farthest) in the units of the rig",
            key="depth_range",
        )
    return 0.7 * z, 1.4 * z


def _sweep(
    rig: StereoRig, pictures: list[NDArray[np.uint8]], point: Array, depths: tuple[float, float],
    subset: int,
) -> tuple[int, float, Array]:  # fmt: skip
    """Reason, correlation and warp (px, py, a, b, c, d) of the best place."""
    none = np.full(6, np.nan)
    half = subset // 2
    height, width = pictures[0].shape
    corner = np.rint(point) - half if np.isfinite(point).all() else np.array([-1.0, -1.0])
    if (corner < 0).any() or (corner + subset > (width, height)).any():
        return 1, np.nan, none
    x, y = corner.astype(int)
    window = pictures[0][y : y + subset, x : x + subset].astype(np.float64).ravel()
    window = window - window.mean()
    energy = window @ window
    if energy < subset**2:  # less than one grey level rms
        return 2, np.nan, none
    centres, slopes = _curve(rig, point, depths)
    right_height, right_width = pictures[1].shape
    inside = (
        np.isfinite(centres).all(axis=1)
        & (centres >= half).all(axis=1)
        & (centres <= (right_width - 1 - half, right_height - 1 - half)).all(axis=1)
    )
    centres, slopes = centres[inside], slopes[inside]
    if not len(centres):
        return 1, np.nan, none
    offset = np.stack(np.meshgrid(np.arange(subset), np.arange(subset)), -1).reshape(-1, 2)
    local = offset + corner - point
    maps = centres[:, np.newaxis] + np.einsum("mij,pj->mpi", slopes, local)
    cv2 = load_cv2()
    scores = np.empty(len(centres))
    for first in range(0, len(centres), 256):
        block = maps[first : first + 256].astype(np.float32)
        # Too long rows or columns are refused by remap: 256 rows of subset^2 columns are not.
        seen = cv2.remap(
            pictures[1], block[..., 0], block[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(np.float64)  # fmt: skip
        seen -= seen.mean(axis=1, keepdims=True)
        norm = np.sqrt(energy * np.sum(seen**2, axis=1))
        scores[first : first + 256] = np.divide(
            seen @ window, norm, out=np.zeros(len(seen)), where=norm > 0.0
        )
    best = int(np.argmax(scores))
    if scores[best] < _LEAST_ZNCC:
        return 3, float(scores[best]), none
    apart = np.hypot(*(centres - centres[best]).T) > _APART
    if apart.any() and scores[apart].max() > scores[best] - _RIVAL:
        return 4, float(scores[best]), none
    warp = np.concatenate([centres[best], (slopes[best] - np.eye(2)).ravel()])
    return 0, float(scores[best]), warp


def _curve(rig: StereoRig, point: Array, depths: tuple[float, float]) -> tuple[Array, Array]:
    """Places in the right picture and the local affine maps to there, a pixel or less apart."""
    near, far = depths
    step = 0.5
    around = point + np.array([[0, 0], [step, 0], [-step, 0], [0, step], [0, -step]])
    rays = np.column_stack([rig.left.to_normalized(around), np.ones(5)])
    ends = rig.right.project(
        rays[0] * np.linspace(near, far, 32)[:, np.newaxis] @ rig.rotation.T + rig.translation
    )
    length = np.nansum(np.hypot(*np.diff(ends, axis=0).T))
    count = int(np.clip(2.0 * length, 8, _LONGEST))
    # Even steps in 1/z are nearly even steps in the picture.
    z = 1.0 / np.linspace(1.0 / near, 1.0 / far, count)
    centre = rays[0] * z[:, np.newaxis]
    # The patch faces half-way between the two cameras.
    other = -rig.rotation.T @ rig.translation
    view = centre / np.linalg.norm(centre, axis=1)[:, np.newaxis]
    from_other = centre - other
    normal = view + from_other / np.linalg.norm(from_other, axis=1)[:, np.newaxis]
    reach = np.sum(normal * centre, axis=1)
    along = rays @ normal.T
    patch = rays[:, np.newaxis] * (reach / along)[..., np.newaxis]
    seen = rig.right.project(patch @ rig.rotation.T + rig.translation)
    slopes = np.stack([seen[1] - seen[2], seen[3] - seen[4]], -1) / (2.0 * step)
    return seen[0], slopes
