"""Reading a video frame by frame, and finding out when each frame was taken.

Containers lie: a declared frame count can be wrong in both directions and a declared rate says
nothing about a recording with a variable one. So frames are read until there are none, and the
time of a frame is its own presentation time stamp, as far as the stamps make sense.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc.schema import safety
from openprc.vision.opencv import load_cv2


def container(path: Path) -> str | None:
    """Name the video container from the first bytes of the file, or return None."""
    with path.open("rb") as stream:
        head = stream.read(12)
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return "AVI"
    if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide"):
        return "MP4/MOV"
    if head[:4] == b"\x1aE\xdf\xa3":
        return "Matroska/WebM"
    if head[:4] in (b"\x00\x00\x01\xba", b"\x00\x00\x01\xb3"):
        return "MPEG"
    return None


@dataclass(frozen=True, slots=True)
class Video:
    """A video file and what its header claims."""

    path: Path
    container: str
    codec: str
    declared_frames: int
    declared_fps: float

    @classmethod
    def open(cls, path: Path) -> Video:
        """Read the header.

        Raises
        ------
        UnreadableFile
            Missing, empty, a folder, not one of the containers, or refused by the decoder.
        """
        path = safety.check_readable(path)
        kind = container(path)
        if kind is None:
            # A decoder that is let loose on anything would follow playlists to other files.
            with path.open("rb") as stream:
                head = stream.read(16)
            raise UnreadableFile(
                f"this is not a video: it begins with {head!r}",
                expected="an AVI, MP4, MOV, Matroska or MPEG file",
                fix="check the file, or convert it to one of these containers",
                file=path,
            )
        cv2 = load_cv2()
        capture = cv2.VideoCapture(str(path))
        try:
            if not capture.isOpened():
                raise UnreadableFile(
                    f"the {kind} container cannot be opened",
                    expected="a video that was closed properly by what recorded it",
                    fix="copy it again; an MP4 that was cut off has lost its index for good",
                    file=path,
                )
            code = int(capture.get(cv2.CAP_PROP_FOURCC))
            codec = "".join(chr(code >> shift & 0xFF) for shift in (0, 8, 16, 24)).strip("\0 ")
            frames = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            fps = float(capture.get(cv2.CAP_PROP_FPS))
        finally:
            capture.release()
        return cls(path, kind, codec or "unknown", frames, fps)

    def frames(self) -> Iterator[tuple[NDArray[np.uint8], float]]:
        """Yield every frame as grey levels (H, W) with its time stamp [ms], in order."""
        cv2 = load_cv2()
        capture = cv2.VideoCapture(str(self.path))
        try:
            while True:
                delivered, image = capture.read()
                if not delivered:
                    return
                if image.ndim == 3:
                    image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
                # Right after read() this is the stamp of the frame just delivered.
                yield image, float(capture.get(cv2.CAP_PROP_POS_MSEC))
        finally:
            capture.release()


def frame_times(
    stamps: NDArray[np.float64], declared_fps: float, *, fps: float | None = None
) -> tuple[NDArray[np.float64], str]:
    """Return the times of the frames, counted from the first, and how they were found.

    Parameters
    ----------
    stamps : (T,) [ms]
        Presentation time stamps.
    declared_fps : float [Hz]
        What the container says.
    fps : float [Hz], optional
        What the user says; it wins.

    Returns
    -------
    times : (T,) [s]
    how : str

    Raises
    ------
    ConfigError
        When neither the stamps nor the declared rate can be used.
    """
    index = np.arange(len(stamps))
    if fps is not None:
        return index / fps, f"frame times are index / {fps:g} Hz as asked (option fps)"
    usable = np.isfinite(declared_fps) and declared_fps > 0
    increasing = bool(np.isfinite(stamps).all() and np.all(np.diff(stamps) > 0))
    if not increasing:
        if not usable:
            raise ConfigError(
                f"the time stamps do not increase and the declared rate is {declared_fps}",
                expected="the rate at which the camera recorded",
                fix="pass the option fps",
                key="fps",
            )
        return index / declared_fps, (
            "the time stamps of the container do not increase; frame times are index / "
            f"{declared_fps:g} Hz, the declared rate"
        )
    relative = stamps - stamps[0]
    whole = np.abs(stamps - np.round(stamps)).max() < 1e-6
    if usable and whole:
        # Matroska stores whole milliseconds, which makes a constant rate look uneven.
        deviation = np.abs(relative - 1e3 * index / declared_fps).max()
        if deviation <= min(1.0, 400.0 / declared_fps):
            return index / declared_fps, (
                f"the time stamps are those of {declared_fps:g} Hz rounded to 1 ms; frame "
                "times are index / rate"
            )
    return relative / 1e3, "frame times are the time stamps of the container"
