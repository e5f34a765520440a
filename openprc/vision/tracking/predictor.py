"""Pyramidal Lucas-Kanade from one frame to the next, there and back.

Bouguet, Pyramidal implementation of the Lucas Kanade feature tracker (2001), in OpenCV's
implementation; the check forward and back is that of Kalal et al. 2010,
DOI 10.1109/ICPR.2010.675.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.vision.opencv import load_cv2
from openprc.vision.tracking.config import KLTConfig

USUAL_LEVELS = 3
FAST_LEVELS = 5
#: A step [px] from which on three levels begin to lose points whose window is 21 px.
FAST_STEP = 12.0


@dataclass(frozen=True, slots=True)
class Step:
    """Where points went between two frames.

    Attributes
    ----------
    positions : (n, 2) [px]
        NaN where the search ended without one.
    found : (n,)
        The search ended, inside the image.
    outside : (n,)
        The search left the image.
    fb_error : (n,) [px]
        Distance between the start and the end of the way there and back; inf where either
        was not found.
    """

    positions: NDArray[np.float64]
    found: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    fb_error: NDArray[np.float64]


def inside(points: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which points (n, 2) [px] lie in an image of `shape` (H, W); NaN does not."""
    x, y = points[:, 0], points[:, 1]
    return (x >= 0) & (x <= shape[1] - 1) & (y >= 0) & (y <= shape[0] - 1)


class PyramidalKLT:
    """Follows points between two 8-bit images."""

    def __init__(self, config: KLTConfig) -> None:
        self.config = config

    def levels(self, shape: tuple[int, ...], step: float) -> int:
        """Return the pyramid levels for points that last moved by `step` [px]."""
        if self.config.max_level != "auto":
            return self.config.max_level
        wanted = FAST_LEVELS if step > FAST_STEP else USUAL_LEVELS
        room = min(shape[0] / self.config.win_size[1], shape[1] / self.config.win_size[0]) / 2
        return max(0, min(wanted, int(math.log2(room)) if room > 1 else 0))

    def step(
        self,
        before: NDArray[np.uint8],
        after: NDArray[np.uint8],
        points: NDArray[np.float64],
        *,
        last_step: float = 0.0,
        guess: NDArray[np.float64] | None = None,
        back: bool = True,
    ) -> Step:
        """Follow `points` (n, 2) [px] from `before` to `after`.

        Parameters
        ----------
        before, after : (H, W)
            Grey images.
        last_step : float [px]
            How far points moved last, for the choice of pyramid levels.
        guess : (n, 2) [px], optional
            Where to begin the search; at `points` where left out.
        back : bool
            Follow them back as well; `fb_error` is inf otherwise.
        """
        cv2 = load_cv2()
        n = len(points)
        if n == 0:
            none = np.zeros(0, bool)
            return Step(np.zeros((0, 2)), none, none, np.zeros(0))
        settings = {
            "winSize": self.config.win_size,
            "maxLevel": self.levels(before.shape, last_step),
            "criteria": (
                cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT,
                self.config.max_iterations,
                self.config.epsilon,
            ),
        }
        start = points.astype(np.float32).reshape(-1, 1, 2)
        if guess is None:
            there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, None, **settings)
        else:
            first = guess.astype(np.float32).reshape(-1, 1, 2)
            there, found, _ = cv2.calcOpticalFlowPyrLK(
                before, after, start, first, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, **settings
            )
        positions = there[:, 0].astype(np.float64)
        finite = np.isfinite(positions).all(axis=1)
        within = inside(positions, after.shape)
        # OpenCV may report success for a position outside the image, so its word alone is
        # not taken for it.
        arrived = (found[:, 0] == 1) & within
        fb_error = np.full(n, np.inf)
        if back and arrived.any():
            ends = there[arrived]
            if guess is None:
                back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, ends, None, **settings)
            else:
                home = ends - (first[arrived] - start[arrived])
                back, returned, _ = cv2.calcOpticalFlowPyrLK(
                    after, before, ends, home, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, **settings
                )
            gap = (back - start[arrived])[:, 0]
            error = np.hypot(gap[:, 0], gap[:, 1]).astype(np.float64)
            fb_error[arrived] = np.where((returned[:, 0] == 1) & np.isfinite(error), error, np.inf)
        positions[~finite] = np.nan
        return Step(positions, arrived, finite & ~within, fb_error)
