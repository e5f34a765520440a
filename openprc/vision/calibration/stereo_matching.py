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
# A small window finds candidates, and tangents of the surface's slope are tried at each of them.
_SMALL, _CANDIDATES, _TILTS = 13, 8, (-0.6, -0.3, 0.0, 0.3, 0.6)
_STEP = 0.5
_AROUND = np.array([[0, 0], [_STEP, 0], [-_STEP, 0], [0, _STEP], [0, -_STEP]])


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
    sweep; Collins 1996, doi:10.1109/CVPR.1996.517097); where the two pictures of it correlate,
    larger ones at several tilts are compared, and the best is refined with an affine warp. A point
    is kept when it is unique and lies on its epipolar line.

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
    template = _window(pictures[0], point, subset)
    if template is None:
        return 1, np.nan, none
    if template[1] @ template[1] < subset**2:  # less than one grey level rms
        return 2, np.nan, none
    rays = np.column_stack([rig.left.to_normalized(point + _AROUND), np.ones(5)])
    centre = rays[0] * _depth_steps(rig, rays[0], depths)[:, np.newaxis]
    facing = _facing(rig, centre)
    places, slopes = _seen(rig, rays, centre, facing)
    half = subset // 2
    height, width = pictures[1].shape
    inside = (places >= half).all(axis=1) & (places <= (width - 1 - half, height - 1 - half)).all(
        axis=1
    )
    if not inside.any():
        return 1, np.nan, none
    centre, facing, places, slopes = (values[inside] for values in (centre, facing, places, slopes))
    # Over a small window the tilt of the surface hardly shows.
    small = _window(pictures[0], point, min(subset, _SMALL))
    scores = _scores(pictures[1], small, places, slopes)  # type: ignore[arg-type]
    peaks = _peaks(scores, places)
    # At each peak, the whole window at several tilts.
    tilts = np.array([(a, b) for a in _TILTS for b in _TILTS])
    best_score, best_warp, best_place, rival = -1.0, none, np.zeros(2), -1.0
    ranked = []
    for peak in peaks:
        normal = facing[peak] / np.linalg.norm(facing[peak])
        u = np.cross(normal, [0.0, 1.0, 0.0])
        u /= np.linalg.norm(u)
        tilted = normal + tilts @ np.stack([u, np.cross(normal, u)])
        at, slope = _seen(rig, rays, np.repeat(centre[peak : peak + 1], len(tilts), 0), tilted)
        values = _scores(pictures[1], template, at, slope)
        i = int(np.argmax(values))
        ranked.append((float(values[i]), at[i], slope[i]))
    for score, at, slope in ranked:
        if score > best_score:
            best_score, best_place = score, at
            best_warp = np.concatenate([at, (slope - np.eye(2)).ravel()])
    if best_score < _LEAST_ZNCC:
        return 3, best_score, none
    for score, at, _ in ranked:
        if np.hypot(*(at - best_place)) > _APART:
            rival = max(rival, score)
    if rival > best_score - _RIVAL:
        return 4, best_score, none
    return 0, best_score, best_warp


def _window(picture: NDArray[np.uint8], point: Array, side: int) -> tuple[Array, Array] | None:
    """Places of the pixels around a point, from the point, and their values without the mean."""
    if not np.isfinite(point).all():
        return None
    corner = np.rint(point) - side // 2
    if (corner < 0).any() or (corner + side > picture.shape[::-1]).any():
        return None
    x, y = corner.astype(int)
    values = picture[y : y + side, x : x + side].astype(np.float64).ravel()
    offset = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    return offset + corner - point, values - values.mean()


def _depth_steps(rig: StereoRig, ray: Array, depths: tuple[float, float]) -> Array:
    """Depths whose images in the right picture are half a pixel apart."""
    near, far = depths
    ends = rig.right.project(
        ray * np.linspace(near, far, 32)[:, np.newaxis] @ rig.rotation.T + rig.translation
    )
    length = np.nansum(np.hypot(*np.diff(ends, axis=0).T))
    # Even steps in 1/z are nearly even steps in the picture.
    return 1.0 / np.linspace(1.0 / near, 1.0 / far, int(np.clip(2.0 * length, 8, _LONGEST)))


def _facing(rig: StereoRig, centre: Array) -> Array:
    """Normals half-way between the directions to the two cameras, (m, 3)."""
    other = centre + rig.rotation.T @ rig.translation
    normal: Array = centre / np.linalg.norm(centre, axis=1)[:, np.newaxis]
    return normal + other / np.linalg.norm(other, axis=1)[:, np.newaxis]


def _seen(rig: StereoRig, rays: Array, centre: Array, normal: Array) -> tuple[Array, Array]:
    """Where patches through `centre` across `normal` are in the right picture, and their warps."""
    reach = np.sum(normal * centre, axis=1)
    patch = rays[:, np.newaxis] * (reach / (rays @ normal.T))[..., np.newaxis]
    seen = rig.right.project(patch @ rig.rotation.T + rig.translation)
    slopes = np.stack([seen[1] - seen[2], seen[3] - seen[4]], -1) / (2.0 * _STEP)
    return seen[0], slopes


def _scores(
    picture: NDArray[np.uint8], window: tuple[Array, Array], places: Array, slopes: Array
) -> Array:
    """Zero-normalised cross-correlation of a window with warped ones, (m,)."""
    cv2 = load_cv2()
    local, values = window
    energy = values @ values
    scores = np.zeros(len(places))
    # Blocks: bounds the memory, and remap takes no more than 32767 rows.
    for first in range(0, len(places), 256):
        block = slice(first, first + 256)
        maps = places[block, np.newaxis] + np.einsum("mij,pj->mpi", slopes[block], local)
        maps = np.nan_to_num(maps, nan=-1e3).astype(np.float32)
        seen = cv2.remap(
            picture, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(np.float64)  # fmt: skip
        seen -= seen.mean(axis=1, keepdims=True)
        norm = np.sqrt(energy * np.sum(seen**2, axis=1))
        np.divide(seen @ values, norm, out=scores[block], where=norm > 0.0)
    return scores


def _peaks(scores: Array, places: Array) -> list[int]:
    """The highest local maxima, at least two pixels apart."""
    left = np.concatenate([[-2.0], scores[:-1]])
    right = np.concatenate([scores[1:], [-2.0]])
    order = np.flatnonzero((scores >= left) & (scores >= right))
    kept: list[int] = []
    for i in order[np.argsort(-scores[order])]:
        if all(np.hypot(*(places[i] - places[k])) > 2.0 for k in kept):
            kept.append(int(i))
        if len(kept) == _CANDIDATES:
            break
    return kept
