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

    def __post_init__(self) -> None:
        if np.ndim(self.keypoints) != 2 or np.shape(self.keypoints)[1] != 2:
            raise ConfigError(
                f"keypoints of shape {np.shape(self.keypoints)}",
                expected="(N, 2): x and y in px",
                fix="give one row for each feature",
                key="keypoints",
            )
        for name in PER_FEATURE:
            value = getattr(self, name)
            if value is not None and len(value) != len(self.keypoints):
                raise ConfigError(
                    f"{name} has {len(value)} rows for {len(self.keypoints)} keypoints",
                    expected="one row for each feature",
                    fix="see FeatureMap.from_points, which needs the keypoints alone",
                    key=name,
                )

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        *,
        frame_shape: tuple[int, ...],
        image: ArrayLike | None = None,
        responses: ArrayLike | None = None,
        descriptors: ArrayLike | None = None,
        ref_frame_index: int = 0,
        detector_name: str = "points",
        detector_config: dict[str, Any] | None = None,
    ) -> FeatureMap:
        """Return a map of points that somebody chose, or that a detector of one's own found.

        Parameters
        ----------
        points : (N, 2) [px]
        frame_shape : (H, W) [px]
        image : (H, W) or colour, optional
            The frame; with it the features can be ranked by trackability.
        responses : (N,), optional
            Strength of the points; 1 where left out.
        descriptors : (N, D), optional
        ref_frame_index : int
        detector_name : str
        detector_config : dict, optional

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
        made = cls(
            keypoints=places,
            descriptors=None if descriptors is None else np.asarray(descriptors),
            responses=np.ones(n) if responses is None else np.array(responses, np.float64),
            sizes=np.full(n, 21.0),
            angles=np.full(n, -1.0),
            octaves=np.zeros(n, np.int32),
            track_sigma=np.full(n, np.nan),
            detector_name=detector_name,
            detector_config=dict(detector_config or {}),
            ref_frame_index=ref_frame_index,
            frame_shape=(int(height), int(width)),
        )
        return made if image is None else made.rated(image)

    def __len__(self) -> int:
        return len(self.keypoints)

    @property
    def n_features(self) -> int:
        """Number of features N."""
        return len(self.keypoints)

    def rated(self, image: ArrayLike, *, window: int = 21) -> FeatureMap:
        """Return the map with `track_sigma` computed from its frame, for a window [px].

        Raises
        ------
        ConfigError
            The image has another size, or the window is no odd number.
        """
        # Both need OpenCV, and this module is imported without it.
        from openprc.vision.detection.images import grey_image  # noqa: PLC0415
        from openprc.vision.detection.trackability import predicted_sigma  # noqa: PLC0415

        grey, _ = grey_image(image)
        if grey.shape != self.frame_shape:
            raise ConfigError(
                f"an image of {grey.shape[1]} x {grey.shape[0]} px",
                expected=f"{self.frame_shape[1]} x {self.frame_shape[0]} px, as the frame has",
                fix="pass the frame that the features were found in",
                key="image",
            )
        sigma = predicted_sigma(grey, self.keypoints, window=window)
        return replace(self, track_sigma=sigma)

    def trackability(self, *, noise: float = 1.0, image_noise: float = 0.0) -> NDArray[np.float64]:
        """Return the one-sigma of a track that is to be expected, (N,) [px], worst direction.

        Parameters
        ----------
        noise : float
            One-sigma of the noise in the video [grey levels].
        image_noise : float
            One-sigma of the noise in the frame that the features were found in; it passes for
            texture unless its share is taken off [grey levels]. For a window of 21 px.

        Returns
        -------
        (N,) [px]
            NaN where the window leaves the frame, infinite where nothing can be followed. See
            `openprc.vision.detection.trackability.predicted_sigma` for the formula.
        """
        from openprc.vision.detection import trackability  # noqa: PLC0415 - needs OpenCV

        return trackability.sigma_of(
            trackability.information_of(self.track_sigma),
            window=trackability.WINDOW,
            noise=noise,
            image_noise=image_noise,
        )

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
        elif index.size == 0:
            index = np.zeros(0, np.intp)
        whole = index.ndim == 1 and index.dtype.kind in "iu"
        if not whole or (index.size and not -len(self) <= index.min() <= index.max() < len(self)):
            raise ConfigError(
                f"{index.size} indices of the type {index.dtype} were given",
                expected=f"whole numbers below {len(self)}, or one True or False a feature",
                fix="choose from this feature map",
                key="chosen",
            )
        rows = {
            name: value[index] for name in PER_FEATURE if (value := getattr(self, name)) is not None
        }
        return replace(self, **rows)

    def unique(self, *, min_distance: float = 1.0) -> FeatureMap:
        """Return the features of which none is nearer than `min_distance` [px] to a better one.

        SIFT gives a place once for every orientation that it sees there; as tracks these would
        be one and the same.
        """
        return self.select(_apart(self.keypoints, min_distance, most=len(self)))

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
        if not isinstance(n, int | np.integer) or n < 1:
            raise ConfigError(
                f"n is {n!r}", expected="a whole number from 1", fix="raise it", key="n"
            )
        if not min_distance >= 0:
            raise ConfigError(
                f"min_distance is {min_distance!r}",
                expected="a distance in px, 0 or more",
                fix="leave it out, or take half the window of the tracker",
                key="min_distance",
            )
        if by == "trackability":
            if len(self) and np.isnan(self.track_sigma).all():
                raise ConfigError(
                    "no feature has a trackability: it was not computed, or every window leaves "
                    "the frame",
                    expected="features that were rated",
                    fix="call rated(image) with the frame first, or rank by='response'",
                    key="by",
                )
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
        best = ranked.select(_apart(ranked.keypoints, min_distance, most=int(n)))
        if len(best) < n:
            doubles = len(self) - len(best)
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
        from openprc.vision.detection.images import mask_image  # noqa: PLC0415 - light

        allowed = mask_image(mask, self.frame_shape)
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


def _apart(points: NDArray[np.float64], distance: float, *, most: int) -> NDArray[np.intp]:
    """Return the first `most` points (N, 2) that have no earlier kept one within `distance`."""
    if not distance > 0:
        return np.arange(min(most, len(points)))
    # Only kept points of the neighbouring squares can be too near; they are few, whatever the
    # distance, so neither time nor memory grows with the pairs of points.
    kept: list[int] = []
    squares: dict[tuple[int, int], list[tuple[float, float]]] = {}
    limit = distance * distance
    for i, (x, y) in enumerate(points.tolist()):
        column, row = int(x // distance), int(y // distance)
        near = (
            other
            for a in (column - 1, column, column + 1)
            for b in (row - 1, row, row + 1)
            for other in squares.get((a, b), ())
        )
        if any((x - u) ** 2 + (y - v) ** 2 < limit for u, v in near):
            continue
        squares.setdefault((column, row), []).append((x, y))
        kept.append(i)
        if len(kept) == most:
            break
    return np.array(kept, dtype=np.intp)
