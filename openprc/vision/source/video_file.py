"""Decoding a video file with OpenCV, which ends in silence when it meets damage."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import VideoError
from openprc.vision.opencv import load_cv2
from openprc.vision.source.containers import check_video, fourcc, why_not_opened

#: More frames than this are taken for a broken header.
_HUGE = 2**31 - 1


class VideoFile:
    """A video file and what its header claims.

    Raises
    ------
    UnreadableFile
        Missing, a directory, or empty.
    VideoError
        Not a video, refused by the decoder, or without a frame.
    """

    kind = "video"
    value_range = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.faults: list[str] = []
        self.container = check_video(path)
        cv2 = load_cv2()
        capture = self._open()
        try:
            self.codec = fourcc(int(capture.get(cv2.CAP_PROP_FOURCC)))
            pixels = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT))
            declared = capture.get(cv2.CAP_PROP_FRAME_COUNT)
            self.declared_fps = float(capture.get(cv2.CAP_PROP_FPS))
            self.orientation = int(capture.get(cv2.CAP_PROP_ORIENTATION_META))
        finally:
            capture.release()
        self.frame_count = int(declared) if 0 < declared < _HUGE else 0
        if self.frame_count == 0:
            self.faults.append(f"the container declares {declared:g} frames, which is no count")
        self.deep = pixels in _GREY16
        if self.orientation:
            self.notes.append(
                f"the container asks for a rotation by {self.orientation} degrees; the frames are "
                "delivered rotated"
            )

    def _open(self) -> Any:
        cv2 = load_cv2()
        capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            capture.release()
            raise why_not_opened(self.path, self.container)
        return capture

    def _opened(self) -> Any:
        cv2 = load_cv2()
        capture = self._open()
        if self.deep:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        return capture

    def images(self, *, start: int = 0) -> Iterator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on, in the order of decoding.

        Frames before `start` are decoded and dropped: a seek can land beside the frame.
        """
        cv2 = load_cv2()
        capture = self._opened()
        try:
            for _ in range(start):
                if not capture.grab():
                    return
            while True:
                delivered, image = capture.read()
                if not delivered:
                    return
                # Right after read() this is the stamp of the frame just delivered.
                yield image, float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        finally:
            capture.release()

    def files(self) -> list[Path]:
        """Return the file."""
        return [self.path]

    def no_frame(self) -> VideoError:
        """Return the error for a file that opens and delivers nothing."""
        import cv2  # noqa: PLC0415, TID253 - loaded by now; its version is named

        fix = "convert it, for example to FFV1 or H.264"
        if self.codec.upper() == "AV01":
            fix += (
                "; or install another wheel: opencv-python-headless 4.14 decodes AV1, "
                "version 5.0 does not"
            )
        else:
            fix += ", or install another version of the wheel opencv-python-headless"
        return VideoError(
            f"the {self.container} video (codec {self.codec}) opens but delivers no frame with "
            f"OpenCV {cv2.__version__}; it declares {self.frame_count}",
            expected="frames that the installed OpenCV can decode",
            fix=fix,
            file=self.path,
        )


#: Pixel format codes of 16-bit grey, little and big endian: "Y1" with the depth behind.
_GREY16 = frozenset(
    int.from_bytes(bytes(code), "little") for code in (b"Y1\x00\x10", b"\x10\x00\x31\x59")
)
