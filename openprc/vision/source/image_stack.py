"""Many images in one file: TIFF pages and NumPy stacks."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, VideoError
from openprc.schema import safety
from openprc.vision.opencv import load_cv2
from openprc.vision.source.time_axis import count_fault

SUFFIXES = (".npy", ".tif", ".tiff")


class ImageStack:
    """The pages of a TIFF file, or the first axis of an array (T, H, W[, 3]) in a .npy file.

    Raises
    ------
    UnreadableFile
        Missing, empty or a directory.
    VideoError
        Not a stack of images.
    ConfigError
        No rate.
    """

    kind = "images"
    orientation = 0
    value_range: tuple[float, float] | None = None

    def __init__(self, path: Path, *, fps: float | None) -> None:
        self.path: Path | None = safety.check_readable(path)
        self._file = path
        if fps is None:
            raise ConfigError(
                "a stack of images does not say when they were taken",
                expected="the rate of the camera",
                fix="pass the option fps [Hz]",
                file=path,
                key="fps",
            )
        self.notes: list[str] = []
        self.faults: list[str] = []
        self.declared_fps = fps
        self._array: NDArray[Any] | None = None
        if path.suffix.lower() == ".npy":
            self._array = _mapped(path)
            self.container, self.codec = "NumPy", str(self._array.dtype)
            self.frame_count = len(self._array)
        else:
            self.container, self.codec = "TIFF", "tiff"
            self.frame_count = _pages(path)

    def files(self) -> list[Path]:
        """Return the file."""
        return [self._file]

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on."""
        for k in range(start, self.frame_count):
            image = self._page(k) if self._array is None else np.array(self._array[k])
            yield image, k / self.declared_fps

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""
        return count_fault(self.frame_count, decoded)

    def _page(self, k: int) -> NDArray[Any]:
        cv2 = load_cv2()
        read, pages = cv2.imreadmulti(str(self._file), start=k, count=1, flags=cv2.IMREAD_UNCHANGED)
        if not read or not pages:
            raise VideoError(
                f"page {k} of {self.frame_count} cannot be decoded",
                expected="whole pages",
                fix="copy or export the file again",
                file=self._file,
            )
        return pages[0]


def _mapped(path: Path) -> NDArray[Any]:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise VideoError(
            f"NumPy cannot read it: {error}",
            expected="an array of numbers saved with numpy.save, whole",
            fix="save or copy it again",
            file=path,
        ) from error
    if array.ndim not in (3, 4) or not len(array):
        raise VideoError(
            f"the array has the shape {array.shape}",
            expected="(T, H, W) or (T, H, W, 3)",
            fix="a single image needs an axis of time: image[None]",
            file=path,
        )
    return array


def _pages(path: Path) -> int:
    with path.open("rb") as stream:
        head = stream.read(4)
    if head[:2] not in (b"II", b"MM"):
        raise VideoError(
            f"this is not a TIFF file: it begins with {head!r}",
            expected="TIFF pages",
            fix="check the file",
            file=path,
        )
    return int(load_cv2().imcount(str(path)))
