"""Following points from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.opencv import load_cv2


@dataclass(frozen=True, kw_only=True)
class LucasKanade:
    """Pyramidal Lucas-Kanade with a forward-backward check.

    Each point is followed into the next frame and back again (Kalal et al.,
    DOI 10.1109/ICPR.2010.675); if it does not come back to within `fb_threshold`, or leaves
    the image, it is lost. A lost point stays lost. The check does not see slow drift or a
    change of lighting.

    Parameters
    ----------
    win_size : int [px]
        Edge of the square window.
    levels : int
        Pyramid levels above the full image; each doubles the motion that can be followed.
    fb_threshold : float [px]
        Largest forward-backward distance.
    """

    win_size: int = 21
    levels: int = 3
    fb_threshold: float = 1.0

    def __post_init__(self) -> None:
        limits = (("win_size", 3), ("levels", 0), ("fb_threshold", 0))
        for name, least in limits:
            value = getattr(self, name)
            if not value >= least or not np.isfinite(value):
                raise ConfigError(
                    f"{name} is {value}",
                    expected=f"a number of at least {least}",
                    fix="leave the option out for the default",
                    key=name,
                )

    def step(
        self,
        before: NDArray[np.uint8],
        after: NDArray[np.uint8],
        points: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return where the points went: (N, 2) [px], NaN for the lost ones.

        Parameters
        ----------
        before, after : (H, W)
            Grey images.
        points : (N, 2) [px]
            Positions in `before`; rows of NaN are passed over.
        """
        cv2 = load_cv2()
        moved = np.full(points.shape, np.nan)
        alive = np.flatnonzero(np.isfinite(points).all(axis=1))
        if not len(alive):
            return moved
        settings = {
            "winSize": (self.win_size, self.win_size),
            "maxLevel": self.levels,
            "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
        }
        start = points[alive].astype(np.float32).reshape(-1, 1, 2)
        there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, None, **settings)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, **settings)
        height, width = after.shape
        x, y = there[:, 0, 0], there[:, 0, 1]
        error = np.linalg.norm((back - start)[:, 0], axis=1)
        kept = (
            (found.ravel() == 1)
            & (returned.ravel() == 1)
            & (error <= self.fb_threshold)
            & (x >= 0)
            & (x <= width - 1)
            & (y >= 0)
            & (y <= height - 1)
        )
        moved[alive[kept]] = there[kept, 0]
        return moved
