"""How the surroundings of a point move: a robust affine fit to its neighbours.

Iteratively reweighted least squares with Tukey's biweight (Beaton & Tukey 1974,
DOI 10.1080/00401706.1974.10489171), begun from the median displacement and scaled by the median
absolute deviation, so that neighbours on another body, or gone astray, have no say while they
are fewer than half.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Standard deviations per median absolute deviation of a normal distribution.
MAD_TO_SIGMA = 1.4826
_TUKEY = 4.685
_ROUNDS = 4
#: Deviations are not taken to be smaller [px]: exact neighbours would shut each other out.
_LEAST_SPREAD = 0.05


@dataclass(frozen=True, slots=True)
class LocalMotion:
    """What the neighbours of `n` points say.

    Attributes
    ----------
    positions : (n, 2) [px]
        Where each point ought to be, NaN without neighbours.
    gradients : (n, 2, 2)
        Deformation gradient of the surroundings.
    spread : (n,) [px]
        Robust standard deviation of the neighbours from the fit.
    counts : (n,)
        Neighbours that had a say.
    residuals : (n, k) [px]
        Departure of each neighbour from the fit.
    """

    positions: NDArray[np.float64]
    gradients: NDArray[np.float64]
    spread: NDArray[np.float64]
    counts: NDArray[np.intp]
    residuals: NDArray[np.float64]


def masked_median(values: NDArray[np.float64], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the median along axis 1 of (n, k) where `valid`; the lower one, NaN for none."""
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    counts = valid.sum(axis=1)
    middle = ordered[np.arange(len(ordered)), np.maximum(counts - 1, 0) // 2]
    return np.where(counts > 0, middle, np.nan)


def neighbour_table(points: NDArray[np.float64], k: int) -> NDArray[np.intp]:
    """Return the nearest other points of each point, (N, min(k, N - 1)), nearest first."""
    return nearest(points, points, k + 1)[:, 1:]


def nearest(points: NDArray[np.float64], at: NDArray[np.float64], k: int) -> NDArray[np.intp]:
    """Return which of `points` (N, 2) are nearest to each of `at` (n, 2): (n, min(k, N))."""
    from scipy.spatial import cKDTree

    k = min(k, len(points))
    found: NDArray[np.intp] = cKDTree(points).query(at, k=np.arange(1, k + 1))[1]
    return found


def local_motion(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    valid: NDArray[np.bool_],
    at: NDArray[np.float64],
) -> LocalMotion:
    """Fit the motion around n points.

    Parameters
    ----------
    before, after : (n, k, 2) [px]
        Neighbours.
    valid : (n, k)
        Which of them count.
    at : (n, 2) [px]
        Where the points were.
    """
    n = len(at)
    weights = valid.astype(np.float64)
    offset = np.where(valid[..., None], before - at[:, None], 0.0)
    moved = np.where(valid[..., None], after - before, 0.0)
    counts = valid.sum(axis=1)
    scale = np.sqrt((offset**2).sum(axis=(1, 2)) / np.maximum(counts, 1))
    scale = np.where(scale > 0, scale, 1.0)
    design = np.empty((n, weights.shape[1], 3))
    design[..., 0] = 1.0
    design[..., 1:] = offset / scale[:, None, None]
    fit = np.zeros((n, 3, 2))
    fit[:, 0, 0] = masked_median(moved[..., 0], valid)
    fit[:, 0, 1] = masked_median(moved[..., 1], valid)
    # Neighbours on a line leave the gradient across it open; it is then taken as none.
    ridge = np.diag([1e-9, 1e-4, 1e-4])
    known = counts > 0
    fit[~known] = 0.0
    spread = np.zeros(n)
    for last in range(_ROUNDS + 1):
        residual = np.linalg.norm(moved - design @ fit, axis=2)
        spread = MAD_TO_SIGMA * masked_median(residual, valid)
        spread = np.where(known, np.maximum(spread, _LEAST_SPREAD), np.nan)
        if last == _ROUNDS:
            break
        limit = _TUKEY * np.where(known, spread, 1.0)
        weights = np.where(valid, np.maximum(1 - (residual / limit[:, None]) ** 2, 0) ** 2, 0.0)
        weighted = design * weights[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ design
        normal += ridge * np.maximum(counts, 1)[:, None, None]
        enough = weights.sum(axis=1) > 0.5
        # Fewer than three neighbours leave a translation.
        normal[counts < 3, 0, 1:] = 0.0
        normal[counts < 3, 1:, :] = np.eye(3)[1:]
        solved = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ moved)
        solved[counts < 3, 1:] = 0.0
        fit = np.where(enough[:, None, None], solved, fit)
    gradients = np.eye(2) + np.swapaxes(fit[:, 1:], 1, 2) / scale[:, None, None]
    positions = np.where(known[:, None], at + fit[:, 0], np.nan)
    return LocalMotion(positions, gradients, spread, counts, residual)
