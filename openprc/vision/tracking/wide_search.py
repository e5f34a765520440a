"""A coarse search in whole pixels for points whose expected position is off by several pixels.

The refinement finds its way from a guess two or three pixels off; after a long time out of sight,
or in a surrounding that bends, the guess may be worse. The patch of the reference frame, deformed
as the surroundings are, is then compared with every position around the guess by the
zero-normalised cross-correlation (Lewis 1995, Fast normalized cross-correlation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.opencv import load_cv2
from openprc.vision.tracking.point_state import gradients

#: Half the width of a peak of the correlation [px], and how high the next one may be.
_PEAK = 3
_RUNNER_UP = 0.9
#: Height of the phase correlation's peak from which on a shift of the whole image stands out;
#: images that have nothing in common stay below half of this.
_CLEAR = 0.05


def wide_search(
    reference: NDArray[np.uint8],
    image: NDArray[np.uint8],
    points: NDArray[np.float64],
    expected: NDArray[np.float64],
    *,
    size: int,
    radius: int,
) -> NDArray[np.float64]:
    """Return better guesses (n, 6) for where points are, NaN for none or several alike.

    Parameters
    ----------
    reference, image : (H, W)
        Grey images.
    points : (n, 2) [px]
        In `reference`.
    expected : (n, 6)
        Warps from the reference frame.
    size : int [px]
        Edge of the patch, odd.
    radius : int [px]
        How far from the expected position to look, in x and in y.
    """
    cv2 = load_cv2()
    guesses = np.full((len(points), 6), np.nan)
    half = size // 2
    height, width = image.shape
    warped = gradients(expected)
    for i, (x, y) in enumerate(expected[:, :2]):
        # A sum that is NaN, or too large for an integer, has no place in an image either.
        if not (-radius <= x < width + radius and -radius <= y < height + radius):
            continue
        column, row = round(float(x)), round(float(y))
        left, right = max(column - radius - half, 0), min(column + radius + half + 1, width)
        top, bottom = max(row - radius - half, 0), min(row + radius + half + 1, height)
        if right - left < size or bottom - top < size:
            continue
        try:
            back = np.linalg.inv(warped[i])
        except np.linalg.LinAlgError:
            continue
        shift = points[i] - back @ (half, half)
        patch = cv2.warpAffine(
            reference,
            np.column_stack([back, shift]),
            (size, size),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        score = cv2.matchTemplate(image[top:bottom, left:right], patch, cv2.TM_CCOEFF_NORMED)
        _, best, _, (across, down) = cv2.minMaxLoc(score)
        rows, columns = (
            slice(max(down - _PEAK, 0), down + _PEAK + 1),
            slice(max(across - _PEAK, 0), across + _PEAK + 1),
        )
        score[rows, columns] = -1.0
        if not best > 0 or score.max() > _RUNNER_UP * best:
            continue
        guesses[i, :2] = left + across + half, top + down + half
        guesses[i, 2:] = expected[i, 2:]
    return guesses


def whole_shift(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return by how much most of an image has moved, (2,) [px], however far that is.

    The peak of the phase correlation (Kuglin & Hines 1975). A place to begin a search from, no
    more: zero where no shift stands out.
    """
    cv2 = load_cv2()
    if before.shape != after.shape or min(before.shape) < 8:
        return np.zeros(2)
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(
        before.astype(np.float32), after.astype(np.float32), window
    )
    found = np.array(shift, dtype=np.float64)
    return found if response > _CLEAR and np.isfinite(found).all() else np.zeros(2)
