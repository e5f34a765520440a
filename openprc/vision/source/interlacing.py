"""Signs of two things that spoil tracking and that no container reliably tells.

An interlaced frame is woven of two half images taken one after the other: where something
moves, neighbouring rows differ more than rows that are two apart. A raw colour mosaic (Bayer)
shows as four different mean levels on the four places of a 2 x 2 cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: How often, and every how many frames, pairs are looked at.
_LOOKS, _EVERY = 12, 7
_COLUMNS = 4
#: Ratio of differences over one row and over two above which a frame is taken for woven; white
#: noise has 1, a smooth image 0.5.
_WOVEN = 1.4
#: Least number of moving pixels to judge by.
_MOVING = 60
#: Spread of the four mean levels of a mosaic, over their mean.
_MOSAIC = 0.08

INTERLACED = (
    "where the image moves, neighbouring rows differ more than rows two apart: it looks "
    "interlaced, two half images taken at different times; de-interlace it before tracking"
)
MOSAIC = (
    "pixels on the four places of a 2 x 2 cell have different mean levels: this looks like a raw "
    "colour mosaic (Bayer); name its pattern with the option bayer, for example 'RGGB'"
)


class CombCheck:
    """Collects evidence for interlacing over a few pairs of frames."""

    def __init__(self) -> None:
        self._ratios: list[float] = []

    def look(self, before: NDArray[np.uint8], now: NDArray[np.uint8], *, index: int) -> bool:
        """Return True once, when the evidence suffices."""
        if index % _EVERY or len(self._ratios) >= _LOOKS or min(now.shape) < 8:
            return False
        ratio = row_ratio(before, now)
        if np.isfinite(ratio):
            self._ratios.append(ratio)
        enough = len(self._ratios) in (3, _LOOKS)
        return enough and float(np.median(self._ratios)) > _WOVEN


def row_ratio(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> float:
    """Return the mean difference of neighbouring rows over that of rows two apart.

    Only pixels that changed since the frame before count; NaN where too few did.
    """
    # A part of the columns tells as much.
    image = now[:, ::_COLUMNS].astype(np.int16)
    moving = np.abs(image - before[:, ::_COLUMNS].astype(np.int16))[1:-1] > 12
    if int(moving.sum()) < _MOVING:
        return np.nan
    near = np.abs(image[1:-1] - image[:-2])[moving].mean()
    far = np.abs(image[2:] - image[:-2])[moving].mean()
    return float(near / far) if far > 0 else np.nan


def looks_like_mosaic(image: NDArray[Any]) -> bool:
    """Tell whether a one-channel image looks like a raw colour mosaic."""
    if image.ndim != 2 or min(image.shape) < 16:
        return False
    means = np.array(
        [float(np.mean(image[row::2, column::2])) for row in (0, 1) for column in (0, 1)]
    )
    level = means.mean()
    return bool(level > 0 and np.ptp(means) > _MOSAIC * level)
