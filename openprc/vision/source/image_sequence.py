"""A recording kept as one image file for each frame."""

from __future__ import annotations

import re
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile, VideoError
from openprc.vision.opencv import load_cv2
from openprc.vision.source.file_numbers import order_files
from openprc.vision.source.time_axis import count_fault, counted

#: Suffixes of image files that OpenCV reads without further libraries.
SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".jp2", ".pgm", ".ppm", ".webp")
_PRINTF = re.compile(r"%(0?)(\d*)d")


class ImageSequence:
    """Image files in the order of their numbers.

    Parameters
    ----------
    paths : sequence of Path
        One file for each frame, in any order, or in the right one with ``ordered``.
    folder : Path
        For messages.
    fps : float [Hz], optional
        Images do not say when they were taken: required.

    Raises
    ------
    UnreadableFile
        No image.
    VideoError
        Several sequences, or two files of one number.
    ConfigError
        No rate.
    """

    kind = "images"
    orientation = 0
    value_range: tuple[float, float] | None = None

    def __init__(
        self,
        paths: Sequence[Path],
        *,
        folder: Path,
        fps: float | None,
        ordered: bool = False,
    ) -> None:
        if not paths:
            raise UnreadableFile(
                "there is no image",
                expected="numbered images: " + " ".join(SUFFIXES),
                fix="check the name; a video is given by its file, not by its folder",
                file=folder,
            )
        if fps is None:
            raise ConfigError(
                "images do not say when they were taken",
                expected="the rate of the camera",
                fix="pass the option fps [Hz]",
                file=folder,
                key="fps",
            )
        self.path: Path | None = folder
        self.notes: list[str] = []
        self.faults: list[str] = []
        places: Sequence[int] = range(len(paths))
        if not ordered:
            numbered = order_files(paths, folder=folder)
            paths, places = numbered.paths, numbered.places
            self.notes += numbered.notes
            if numbered.missing:
                listed = ", ".join((*numbered.missing[:5], "...")[: len(numbered.missing)])
                self.faults.append(
                    f"{counted(len(numbered.missing), 'number')} missing in the names of the "
                    f"images ({listed}); the times leave room"
                )
        self._paths = list(paths)
        self._stamps = np.asarray(places, dtype=np.float64) / fps
        self.container = "images"
        self.codec = self._paths[0].suffix.lower().lstrip(".")
        self.declared_fps = fps
        self.frame_count = len(self._paths)

    def files(self) -> list[Path]:
        """Return the files in order."""
        return self._paths

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on."""
        for k in range(start, self.frame_count):
            yield read_image(self._paths[k], index=k), float(self._stamps[k])

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""
        return count_fault(self.frame_count, decoded)


def read_image(path: Path, *, index: int) -> NDArray[Any]:
    """Read one image file in its own depth and number of channels.

    Raises
    ------
    VideoError
        Missing, empty, cut off or not an image.
    """
    cv2 = load_cv2()
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise VideoError(
            f"frame {index} cannot be read: {error.strerror or error}",
            expected="an image file",
            fix="check that the file is there and may be read",
            file=path,
        ) from error
    # Through memory, because imread does not take every name on every system.
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if image is None:
        raise VideoError(
            f"frame {index} is not an image that can be decoded ({len(data)} bytes)",
            expected="a whole image file",
            fix="copy or export it again",
            file=path,
        )
    return image


def find_images(path: Path) -> list[Path] | None:
    """Return the images that a folder or a pattern stands for; None where it is neither."""
    if path.is_dir():
        return [
            file
            for file in path.iterdir()
            if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
        ]
    if path.exists():
        return None
    if _PRINTF.search(path.name):
        return _matching(path)
    if "*" in path.name or "?" in path.name:
        return [file for file in path.parent.glob(path.name) if file.is_file()]
    return None


def _matching(path: Path) -> list[Path]:
    """Return the files that a pattern such as img_%04d.png stands for."""
    found = _PRINTF.search(path.name)
    if found is None or not path.parent.is_dir():
        return []
    width = int(found[2] or 0)
    digits = rf"\d{{{width},}}" if width else r"\d+"
    before, after = path.name[: found.start()], path.name[found.end() :]
    names = re.compile(re.escape(before) + digits + re.escape(after))
    return [file for file in path.parent.iterdir() if names.fullmatch(file.name)]
