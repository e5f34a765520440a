"""The detectors of OpenCV, each with its settings under plain names."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from openprc.vision.detection.feature_map import FeatureMap
from openprc.vision.detection.trackability import predicted_sigma
from openprc.vision.opencv import load_cv2, make_akaze

#: Images of more pixels are searched at half their size where keypoints have a scale: what SIFT
#: holds in memory grows with the number of pixels.
LARGE = 5_000_000
#: Edge of the smallest image that is searched [px].
_SMALLEST = 5


class OpenCVDetector:
    """What the detectors have in common: from keypoints of OpenCV to a feature map."""

    name: ClassVar[str] = ""

    def detect(self, image: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return (N, 2) points [px] of a grey image (H, W), strongest first, none twice."""
        return self.features(image).unique().keypoints

    def features(
        self, image: NDArray[np.uint8], *, mask: NDArray[np.uint8] | None = None
    ) -> FeatureMap:
        """Return what is found in a grey image (H, W), strongest first.

        Parameters
        ----------
        image : (H, W) uint8
        mask : (H, W) uint8, optional
            0 where nothing is wanted.
        """
        scale = self._downscale(image.size)
        small, small_mask = _shrunk(image, mask, scale) if scale > 1 else (image, mask)
        # OpenCV refuses an image from which nothing of a scale is left.
        found, descriptors = (
            self._find(small, small_mask) if min(small.shape) >= _SMALLEST else ((), None)
        )
        # Threads of OpenCV add keypoints in any order.
        order = sorted(
            range(len(found)), key=lambda i: (-found[i].response, found[i].pt, found[i].angle)
        )
        points = self._places([found[i] for i in order], small.shape)
        # The centre of a pixel of the small image lies amid the pixels that it was made of.
        points = (points + 0.5) * scale - 0.5
        np.clip(points, 0.0, [image.shape[1] - 1.0, image.shape[0] - 1.0], out=points)
        notes = (
            (f"{image.shape[1]} x {image.shape[0]} px are searched at 1/{scale} of their size "
             "(setting downscale)",)
            if scale > 1 and not getattr(self, "downscale", 1)
            else ()
        )  # fmt: skip
        return FeatureMap(
            keypoints=points,
            descriptors=None if descriptors is None else _rows(descriptors, order),
            responses=np.array([found[i].response for i in order], np.float64),
            sizes=np.array([found[i].size for i in order], np.float64) * scale,
            angles=np.array([found[i].angle for i in order], np.float64),
            octaves=np.array([found[i].octave for i in order], np.int32),
            track_sigma=predicted_sigma(image, points),
            detector_name=self.name,
            detector_config=asdict(self),  # type: ignore[call-overload]
            frame_shape=(image.shape[0], image.shape[1]),
            notes=notes,
        )

    def _downscale(self, n_pixels: int) -> int:
        asked = getattr(self, "downscale", 1)
        return asked or (2 if n_pixels > LARGE else 1)

    def _find(self, image: NDArray[np.uint8], mask: NDArray[np.uint8] | None) -> Any:
        """Return OpenCV's keypoints and the descriptors."""
        return self._create().detectAndCompute(image, mask)

    def _places(self, found: list[Any], shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return where OpenCV's keypoints lie, (N, 2) [px]."""
        return np.array([keypoint.pt for keypoint in found], np.float64).reshape(-1, 2)

    def _create(self) -> Any:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Sift(OpenCVDetector):
    """Extrema of differences of Gaussians (Lowe, DOI 10.1023/B:VISI.0000029664.99615.94).

    Parameters
    ----------
    n_features : int
        Most to keep, 0 for all.
    n_octave_layers : int
    contrast_threshold, edge_threshold : float
        A lower contrast_threshold, or a higher edge_threshold, finds more.
    sigma : float [px]
    precise_upscale : bool
        Without it, as OpenCV has it by default, all keypoints lie 1/4 px too far right and down.
    downscale : int
        1 for the full image, 2 for half its size and so on; 0: 2 above 5 million pixels, 1 below.
    """

    name: ClassVar[str] = "sift"

    n_features: int = 0
    n_octave_layers: int = 3
    contrast_threshold: float = 0.04
    edge_threshold: float = 10.0
    sigma: float = 1.6
    precise_upscale: bool = True
    downscale: int = 0

    def _create(self) -> Any:
        return load_cv2().SIFT_create(
            nfeatures=self.n_features,
            nOctaveLayers=self.n_octave_layers,
            contrastThreshold=self.contrast_threshold,
            edgeThreshold=self.edge_threshold,
            sigma=self.sigma,
            enable_precise_upscale=self.precise_upscale,
        )


@dataclass(frozen=True, kw_only=True)
class Orb(OpenCVDetector):
    """FAST corners over scales (Rublee et al., DOI 10.1109/ICCV.2011.6126544).

    Parameters
    ----------
    n_features : int
        Most to keep.
    scale_factor : float
    n_levels, edge_threshold, first_level, patch_size, fast_threshold : int
        As in OpenCV; a lower fast_threshold finds more.
    wta_k : int
        Pixels compared for an element of the descriptor: 2, 3 or 4.
    """

    name: ClassVar[str] = "orb"

    n_features: int = 500
    scale_factor: float = 1.2
    n_levels: int = 8
    edge_threshold: int = 31
    first_level: int = 0
    patch_size: int = 31
    fast_threshold: int = 20
    wta_k: int = 2

    def _places(self, found: list[Any], shape: tuple[int, ...]) -> NDArray[np.float64]:
        # OpenCV multiplies pixel numbers of the small images by their nominal scale: it forgets
        # that the sizes are rounded, and that pixel 0 of a small image lies amid several.
        size = np.array([shape[1], shape[0]], np.float64)
        level = np.array([keypoint.octave for keypoint in found], np.float64) - self.first_level
        nominal = (self.scale_factor**level)[:, None]
        real = size / np.maximum(np.rint(size / nominal), 1.0)
        return (super()._places(found, shape) / nominal + 0.5) * real - 0.5

    def _create(self) -> Any:
        return load_cv2().ORB_create(
            nfeatures=self.n_features,
            scaleFactor=self.scale_factor,
            nlevels=self.n_levels,
            edgeThreshold=self.edge_threshold,
            firstLevel=self.first_level,
            patchSize=self.patch_size,
            fastThreshold=self.fast_threshold,
            WTA_K=self.wta_k,
        )


@dataclass(frozen=True, kw_only=True)
class Akaze(OpenCVDetector):
    """Extrema in a nonlinear scale space (Alcantarilla et al., DOI 10.5244/C.27.13).

    Parameters
    ----------
    threshold : float
        A lower one finds more.
    n_octaves, n_octave_layers : int
    downscale : int
        1 for the full image, 2 for half its size and so on; 0: 2 above 5 million pixels, 1 below.
    """

    name: ClassVar[str] = "akaze"

    threshold: float = 0.001
    n_octaves: int = 4
    n_octave_layers: int = 4
    downscale: int = 0

    def _create(self) -> Any:
        return make_akaze(
            threshold=self.threshold,
            nOctaves=self.n_octaves,
            nOctaveLayers=self.n_octave_layers,
        )


@dataclass(frozen=True, kw_only=True)
class ShiTomasi(OpenCVDetector):
    """Corners by the smaller eigenvalue (Shi & Tomasi 1994, DOI 10.1109/CVPR.1994.323794).

    The eigenvalue is also what limits the precision of a track, so this is the detector of
    choice for tracking.

    Parameters
    ----------
    max_corners : int
        Most to keep, 0 for all.
    quality_level : float
        Weakest corner, as a part of the strongest one.
    min_distance : float [px]
    block_size : int [px]
        Side of the window of the eigenvalue.
    use_harris : bool
        Rank by Harris' measure instead of the eigenvalue.
    harris_k : float
    """

    name: ClassVar[str] = "gftt"

    max_corners: int = 0
    quality_level: float = 0.01
    min_distance: float = 7.0
    block_size: int = 3
    use_harris: bool = False
    harris_k: float = 0.04

    def _create(self) -> Any:
        return load_cv2().GFTTDetector_create(
            maxCorners=self.max_corners,
            qualityLevel=self.quality_level,
            minDistance=self.min_distance,
            blockSize=self.block_size,
            useHarrisDetector=self.use_harris,
            k=self.harris_k,
        )

    def _find(self, image: NDArray[np.uint8], mask: NDArray[np.uint8] | None) -> Any:
        return self._create().detect(image, mask), None


def _rows(descriptors: Any, order: list[int]) -> NDArray[Any]:
    return np.asarray(descriptors)[np.asarray(order, dtype=np.intp)]


def _shrunk(
    image: NDArray[np.uint8], mask: NDArray[np.uint8] | None, scale: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    cv2 = load_cv2()
    # Rows and columns left over are left out: a pixel of the small image is made of scale^2.
    height, width = image.shape[0] // scale, image.shape[1] // scale
    if not height or not width:
        return np.empty((height, width), np.uint8), None
    even = (slice(scale * height), slice(scale * width))
    small = cv2.resize(image[even], (width, height), interpolation=cv2.INTER_AREA)
    if mask is None:
        return small, None
    return small, cv2.resize(mask[even], (width, height), interpolation=cv2.INTER_NEAREST)
