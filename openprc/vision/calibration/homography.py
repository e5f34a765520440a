"""The projective map between two planes, fitted to pairs of points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError

Array = NDArray[np.float64]

# Below this share of the largest extent, points are taken to lie on a line.
_THIN = 1e-3


@dataclass(frozen=True, slots=True)
class HomographyFit:
    """A homography and how well it fits.

    Attributes
    ----------
    matrix : (3, 3)
        From the source to the target; the third coordinate is positive at the points.
    residuals : (n, 2)
        Target minus prediction.
    rms : float
        Root of the mean squared length of the residuals.
    covariance : (9, 9) or None
        Of the entries of `matrix`, row after row; None where the points leave no redundancy.
    """

    matrix: Array
    residuals: Array
    rms: float
    covariance: Array | None


def apply_homography(matrix: Array, points: Array) -> tuple[Array, Array]:
    """Return the mapped points (..., 2) and the third coordinate (...,) they were divided by."""
    out = points @ matrix[:2, :2].T + matrix[:2, 2]
    third = points @ matrix[2, :2] + matrix[2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return out / third[..., np.newaxis], third


def homography_jacobian(matrix: Array, points: Array) -> Array:
    """Return the derivative of the mapped points, (..., 2, 2)."""
    image, third = apply_homography(matrix, points)
    slope: Array = (
        matrix[:2, :2] - image[..., :, np.newaxis] * matrix[2, :2]
    ) / third[..., np.newaxis, np.newaxis]  # fmt: skip
    return slope


def fit_homography(source: Array, target: Array) -> HomographyFit:
    """Fit a homography by least squares of the distances in the target.

    The normalised direct linear transformation (Hartley 1997, doi:10.1109/34.601246) starts a
    Gauss-Newton iteration on the distances themselves.

    Parameters
    ----------
    source, target : (n, 2)
        At least four pairs, of which four are in general position.

    Raises
    ------
    CalibrationError
        When the points do not determine a homography.
    """
    n = len(source)
    if source.shape != (n, 2) or target.shape != (n, 2):
        raise CalibrationError(
            f"the points have the shapes {source.shape} and {target.shape}",
            expected="two arrays (n, 2) of as many rows",
            fix="give each pixel the point of the plane that it shows",
            key="points",
        )
    if n < 4 or not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise CalibrationError(
            f"there are {n} pairs of points" if n < 4 else "some coordinates are not finite",
            expected="at least 4 finite pairs; with more, errors average out and are seen",
            fix="add points, spread over the plane",
            key="points",
        )
    for points, name in ((source, "plane"), (target, "image")):
        if not _spread(points):
            raise CalibrationError(
                f"the points lie on a line in the {name}, or all but one do",
                expected="four points of which no three are on one line",
                fix="add points off the line, such as the corners of a rectangle",
                key="points",
            )
    from_source, _ = _normaliser(source)
    from_target, to_target = _normaliser(target)
    a, b = apply_homography(from_source, source)[0], apply_homography(from_target, target)[0]
    rows = np.zeros((2 * n, 9))
    rows[0::2, 0:2], rows[0::2, 2] = a, 1.0
    rows[1::2, 3:5], rows[1::2, 5] = a, 1.0
    rows[0::2, 6:8], rows[0::2, 8] = -b[:, :1] * a, -b[:, 0]
    rows[1::2, 6:8], rows[1::2, 8] = -b[:, 1:] * a, -b[:, 1]
    _, _, right = np.linalg.svd(rows)
    matrix, normal = _polish(right[-1].reshape(3, 3), a, b)
    whole = to_target @ matrix @ from_source
    _, third = apply_homography(whole, source)
    if np.median(third) < 0.0:
        whole = -whole
    norm = np.linalg.norm(whole)
    whole = whole / norm
    predicted, third = apply_homography(whole, source)
    if not (third > 0.0).all() or abs(np.linalg.det(matrix)) < 1e-12:
        raise CalibrationError(
            "no camera sees these points of a plane at these pixels: some would be behind it",
            expected="pairs in the same order",
            fix="check that each pixel stands beside its own point of the plane",
            key="points",
        )
    residuals = target - predicted
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    covariance = None
    if n > 4:
        scale = 1.0 / from_target[0, 0]
        variance = np.sum((residuals / scale) ** 2) / (2 * n - 8)
        # vec(A M B) = (A kron B^T) vec(M), row after row.
        change = np.kron(to_target, from_source.T) / norm
        covariance = variance * change @ np.linalg.pinv(normal, rcond=1e-12) @ change.T
    return HomographyFit(whole, residuals, rms, covariance)


def _normaliser(points: Array) -> tuple[Array, Array]:
    """Shift to the centroid and scale to a mean distance of sqrt(2); and the inverse."""
    centre = points.mean(axis=0)
    size = np.sqrt(2.0) / np.mean(np.hypot(*(points - centre).T))
    forward = np.array([[size, 0.0, -size * centre[0]], [0.0, size, -size * centre[1]], [0, 0, 1]])
    back = np.array([[1 / size, 0.0, centre[0]], [0.0, 1 / size, centre[1]], [0, 0, 1]])
    return forward, back


def _polish(matrix: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Gauss-Newton with the norm held at one; also the normal matrix (9, 9) at the end."""
    for _ in range(20):
        matrix = matrix / np.linalg.norm(matrix)
        image, third = apply_homography(matrix, a)
        j = np.zeros((len(a), 2, 9))
        ones = np.column_stack([a, np.ones(len(a))]) / third[:, np.newaxis]
        j[:, 0, 0:3] = j[:, 1, 3:6] = ones
        j[:, :, 6:9] = -image[:, :, np.newaxis] * ones[:, np.newaxis, :]
        flat = j.reshape(-1, 9)
        step = np.linalg.lstsq(flat, (b - image).reshape(-1), rcond=1e-10)[0]
        matrix = matrix + step.reshape(3, 3)
        if np.linalg.norm(step) < 1e-14:
            break
    return matrix, flat.T @ flat


def _spread(points: Array) -> bool:
    """Whether four of the points are in general position."""
    centred = points - points.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False)
    if extent[1] <= _THIN * extent[0]:
        return False
    if len(points) > 8:
        return True
    size = np.ptp(points, axis=0).max() ** 2
    for four in combinations(range(len(points)), 4):
        areas = []
        for triple in combinations(four, 3):
            p, q, r = points[list(triple)]
            areas.append(abs((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])))
        if min(areas) > _THIN * size:
            return True
    return False
