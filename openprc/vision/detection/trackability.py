"""How precisely a place can be followed, foretold from its gradients."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.vision.opencv import load_cv2

#: Side of the window that features are rated with [px]; the tracker's own by default.
WINDOW = 21
#: Variance that rounding to whole grey levels adds.
ROUNDING = 1.0 / 12.0
#: What noise of variance 1 adds to the mean squared slope: the sum of the squared weights.
_NOISE_GAIN = 130.0 / 144.0


def predicted_sigma(
    image: ArrayLike,
    points: ArrayLike,
    *,
    window: int = WINDOW,
    noise: float = 1.0,
    image_noise: float = 0.0,
) -> NDArray[np.float64]:
    """Return the one-sigma of a track along its worst direction, (N,) [px].

    Its square is the larger eigenvalue of ``2 (s^2 + 1/12) G^-1``, with ``G`` the sum of
    ``grad grad^T`` over the window: the Cramer-Rao bound of a translation between two images of
    noise s that are rounded to whole grey levels (Kay 1993, Fundamentals of Statistical Signal
    Processing I, section 3). It is the criterion of Shi & Tomasi (1994, DOI
    10.1109/CVPR.1994.323794), said in pixels.

    Parameters
    ----------
    image : (H, W) [grey levels]
        Its own noise passes for texture and makes flat places look better than they are, as
        long as `image_noise` does not say how much of it there is.
    points : (N, 2) [px]
    window : int [px]
        Side of the window, odd.
    noise : float
        One-sigma of the noise that the track will meet [grey levels].
    image_noise : float
        One-sigma of the noise in `image`, whose share of ``G`` is taken off [grey levels].

    Returns
    -------
    sigma : (N,) [px]
        NaN where the window leaves the image, infinite where there is no gradient along some
        direction.
    """
    return sigma_of(
        least_information(image, points, window=window),
        window=window,
        noise=noise,
        image_noise=image_noise,
    )


def sigma_of(
    information: ArrayLike, *, window: int, noise: float, image_noise: float
) -> NDArray[np.float64]:
    """Return the one-sigma [px] that belongs to `least_information`."""
    share = _NOISE_GAIN * (image_noise**2 + ROUNDING) * window**2 if image_noise > 0 else 0.0
    left = np.asarray(information, dtype=np.float64) - share
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(2.0 * (noise**2 + ROUNDING) / np.where(left < 0.0, 0.0, left))
    return np.asarray(sigma)


def information_of(sigma: ArrayLike) -> NDArray[np.float64]:
    """Return the `least_information` that a `predicted_sigma` of unit noise stands for."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2.0 * (1.0 + ROUNDING) / np.asarray(sigma, dtype=np.float64) ** 2)


def least_information(
    image: ArrayLike, points: ArrayLike, *, window: int = WINDOW
) -> NDArray[np.float64]:
    """Return the smaller eigenvalue of ``G``, (N,) [grey levels^2 / px^2]; see `predicted_sigma`.

    NaN where the window around the nearest pixel leaves the image.

    Raises
    ------
    ConfigError
        The window is no odd number of pixels.
    """
    if int(window) != window or window < 3 or window % 2 == 0:
        raise ConfigError(
            f"the window is {window!r} px",
            expected="an odd number from 3",
            fix=f"the default is {WINDOW}",
            key="window",
        )
    cv2 = load_cv2()
    grey = np.asarray(image)
    if grey.dtype not in (np.uint8, np.uint16, np.float32):
        grey = grey.astype(np.float32)
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
    least = np.full(len(places), np.nan)
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
    least[fits] = lesser
    return least
