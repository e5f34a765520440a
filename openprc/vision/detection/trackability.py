"""How precisely a place can be followed, foretold from its gradients."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.vision.opencv import load_cv2


def predicted_sigma(
    image: ArrayLike, points: ArrayLike, *, window: int = 21, noise: float = 1.0
) -> NDArray[np.float64]:
    """Return the one-sigma of a track along its worst direction, (N,) [px].

    ``2 s^2 / lambda`` is its square, with ``lambda`` the smaller eigenvalue of ``G``, the sum of
    ``grad grad^T`` over the window: the Cramer-Rao bound of a translation between two images of
    noise s. It is the criterion of Shi & Tomasi (1994, DOI 10.1109/CVPR.1994.323794), said in
    pixels.

    Parameters
    ----------
    image : (H, W) [grey levels]
        Its own noise passes for texture and makes flat places look a little better than they
        are.
    points : (N, 2) [px]
    window : int [px]
        Side of the window, odd.
    noise : float
        One-sigma of the noise [grey levels].

    Returns
    -------
    sigma : (N,) [px]
        NaN where the window leaves the image, infinite where there is no gradient along some
        direction.
    """
    cv2 = load_cv2()
    grey = np.asarray(image)
    places = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    # A difference of fourth order: what central differences make of a fine speckle is a third
    # too small.
    slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0], np.float32) / np.float32(12.0)
    pass_by = np.ones(1, np.float32)
    gx = cv2.sepFilter2D(grey, cv2.CV_32F, slope, pass_by)
    gy = cv2.sepFilter2D(grey, cv2.CV_32F, pass_by, slope)
    box = {"ddepth": cv2.CV_64F, "ksize": (window, window), "normalize": False}
    xx, yy, xy = (cv2.boxFilter(a * b, **box) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    half = window // 2
    height, width = grey.shape
    sigma = np.full(len(places), np.nan)
    with np.errstate(invalid="ignore"):
        nearest = np.rint(places)
        fits = (
            (nearest >= half).all(axis=1)
            & (nearest[:, 0] < width - half)
            & (nearest[:, 1] < height - half)
        )
    x, y = nearest[fits].astype(np.intp).T
    middle = 0.5 * (xx[y, x] + yy[y, x])
    lesser = middle - np.hypot(0.5 * (xx[y, x] - yy[y, x]), xy[y, x])
    # What is left of a difference of large sums is no gradient.
    lesser[lesser <= 1e-9 * middle] = 0.0
    with np.errstate(divide="ignore"):
        sigma[fits] = np.sqrt(2.0 * noise**2 / lesser)
    return sigma
