"""The least variance that any unbiased tracker can have."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Variance of rounding to whole grey levels.
ROUNDING = 1.0 / 12.0


def cramer_rao(
    image: ArrayLike, points: ArrayLike, *, window: int = 21, noise: float
) -> NDArray[np.float64]:
    """Return the bound on one-sigma of tracked positions, (N, 2) [px].

    For a pure translation between two images that are both noisy, over a window W,
    ``cov = 2 (s^2 + 1/12) G^-1`` with ``G`` the sum of ``grad grad^T`` over W (Kay 1993,
    Fundamentals of Statistical Signal Processing I, section 3; both images enter, hence the 2).

    Parameters
    ----------
    image : (H, W)
        Without noise: the gradient of noise would be taken for texture.
    points : (N, 2) [px]
        Windows are centred on the nearest pixel; NaN where a window leaves the image.
    window : int [px]
        Side of the window, odd.
    noise : float
        One-sigma of the noise in every image [grey levels].
    """
    from scipy.ndimage import map_coordinates, spline_filter

    clean = np.asarray(image, dtype=np.float64)
    places = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    # The slope of the cubic spline through the pixels, by the exact difference of its
    # quadratic derivative: central differences of samples would blur it.
    spline = spline_filter(clean, order=3, mode="mirror")
    y, x = np.mgrid[: clean.shape[0], : clean.shape[1]].astype(np.float64)
    step = 1e-3
    settings = {"order": 3, "prefilter": False, "mode": "mirror"}
    gx, gy = (
        (
            map_coordinates(spline, [y + step * b, x + step * a], **settings)
            - map_coordinates(spline, [y - step * b, x - step * a], **settings)
        )
        / (2 * step)
        for a, b in ((1, 0), (0, 1))
    )
    half = window // 2
    bound = np.full((len(places), 2), np.nan)
    for i, (px, py) in enumerate(np.rint(places).astype(int)):
        rows, columns = slice(py - half, py + half + 1), slice(px - half, px + half + 1)
        if py < half or px < half or py + half >= clean.shape[0] or px + half >= clean.shape[1]:
            continue
        a, b = gx[rows, columns].ravel(), gy[rows, columns].ravel()
        information = np.array([[a @ a, a @ b], [a @ b, b @ b]])
        if np.linalg.cond(information) < 1e12:
            bound[i] = np.sqrt(2.0 * (noise**2 + ROUNDING) * np.diag(np.linalg.inv(information)))
    return bound
