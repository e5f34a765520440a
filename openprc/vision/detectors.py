"""Point detectors by name; each turns a grey image into (N, 2) points in px.

The origin is the centre of the upper left pixel, x to the right, y down. Points come strongest
first and no two of them closer than `min_distance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingDependency
from openprc.vision.opencv import load_cv2


@dataclass(frozen=True, kw_only=True)
class ShiTomasi:
    """Corners by the smaller eigenvalue of the structure tensor (Shi and Tomasi 1994).

    The eigenvalue is also what limits the accuracy of a Lucas-Kanade track, so this is the
    detector of choice for tracking (DOI 10.1109/CVPR.1994.323794).
    """

    max_points: int = 100
    quality: float = 0.01
    min_distance: float = 7.0

    def detect(self, image: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return (N, 2) points [px] of a grey image (H, W)."""
        found = load_cv2().goodFeaturesToTrack(
            image, self.max_points, self.quality, self.min_distance
        )
        return np.empty((0, 2)) if found is None else found.reshape(-1, 2).astype(np.float64)


@dataclass(frozen=True, kw_only=True)
class _Keypoints:
    """What the detectors with a scale have in common."""

    factory: ClassVar[str] = ""

    max_points: int = 100
    min_distance: float = 7.0

    def detect(self, image: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return (N, 2) points [px] of a grey image (H, W).

        Raises
        ------
        MissingDependency
            When the installed OpenCV does not have the detector.
        """
        found = sorted(self._create().detect(image, None), key=lambda k: (-k.response, k.pt))
        kept: list[tuple[float, float]] = []
        # One corner gives a keypoint per orientation and scale; a reservoir wants each once.
        for keypoint in found:
            if len(kept) == self.max_points:
                break
            gap = np.subtract(kept, keypoint.pt) if kept else np.full((1, 2), np.inf)
            if np.hypot(gap[:, 0], gap[:, 1]).min() >= self.min_distance:
                kept.append(keypoint.pt)
        return np.array(kept, dtype=np.float64).reshape(-1, 2)

    def _create(self) -> Any:
        cv2 = load_cv2()
        make = getattr(cv2, self.factory, None)
        if make is None:
            make = getattr(getattr(cv2, "xfeatures2d", None), self.factory, None)
        if make is None:
            raise MissingDependency(
                f"OpenCV {cv2.__version__} has no {self.factory}",
                expected="OpenCV 4, or version 5 with its contrib modules",
                fix="pip install 'opencv-python-headless<5', or choose another detector",
                key="detector",
            )
        return make()


class Sift(_Keypoints):
    """Extrema of differences of Gaussians (Lowe, DOI 10.1023/B:VISI.0000029664.99615.94)."""

    factory = "SIFT_create"


class Orb(_Keypoints):
    """FAST corners over scales (Rublee et al., DOI 10.1109/ICCV.2011.6126544)."""

    factory = "ORB_create"


class Akaze(_Keypoints):
    """Extrema in a nonlinear scale space (Alcantarilla et al., DOI 10.5244/C.27.13)."""

    factory = "AKAZE_create"


DETECTORS: dict[str, Any] = {
    "shi-tomasi": ShiTomasi,
    "sift": Sift,
    "orb": Orb,
    "akaze": Akaze,
}
