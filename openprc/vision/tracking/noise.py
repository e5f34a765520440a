"""How noisy the grey levels are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["estimate_noise", "local_noise"]


def local_noise(windows: NDArray[Any]) -> NDArray[np.float64]:
    """Estimate the noise of windows from their second differences.

    The filter is the difference of two Laplacians, which is zero on every plane (Immerkær 1996,
    doi:10.1006/cviu.1996.0060). Texture finer than a few pixels adds to the estimate.

    Parameters
    ----------
    windows : (n, h, w) [grey levels]

    Returns
    -------
    (n,) [grey levels]
        One standard deviation.
    """
    w = np.asarray(windows, np.float64)
    across = w[:, :, :-2] - 2.0 * w[:, :, 1:-1] + w[:, :, 2:]
    both = across[:, :-2] - 2.0 * across[:, 1:-1] + across[:, 2:]
    return np.sqrt(np.pi / 2.0) / 6.0 * np.abs(both).mean(axis=(1, 2))


def estimate_noise(image: NDArray[Any], *, window: int = 15) -> float:
    """Estimate the noise of an image from its smoothest parts.

    Parameters
    ----------
    image : (H, W) [grey levels]
    window : int [px]
        Side of the squares that are compared; the lower decile of their estimates counts.

    Returns
    -------
    float [grey levels]
        One standard deviation; NaN for an image smaller than a window.
    """
    pixels = np.asarray(image)
    rows, columns = pixels.shape[0] // window, pixels.shape[1] // window
    if not rows or not columns:
        return float("nan")
    squares = (
        pixels[: rows * window, : columns * window]
        .reshape(rows, window, columns, window)
        .swapaxes(1, 2)
        .reshape(-1, window, window)
    )
    return float(np.nanquantile(local_noise(squares), 0.1))
