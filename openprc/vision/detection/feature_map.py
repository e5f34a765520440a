"""What a detector found in a frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, NoFeaturesError

#: The fields that have one row a feature.
PER_FEATURE = (
    "keypoints", "descriptors", "responses", "sizes", "angles", "octaves", "track_sigma",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class FeatureMap:
    """Features of one frame, strongest first as the detector ranks them.

    Attributes
    ----------
    keypoints : (N, 2) [px]
        (0, 0) is the centre of the upper left pixel, x to the right, y down.
    descriptors : (N, D), or None where the detector describes nothing
    responses : (N,)
        Strength, on a scale of each detector's own.
    sizes : (N,) [px]
        Diameter of the neighbourhood that was looked at.
    angles : (N,) [deg]
        -1 where the detector gives none.
    octaves : (N,) int
    track_sigma : (N,) [px]
        One-sigma of a track along its worst direction, for noise of one grey level; see
        `openprc.vision.detection.trackability.predicted_sigma`. NaN where the window leaves the
        image, or where it was not computed.
    detector_name : str
    detector_config : dict
    ref_frame_index : int
    frame_shape : (H, W) [px]
    notes : tuple of str
    """

    keypoints: NDArray[np.float64]
    descriptors: NDArray[Any] | None = None
    responses: NDArray[np.float64]
    sizes: NDArray[np.float64]
    angles: NDArray[np.float64]
    octaves: NDArray[np.int32]
    track_sigma: NDArray[np.float64]
    detector_name: str
    detector_config: dict[str, Any] = field(default_factory=dict)
    ref_frame_index: int = 0
    frame_shape: tuple[int, int]
    notes: tuple[str, ...] = ()

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        *,
        frame_shape: tuple[int, ...],
        image: ArrayLike | None = None,
        ref_frame_index: int = 0,
        detector_name: str = "points",
        detector_config: dict[str, Any] | None = None,
    ) -> FeatureMap:
        """Return a map of points (N, 2) [px] that somebody chose.

        With the `image` (H, W) their trackability is computed.

        Raises
        ------
        ConfigError
            Another shape, or a point outside the frame.
        """
        places = np.array(points, dtype=np.float64)
        if places.size == 0:
            places = places.reshape(0, 2)
        if places.ndim != 2 or places.shape[1] != 2:
            raise ConfigError(
                f"points of shape {places.shape}",
                expected="(N, 2): x and y in px",
                fix="give one row for each point",
                key="points",
            )
        height, width = frame_shape[:2]
        within = (places >= 0).all(axis=1) & (places <= [width - 1, height - 1]).all(axis=1)
        if not within.all():
            worst = int(np.flatnonzero(~within)[0])
            raise ConfigError(
                f"point {worst} lies at ({places[worst, 0]:g}, {places[worst, 1]:g})",
                expected=f"x from 0 to {width - 1} and y from 0 to {height - 1} px",
                fix="leave it out; x comes first, and y points down",
                key="points",
            )
        n = len(places)
        if image is None:
            sigma = np.full(n, np.nan)
        else:
            from openprc.vision.detection.trackability import (  # noqa: PLC0415 - needs OpenCV
                predicted_sigma,
            )

            sigma = predicted_sigma(image, places)
        return cls(
            keypoints=places,
            responses=np.ones(n),
            sizes=np.full(n, 21.0),
            angles=np.full(n, -1.0),
            octaves=np.zeros(n, np.int32),
            track_sigma=sigma,
            detector_name=detector_name,
            detector_config=dict(detector_config or {}),
            ref_frame_index=ref_frame_index,
            frame_shape=(int(height), int(width)),
        )

    def __len__(self) -> int:
        return len(self.keypoints)

    @property
    def n_features(self) -> int:
        """Number of features N."""
        return len(self.keypoints)

    def select(self, chosen: ArrayLike) -> FeatureMap:
        """Return the features of a boolean mask (N,) or of indices, in that order."""
        index = np.asarray(chosen)
        if index.dtype == bool:
            if index.shape != (len(self),):
                raise ConfigError(
                    f"a mask of shape {index.shape}",
                    expected=f"({len(self)},): one value a feature",
                    fix="make the mask from this feature map",
                    key="mask",
                )
            index = np.flatnonzero(index)
        rows = {
            name: value[index] for name in PER_FEATURE if (value := getattr(self, name)) is not None
        }
        return replace(self, **rows)

    def unique(self, *, min_distance: float = 1.0) -> FeatureMap:
        """Return the features of which none is nearer than `min_distance` [px] to a better one.

        SIFT gives a place once for every orientation that it sees there; as tracks these would
        be one and the same.
        """
        return self.select(_apart(self.keypoints, min_distance))

    def top_n(
        self,
        n: int,
        *,
        by: Literal["response", "trackability"] = "response",
        min_distance: float = 1.0,
    ) -> FeatureMap:
        """Return the best `n` features, none nearer than `min_distance` [px] to a better one.

        Parameters
        ----------
        n : int
            Fewer come back where there are fewer; a note says so.
        by : "response" or "trackability"
            The strength that the detector gives, or the precision to which a track can be
            expected to be known (`track_sigma`); features whose window leaves the image come
            last then.
        min_distance : float [px]
            0 keeps everything.
        """
        if int(n) != n or n < 1:
            raise ConfigError(
                f"n is {n!r}", expected="a whole number from 1", fix="raise it", key="n"
            )
        if by == "trackability":
            rank = np.where(np.isnan(self.track_sigma), np.inf, self.track_sigma)
        elif by == "response":
            rank = -self.responses
        else:
            raise ConfigError(
                f"by is {by!r}",
                expected="'response' or 'trackability'",
                fix="choose one of these",
                key="by",
            )
        ranked = self.select(np.argsort(rank, kind="stable"))
        apart = ranked.unique(min_distance=min_distance) if min_distance > 0 else ranked
        best = apart.select(np.arange(min(int(n), len(apart))))
        if len(best) < n:
            doubles = len(self) - len(apart)
            told = f", {doubles} more lie within {min_distance:g} px of a better one"
            best = replace(
                best,
                notes=(
                    *self.notes,
                    f"{n} features were asked for and {len(best)} are there"
                    + (told if doubles else ""),
                ),
            )
        return best

    def filter_by_roi(self, x: float, y: float, width: float, height: float) -> FeatureMap:
        """Return the features within a rectangle with the upper left corner (x, y) [px]."""
        inside = (self.keypoints >= [x, y]).all(axis=1) & (
            self.keypoints <= [x + width, y + height]
        ).all(axis=1)
        return self.select(inside)

    def filter_by_mask(self, mask: ArrayLike) -> FeatureMap:
        """Return the features at whose nearest pixel the mask (H, W) is not 0."""
        allowed = np.asarray(mask)
        if allowed.shape != self.frame_shape:
            raise ConfigError(
                f"a mask of shape {allowed.shape}",
                expected=f"{self.frame_shape}, as the frame",
                fix="draw the mask over a frame of this video",
                key="mask",
            )
        x, y = np.rint(self.keypoints).astype(np.intp).T
        return self.select(allowed[y, x] != 0)

    def require(self, *, hint: str = "") -> FeatureMap:
        """Return the map itself.

        Raises
        ------
        NoFeaturesError
            It is empty.
        """
        if len(self):
            return self
        raise NoFeaturesError(
            f"the detector {self.detector_name!r} finds nothing in frame {self.ref_frame_index}"
            f"{hint}",
            expected="texture or marks that can be followed",
            fix="lower its threshold (contrast_threshold of sift, threshold of akaze, "
            "quality_level of gftt), try gftt, look at the mask, or choose another reference "
            "frame",
            key="detector",
        )


def _apart(points: NDArray[np.float64], distance: float) -> NDArray[np.bool_]:
    """Return which points (N, 2) have no earlier kept one within `distance`."""
    kept = np.ones(len(points), bool)
    if len(points) < 2 or not distance > 0:
        return kept
    from scipy.spatial import cKDTree

    # "nearer than" excludes the distance itself, which the tree includes.
    close = cKDTree(points).query_pairs(np.nextafter(distance, 0.0), output_type="ndarray")
    close.sort(axis=1)
    for first, second in close[np.lexsort((close[:, 1], close[:, 0]))]:
        if kept[first]:
            kept[second] = False
    return kept
