"""One frame of a recording, as trackers and correlators want it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Frame:
    """A decoded frame.

    Attributes
    ----------
    index : int
        Counted from 0 in the order of decoding.
    stamp : float [s]
        What the container says, NaN where it says nothing.
    grey : (H, W) uint8 [grey levels]
        For detection and KLT.
    intensity : (H, W) uint8, uint16 or float32
        For correlation: the values as recorded. The same object as `grey` for 8-bit input.
    duplicate : bool
        Equal to the frame before, pixel for pixel.
    """

    index: int
    stamp: float
    grey: NDArray[np.uint8]
    intensity: NDArray[Any]
    duplicate: bool


def same_pixels(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Tell whether two images are equal; a sparse look comes first, as most are not."""
    if first.shape != second.shape or first.dtype != second.dtype:
        return False
    if not np.array_equal(first[::17, ::13], second[::17, ::13]):
        return False
    return bool(np.array_equal(first, second))
