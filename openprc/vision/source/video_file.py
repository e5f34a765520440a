"""Decoding a video file with OpenCV, which ends in silence when it meets damage."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import VideoError
from openprc.vision.opencv import load_cv2
from openprc.vision.source.avi_index import read_index
from openprc.vision.source.containers import check_video, cut_index, fourcc, why_not_opened
from openprc.vision.source.stored_size import CODECS, LASTING, SizeWatch
from openprc.vision.source.time_axis import count_fault, counted

#: More frames than this are taken for a broken header.
_HUGE = 2**31 - 1
#: How often at least and at most a decoder that delivers nothing is asked again.
_PATIENCE = (16, 100_000)
#: Pixel format code of 16-bit grey, the one deep format that OpenCV hands out as it is.
_GREY16 = b"Y1\x00\x10"


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
    value_range: tuple[float, float] | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.faults: list[str] = []
        self.container = check_video(path)
        cv2 = load_cv2()
        capture = self._open()
        try:
            self.codec = fourcc(int(capture.get(cv2.CAP_PROP_FOURCC)))
            # Unknown is -1, of which the lowest four bytes make no format.
            code = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
            pixels = code.to_bytes(4, "little")
            declared = capture.get(cv2.CAP_PROP_FRAME_COUNT)
            self.declared_fps = float(capture.get(cv2.CAP_PROP_FPS))
            self.orientation = int(capture.get(cv2.CAP_PROP_ORIENTATION_META))
        finally:
            capture.release()
        self.frame_count = int(declared) if 0 < declared < _HUGE else 0
        if self.frame_count == 0:
            self.faults.append(f"the container declares {declared:g} frames, which is no count")
        # Grey is taken as it is stored; colour is converted by the decoder.
        self._plain = pixels in (_GREY16, b"Y800")
        depth = _depth(pixels)
        if depth > 8 and not self._plain:
            self.notes.append(f"OpenCV reduces the {depth}-bit pixels of this video to 8 bit")
        self.failed = self.odd = 0
        self._avi = read_index(path) if self.container == "AVI" else None
        # Files beyond 1 GiB have an index for each part: this one has to cover all frames.
        if self._avi and (not self._avi.lost or self._avi.total != self.frame_count):
            self._avi = None
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

    def images(self, *, start: int = 0) -> Generator[tuple[NDArray[Any], float]]:
        """Yield image and stamp [s] from frame `start` on, in the order of decoding.

        Frames before `start` are decoded and dropped: a seek can land beside the frame.
        """
        cv2 = load_cv2()
        capture = self._open()
        if self._plain:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        watch = SizeWatch(self.path) if self.codec.upper() in CODECS else None
        decoded, failed, gone, latest = 0, 0, 0, 0.0
        try:
            while True:
                # A failure is not the end: behind damaged frames there may be good ones.
                if not capture.grab():
                    failed += 1
                    least, most = _PATIENCE
                    if failed > max(least, min(most, self.frame_count - decoded)):
                        self.failed = gone
                        return
                    continue
                if watch is not None:
                    self._check_size(watch, decoded)
                if decoded < start:
                    decoded += 1
                    continue
                delivered, image = capture.retrieve()
                if not delivered:
                    continue
                gone, failed, decoded = gone + failed, 0, decoded + 1
                # Right after a frame is taken this is its own stamp.
                stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
                # MPEG program streams have frames without one, and 0 is reported for them.
                latest = max(latest, stamp)
                yield image, self._placed(stamp) if stamp or not latest else np.nan
        finally:
            capture.release()
            if watch is not None:
                self.odd = max(self.odd, watch.odd)
                watch.release()

    def _check_size(self, watch: SizeWatch, index: int) -> None:
        sizes = watch.changed()
        if sizes is not None:
            (width, height), (now_width, now_height) = sizes
            raise VideoError(
                f"the size changes from {width} x {height} to {now_width} x {now_height} px at "
                f"about frame {max(0, index - LASTING + 1)}; OpenCV would scale all later frames "
                "and not say so",
                expected="one size in the whole clip",
                fix="split the recording where it changes",
                file=self.path,
            )

    def _placed(self, stamp: float) -> float:
        """Return the stamp of a frame, put right where the index knows of lost frames."""
        if self._avi is None or not (np.isfinite(self.declared_fps) and self.declared_fps > 0):
            return stamp
        place = round(stamp * self.declared_fps)
        if not 0 <= place < len(self._avi.present):
            return stamp
        return float(self._avi.present[place] / self.declared_fps)

    def ended(self, decoded: int) -> list[str]:
        """Return what turned out to be wrong when `decoded` frames had been read."""
        faults = count_fault(self.frame_count, decoded)
        if self.failed:
            faults.append(
                f"{counted(self.failed, 'time')} the decoder stopped at damage and was made to "
                "go on"
            )
        if self.odd:
            faults.append(f"{counted(self.odd, 'picture')} of another size than the first: damaged")
        if self._avi is not None:
            lost = self._avi.lost
            faults.append(
                f"the index of the file lists {counted(len(lost), 'destroyed frame')}, from number "
                f"{lost[0]} on; the time stamps leave room"
            )
        return faults

    def files(self) -> list[Path]:
        """Return the file."""
        return [self.path]

    def no_frame(self) -> VideoError:
        """Return the error for a file that opens and delivers nothing."""
        if self.container == "MP4/MOV" and cut_index(self.path):
            return why_not_opened(self.path, self.container)
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
            f"OpenCV {load_cv2().__version__}; it declares {self.frame_count}",
            expected="frames that the installed OpenCV can decode",
            fix=fix,
            file=self.path,
        )


def _depth(pixels: bytes) -> int:
    """Return the bits per sample that a pixel format code such as Y3\\x0b\\x0a tells; else 8."""
    for code in (pixels, pixels[::-1]):
        if code[:1] == b"Y" and code[1:2] in b"1234" and 8 < code[3] <= 16:
            return code[3]
        if code[0] in (48, 64) and code[1:3] in (b"RG", b"BG"):
            return 16
    return 8
