"""Images that are already in memory, as a source."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, VideoError
from openprc.vision.source.time_axis import check_rate, count_fault
from openprc.vision.source.video_source import VideoSource


class ArrayImages:
    """Images in memory, with their times [s]."""

    kind = "array"
    container = "array"
    path = None
    orientation = 0
    value_range: tuple[float, float] | None = None

    def __init__(
        self, images: Sequence[NDArray[Any]] | NDArray[Any], times: NDArray[np.float64], fps: float
    ) -> None:
        self._images = images
        self._times = times
        self.codec = str(getattr(images, "dtype", "images"))
        self.declared_fps = fps
        self.frame_count = len(images)
        self.notes: list[str] = []
        self.faults: list[str] = []

    def files(self) -> list[Path]:
        """Return nothing: there is no file."""
        return []

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on."""
        for k in range(start, self.frame_count):
            yield np.asarray(self._images[k]), float(self._times[k])

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""
        return count_fault(self.frame_count, decoded)


class ArraySource(VideoSource):
    """Images in memory as a `VideoSource`.

    Parameters
    ----------
    images : (T, H, W) or (T, H, W, 3) array, or iterable of images
        Colour in the order blue, green, red, as OpenCV has it. Neither arrays nor sequences are
        copied: do not change the images while the source is in use. An iterator is read to its
        end.
    fps : float [Hz], optional
    times : (T,) [s], optional
        Either this or `fps` is required.
    strict, value_range, bayer
        As for `VideoSource`.
    name : str
        For messages and provenance.

    Raises
    ------
    ConfigError
        Neither rate nor times, or both; times that do not fit the images or do not increase.
    VideoError
        No image; or a frame differs from the first in size or type.
    """

    def __init__(
        self,
        images: ArrayLike | Iterable[NDArray[Any]],
        *,
        fps: float | None = None,
        times: ArrayLike | None = None,
        strict: bool = False,
        value_range: tuple[float, float] | None = None,
        bayer: str | None = None,
        name: str = "array",
    ) -> None:
        check_rate(fps)
        # What has a length and is indexed may compute its images on demand.
        indexed = hasattr(images, "__len__") and hasattr(images, "__getitem__")
        held: Any = images if indexed else list(images)  # type: ignore[arg-type]
        if len(held) == 0:
            raise VideoError(
                "there is no image", expected="at least one", fix="check what was passed", file=name
            )
        if isinstance(held, np.ndarray) and held.ndim not in (3, 4):
            raise VideoError(
                f"the array has the shape {held.shape}",
                expected="(T, H, W) or (T, H, W, 3)",
                fix="a single image needs an axis of time: image[None]",
                file=name,
            )
        stamps, rate = _clock(len(held), fps, times, name)
        self._begin(
            ArrayImages(held, stamps, rate),
            name=name,
            fps=fps,
            strict=strict,
            value_range=value_range,
            bayer=bayer,
        )


def _clock(
    count: int, fps: float | None, times: ArrayLike | None, name: str
) -> tuple[NDArray[np.float64], float]:
    """Return the stamps [s] and the rate [Hz]."""
    if times is not None and fps is not None:
        raise ConfigError(
            "both fps and times are given",
            expected="one of the two",
            fix="leave one out",
            file=name,
            key="fps",
        )
    if times is None:
        if fps is None:
            raise ConfigError(
                "images do not say when they were taken",
                expected="the rate of the camera, or one time for each image",
                fix="pass fps= [Hz] or times= [s]",
                file=name,
                key="fps",
            )
        return np.arange(count) / fps, fps
    stamps = np.asarray(times, dtype=np.float64)
    increasing = stamps.shape == (count,) and bool(np.all(np.diff(stamps) > 0))
    if not increasing or not np.isfinite(stamps).all():
        raise ConfigError(
            f"times has the shape {stamps.shape} for {count} images, or does not increase",
            expected="one finite time [s] for each image, each later than the one before",
            fix="pass the times at which the images were taken",
            file=name,
            key="times",
        )
    return stamps, 1.0 / float(np.median(np.diff(stamps))) if count > 1 else np.nan
