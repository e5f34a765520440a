"""What a lens does to the ideal picture, and its inverse.

Brown-Conrady distortion with the coefficients that OpenCV calibrates: radial k1..k6 (a quotient
of polynomials), tangential p1 and p2, thin prism s1..s4, and a tilt of the sensor; in the order
k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y, of which the first 4, 5, 8, 12 or 14 are given
(Brown 1971; Weng, Cohen & Herniou 1992, doi:10.1109/34.159901). Coordinates are those of the
ideal camera, x/z and y/z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import CalibrationError

Array = NDArray[np.float64]

#: Numbers of coefficients, each a model of its own.
LENGTHS = (0, 4, 5, 8, 12, 14)
#: What their names are.
NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
#: Where the iteration ends [1]: some 1e-9 of a pixel.
TOLERANCE = 1e-12
_STEPS = 60
# Arrays of this many points at a time: bounds what the intermediate values take.
_BLOCK = 1 << 18


def coefficients(dist: ArrayLike | None, *, key: str = "dist") -> Array:
    """Return distortion coefficients as a flat array, none given as no distortion.

    Raises
    ------
    CalibrationError
        When there are not 4, 5, 8, 12 or 14 finite numbers.
    """
    found = np.zeros(0) if dist is None else np.asarray(dist, np.float64).reshape(-1)
    if found.size not in LENGTHS or not np.isfinite(found).all():
        raise CalibrationError(
            f"the lens distortion is given by {found.size} numbers"
            + ("" if np.isfinite(found).all() else ", some of them not finite"),
            expected="4, 5, 8, 12 or 14 of k1 k2 p1 p2, k3, k4 k5 k6, s1 s2 s3 s4, tau_x tau_y",
            fix="give the coefficients as the calibration wrote them; a fisheye model is another",
            key=key,
        )
    return found


def _all(dist: Array) -> Array:
    full = np.zeros(14)
    full[: dist.size] = dist
    return full


def _tilt(dist: Array) -> Array | None:
    """Projection onto the tilted sensor, as OpenCV documents it, (3, 3)."""
    tau_x, tau_y = _all(dist)[12:]
    if tau_x == 0.0 and tau_y == 0.0:
        return None
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    turn = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]]
    )
    down = np.array(
        [[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]]
    )
    return down @ turn


def _project(matrix: Array, xy: Array) -> Array:
    out = xy @ matrix[:2, :2].T + matrix[:2, 2]
    scale = xy @ matrix[2, :2] + matrix[2, 2]
    quotient: Array = out / scale[..., np.newaxis]
    return quotient


def _lens(xy: Array, dist: Array) -> tuple[Array, Array]:
    """Distorted coordinates without the tilt, and their Jacobian."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _all(dist)[:12]
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    top = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bottom = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = top / bottom
    # Derivative of the quotient by r2.
    slope = (
        (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2)) - radial * (k4 + r2 * (2.0 * k5 + 3.0 * k6 * r2))
    ) / bottom
    out = np.empty_like(xy)
    out[..., 0] = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + s2 * r2)
    out[..., 1] = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + s4 * r2)
    prism_x, prism_y = s1 + 2.0 * s2 * r2, s3 + 2.0 * s4 * r2
    j = np.empty((*xy.shape[:-1], 2, 2))
    j[..., 0, 0] = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x
    j[..., 0, 1] = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * y * prism_x
    j[..., 1, 0] = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * x * prism_y
    j[..., 1, 1] = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y
    return out, j


def distort(xy: ArrayLike, dist: Array) -> Array:
    """Return where the lens puts ideal points, (..., 2) -> (..., 2)."""
    points = np.asarray(xy, np.float64)
    if not dist.any():
        return points.copy()
    out, _ = _lens(points, dist)
    tilt = _tilt(dist)
    return out if tilt is None else _project(tilt, out)


def distortion_jacobian(xy: ArrayLike, dist: Array) -> Array:
    """Return the derivative of `distort`, (..., 2) -> (..., 2, 2)."""
    points = np.asarray(xy, np.float64)
    out, jacobian = _lens(points, dist)
    tilt = _tilt(dist)
    if tilt is None:
        return jacobian
    scale = out @ tilt[2, :2] + tilt[2, 2]
    image = _project(tilt, out)
    outer = (tilt[:2, :2] - image[..., :, np.newaxis] * tilt[2, :2]) / scale[
        ..., np.newaxis, np.newaxis
    ]
    chained: Array = outer @ jacobian
    return chained


def valid_radius(dist: Array) -> float:
    """Return the ideal radius up to which the radial part is monotonic; may be infinite.

    Beyond it the polynomial folds back and two points have one image: the coefficients say
    nothing there.
    """
    k1, k2, _, _, k3, k4, k5, k6 = _all(dist)[:8]
    top, bottom = (
        np.polynomial.Polynomial([1, k1, k2, k3]),
        np.polynomial.Polynomial([1, k4, k5, k6]),
    )
    u = np.polynomial.Polynomial([0.0, 1.0])
    # d(r N/D)/dr = [N D + 2 u (N' D - N D')] / D^2 with u = r^2
    turning = top * bottom + 2.0 * u * (top.deriv() * bottom - top * bottom.deriv())
    radii = [np.inf]
    for polynomial in (turning.trim(1e-12), bottom.trim(1e-12)):
        roots = polynomial.roots() if polynomial.degree() > 0 else np.zeros(0)
        real = roots.real[(np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots))) & (roots.real > 0.0)]
        radii.extend(np.sqrt(real))
    return float(min(radii))


def undistort(xy: ArrayLike, dist: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the ideal points behind what the lens made of them.

    Newton's method with the exact Jacobian, halving steps that do not help.

    Parameters
    ----------
    xy : (..., 2) [1]
        NaN stays NaN.
    dist : (n,)
        From `coefficients`.

    Returns
    -------
    points : (..., 2) [1]
        To 1e-12; NaN where there is no ideal point.
    solved : (...,) bool
        False for a finite point that no ideal point within `valid_radius` is behind.
    """
    seen = np.asarray(xy, np.float64)
    if not dist.any():
        return seen.copy(), np.ones(seen.shape[:-1], np.bool_)
    flat = seen.reshape(-1, 2)
    out, solved = np.empty_like(flat), np.ones(len(flat), np.bool_)
    tilt, limit = _tilt(dist), valid_radius(dist)
    for first in range(0, len(flat), _BLOCK):
        block = slice(first, first + _BLOCK)
        target = flat[block] if tilt is None else _project(np.linalg.inv(tilt), flat[block])
        out[block], solved[block] = _newton(target, dist, limit)
    return out.reshape(seen.shape), solved.reshape(seen.shape[:-1])


def _newton(target: Array, dist: Array, limit: float) -> tuple[Array, NDArray[np.bool_]]:
    out = np.full_like(target, np.nan)
    known = np.isfinite(target).all(axis=1)
    rows = np.flatnonzero(known)
    goal = target[rows]
    x = _clip(goal.copy(), limit)
    value, jacobian = _lens(x, dist)
    rest = goal - value
    for _ in range(_STEPS):
        if not rows.size:
            break
        determinant = np.linalg.det(jacobian)
        usable = np.abs(determinant) > 1e-12
        jacobian[~usable] = np.eye(2)
        step = np.linalg.solve(jacobian, rest[..., np.newaxis])[..., 0]
        error = np.hypot(*rest.T)
        # The damping: a step that leaves the residual larger is halved, up to 2^-6.
        factor = np.ones(len(rows))
        new = _clip(x + step, limit)
        value, jacobian = _lens(new, dist)
        new_rest = goal - value
        for _ in range(6):
            worse = (np.hypot(*new_rest.T) > error) & (np.hypot(*step.T) > 1e-9)
            if not worse.any():
                break
            factor[worse] *= 0.5
            new[worse] = _clip(x[worse] + factor[worse, np.newaxis] * step[worse], limit)
            value[worse], jacobian[worse] = _lens(new[worse], dist)
            new_rest[worse] = goal[worse] - value[worse]
        moved = np.hypot(*(new - x).T)
        x, rest = new, new_rest
        done = (moved < TOLERANCE) | (np.hypot(*rest.T) < 1e-15)
        good = done & (np.hypot(*rest.T) < 10.0 * TOLERANCE) & (np.hypot(*x.T) <= limit)
        good &= np.linalg.det(jacobian) > 0.0
        out[rows[good]] = x[good]
        going = ~done
        rows, goal, x, rest, jacobian = (
            rows[going], goal[going], x[going], rest[going], jacobian[going]
        )  # fmt: skip
    return out, ~known | np.isfinite(out[:, 0])


def _clip(xy: Array, limit: float) -> Array:
    """Pull points back into the disc where the model holds."""
    if not np.isfinite(limit):
        return xy
    radius = np.hypot(xy[:, 0], xy[:, 1])
    far = radius > limit
    xy[far] *= (limit * (1.0 - 1e-9) / radius[far])[:, np.newaxis]
    return xy
