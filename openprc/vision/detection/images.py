"""Images and masks as detectors take them: 8-bit grey levels, and 0 or 255."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError


def grey_image(
    image: ArrayLike,
    *,
    value_range: tuple[float, float] | None = None,
    bayer: str | None = None,
) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    """Return an image as grey levels (H, W), and notes on how they were made.

    Parameters
    ----------
    image : (H, W), (H, W, 3) blue-green-red or (H, W, 4) with an alpha channel
        8 bit is taken as it is. 16 bit and floating point are scaled by a fixed range, by
        default the smallest usual depth of a camera or 0..1 or 0..255 that holds the values;
        see `openprc.vision.source.grey_levels`.
    value_range, bayer
        As for `VideoSource`.

    Raises
    ------
    VideoError
        It is no image, or holds values that are not finite.
    ConfigError
        Floating point values that need a `value_range`.
    """
    from openprc.vision.source.grey_levels import GreyLevels  # noqa: PLC0415 - needs OpenCV

    levels = GreyLevels(value_range, bayer=bayer)
    given = np.ascontiguousarray(image)
    levels.learn(given, index=0)
    levels.settle()
    grey, _ = levels.convert(given, index=0)
    return grey, tuple(levels.notes)


def mask_image(mask: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a mask as (H, W) uint8, 0 where nothing is wanted and 255 elsewhere.

    Parameters
    ----------
    mask : (H, W) or (H, W, 3), bool or number
        Nothing is wanted where it is 0 or False; an alpha channel plays no part.
    shape : (H, W) [px]

    Raises
    ------
    ConfigError
        Another size than the image, or nothing is left.
    """
    given = np.asarray(mask)
    if given.ndim == 3:
        # Grey with alpha and colour with alpha: what is painted counts.
        colours = given.shape[2] - (given.shape[2] in (2, 4))
        given = given[:, :, :colours].max(axis=2)
    if given.shape != tuple(shape):
        size = " x ".join(str(edge) for edge in given.shape[::-1]) or "a single number, no"
        raise ConfigError(
            f"a mask of {size} px",
            expected=f"{shape[1]} x {shape[0]} px, as the image",
            fix="draw the mask over a frame of this video",
            key="mask",
        )
    allowed = np.where(given != 0, np.uint8(255), np.uint8(0))
    if not allowed.any():
        raise ConfigError(
            "the mask is 0 everywhere",
            expected="white where points are wanted",
            fix="invert it, or leave it out",
            key="mask",
        )
    return allowed


def why_nothing(grey: NDArray[np.uint8], mask: NDArray[np.uint8] | None) -> str:
    """Return a clause on what an image looks like in which nothing was found."""
    seen = grey if mask is None else grey[mask != 0]
    low, high = int(seen.min()), int(seen.max())
    if low == high:
        return (
            f"; the image is {'black' if high == 0 else 'white' if low == 255 else 'blank'}, "
            f"grey level {low} everywhere"
        )
    saturated = float(np.mean((seen == 0) | (seen == 255)))
    if saturated > 0.5:
        return f"; {saturated:.0%} of the pixels are black or white (saturated)"
    return f"; grey levels go from {low} to {high}"
