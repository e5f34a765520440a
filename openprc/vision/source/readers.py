"""Where the frames of a recording are kept, and the reader for each kind of storage."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from openprc.vision.source import image_stack, raw_recording
from openprc.vision.source.image_sequence import ImageSequence, find_images
from openprc.vision.source.video_file import VideoFile


class Reader(Protocol):
    """What a kind of storage has to offer; `notes` inform, `faults` are damage."""

    kind: str
    container: str
    codec: str
    declared_fps: float
    frame_count: int
    orientation: int
    value_range: tuple[float, float] | None
    notes: list[str]
    faults: list[str]

    @property
    def path(self) -> Path | None:
        """The file or folder, None for images in memory."""

    def files(self) -> list[Path]:
        """Return the files that hold the recording; none for images in memory."""

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on, in order."""

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""


def open_reader(path: str | Path | Sequence[str | Path], *, fps: float | None) -> Reader:
    """Return the reader for a path, by what stands there, or for a list of images."""
    if not isinstance(path, str | Path):
        listed = [Path(name) for name in path]
        folder = listed[0].parent if listed else Path()
        return ImageSequence(listed, folder=folder, fps=fps, ordered=True)
    path = Path(path)
    images = find_images(path)
    if images is not None:
        return ImageSequence(images, folder=path, fps=fps)
    if path.suffix.lower() in raw_recording.SUFFIXES:
        return raw_recording.RawRecording(path)
    if path.suffix.lower() in image_stack.SUFFIXES:
        return image_stack.ImageStack(path, fps=fps)
    return VideoFile(path)
