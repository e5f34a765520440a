"""The crossing of two edges, to a few hundredths of a pixel, by fitting what it looks like."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.errors import CalibrationError
from openprc.vision.calibration.homography import fit_homography, homography_jacobian
from openprc.vision.calibration.mapping import Array

_STEPS = 30
# The fit leaves its start by at most this [px], or the start is kept.
_REACH = 2.0
_SMALLEST, _LARGEST = 2.5, 8.0


def refine_corners(
    image: NDArray[np.uint8], points: Array, pixels: Array, *, square: float, free: float
) -> Array:
    """Improve the places of a checkerboard's corners.

    Around a corner the picture is a + b tanh(u/w) tanh(v/w), u and v the distances from the two
    edges: a, b, the blur w, both directions and the place are fitted by Gauss-Newton. The pattern
    is symmetric under a half turn, so that blur of any other shape leaves the place alone.

    Parameters
    ----------
    image : (H, W)
    points : (n, 2) [units]
        The corners on the board, whose sides are along x and y.
    pixels : (n, 2) [px]
        Where they are, to a pixel.
    square : float [units]
        Side of a square.
    free : float
        Radius around a corner without anything else on the board, over the side of a square.

    Returns
    -------
    (n, 2) [px]
        Where the fit fails, what was given.
    """
    try:
        slopes = homography_jacobian(fit_homography(points, pixels).matrix, points)
    except CalibrationError:  # too few corners for their directions
        return pixels
    out = pixels.copy()
    spacing = square * np.linalg.norm(slopes, axis=1).min(axis=1)
    # What is seen obliquely is narrower across its edges than the spacing tells.
    crossing = np.abs(np.linalg.det(slopes)) / np.prod(np.linalg.norm(slopes, axis=1), axis=1)
    radius = np.clip(free * spacing * crossing, 0.0, _LARGEST)
    half = int(np.ceil(_LARGEST)) + 1
    height, width = image.shape
    base = np.rint(pixels).astype(int)
    usable = (radius >= _SMALLEST) & ((base >= half) & (base < [width - half, height - half])).all(
        axis=1
    )
    rows = np.flatnonzero(usable)
    if not rows.size:
        return out
    reach = np.arange(-half, half + 1)
    dx, dy = (grid.ravel().astype(float) for grid in np.meshgrid(reach, reach))
    seen = image[base[rows, 1, None] + dy.astype(int), base[rows, 0, None] + dx.astype(int)].astype(
        float
    )
    place, good = _fit(seen, dx, dy, pixels[rows] - base[rows], slopes[rows], radius[rows])
    moved = np.hypot(*(place - (pixels[rows] - base[rows])).T)
    good &= moved < _REACH
    out[rows[good]] = base[rows[good]] + place[good]
    return out


def _fit(
    seen: Array, dx: Array, dy: Array, start: Array, slopes: Array, radius: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Places of the crossings in their windows, and which are to be believed."""
    n = len(seen)
    # Directions of the edges, along x and along y of the board.
    angles = np.arctan2(slopes[:, 1, :], slopes[:, 0, :])
    p = np.column_stack([start, angles, np.zeros(n), np.zeros(n), np.full(n, 1.0)])
    distance = np.hypot(dx - start[:, :1], dy - start[:, 1:])
    weight = np.clip(radius[:, np.newaxis] + 0.5 - distance, 0.0, 1.0)
    p[:, 4] = np.sum(weight * seen, 1) / np.sum(weight, 1)
    shape = _model(p, dx, dy)[1][..., 5]
    p[:, 5] = np.sum(weight * shape * (seen - p[:, 4:5]), 1) / np.sum(weight * shape**2, 1)
    step = np.full(p.shape, np.inf)
    for _ in range(_STEPS):
        value, j = _model(p, dx, dy)
        weighted = j * weight[..., np.newaxis]
        normal = np.swapaxes(weighted, 1, 2) @ j
        right = np.einsum("npk,np->nk", weighted, seen - value)
        scale = np.einsum("nkk->nk", normal)

        normal += np.eye(7) * (1e-3 * scale)[:, None, :]
        step = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
        step[:, :4] = np.clip(step[:, :4], -0.5, 0.5)
        p = p + step
        p[:, 6] = np.clip(p[:, 6], 0.3, 5.0)
        if np.abs(step[:, :2]).max() < 1e-5:
            break
    value, _ = _model(p, dx, dy)
    rest = np.sum(weight * (seen - value) ** 2, axis=1)
    total = np.sum(weight * (seen - p[:, 4:5]) ** 2, axis=1)
    good = np.isfinite(p).all(axis=1) & (np.abs(step[:, :2]).max(axis=1) < 1e-2)
    # Three quarters of the contrast have to be explained by a crossing.
    return p[:, :2], good & (rest < 0.25 * total)


def _model(p: Array, dx: Array, dy: Array) -> tuple[Array, Array]:
    """Values (n, pixels) and derivatives by x, y, both angles, a, b, w (n, pixels, 7)."""
    x, y = dx - p[:, 0:1], dy - p[:, 1:2]
    a, b, w = p[:, 4:5], p[:, 5:6], p[:, 6:7]
    tanhs, slopes, along, sines = [], [], [], []
    for k in (2, 3):
        c, s = np.cos(p[:, k : k + 1]), np.sin(p[:, k : k + 1])
        across = (c * y - s * x) / w
        t = np.tanh(across)
        tanhs.append(t)
        slopes.append(1.0 - t * t)
        along.append((across, -(c * x + s * y) / w))
        sines.append((s / w, -c / w))
    j = np.empty((*x.shape, 7))
    one, two = slopes[0] * tanhs[1], tanhs[0] * slopes[1]
    j[..., 0] = b * (one * sines[0][0] + two * sines[1][0])
    j[..., 1] = b * (one * sines[0][1] + two * sines[1][1])
    j[..., 2] = b * one * along[0][1]
    j[..., 3] = b * two * along[1][1]
    j[..., 4] = 1.0
    j[..., 5] = tanhs[0] * tanhs[1]
    j[..., 6] = -b / w * (one * along[0][0] + two * along[1][0])
    return a + b * j[..., 5], j
