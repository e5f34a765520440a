"""A clip as a video file, and the proof that it arrived."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from zlib import crc32

from openprc.errors import UnreadableFile
from openprc.schema import atomic
from openprc.vision.opencv import load_cv2

if TYPE_CHECKING:
    from openprc.vision.synth.clip import Scene

#: Codecs whose frames come back as they were given, all of them grey.
LOSSLESS = ("FFV1",)


def write_clip(
    clip: Scene, path: str | Path, *, codec: str = "FFV1", fps: float = 30.0, overwrite: bool = True
) -> Path:
    """Write a clip, grey, and check it by reading it back.

    OpenCV drops frames without a word when it cannot write them, so the file is read again:
    the number of frames must agree and, for a lossless codec, every grey level.

    Parameters
    ----------
    clip : Scene
    path : path-like
        FFV1 needs ``.avi`` or ``.mkv``, mp4v ``.mp4``, MJPG ``.avi``.
    codec : str
        Four characters.
    fps : float [Hz]
    overwrite : bool
        Replace a file of this name.

    Raises
    ------
    UnreadableFile
        When OpenCV cannot write the video, or what it wrote differs.
    ResultExists
        When the file exists and `overwrite` is false.
    """
    cv2 = load_cv2()
    path = Path(path)
    if not overwrite:
        atomic.refuse_existing(path)
    if clip.shape[0] % 2 or clip.shape[1] % 2:
        raise _refused(
            path, codec, f"OpenCV would crop {clip.shape[1]} x {clip.shape[0]} px to even numbers"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix decides the container, so it stays at the end.
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    size = clip.shape[::-1]
    grey = codec in LOSSLESS
    written: list[int] = []
    try:
        writer = cv2.VideoWriter(
            str(partial), cv2.VideoWriter.fourcc(*codec), fps, size, isColor=not grey
        )
        try:
            if not writer.isOpened():
                raise _refused(path, codec, "OpenCV cannot open it for writing")
            for image in clip.frames():
                written.append(crc32(image.tobytes()))
                writer.write(image if grey else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        finally:
            writer.release()
        _check(written, partial, path, codec=codec)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


def _check(written: list[int], partial: Path, path: Path, *, codec: str) -> None:
    cv2 = load_cv2()
    capture = cv2.VideoCapture(str(partial))
    n_read = 0
    try:
        while True:
            delivered, image = capture.read()
            if not delivered:
                break
            if codec in LOSSLESS:
                plane = image if image.ndim == 2 else image[..., 0]
                if n_read >= len(written) or crc32(plane.tobytes()) != written[n_read]:
                    raise _refused(path, codec, f"frame {n_read} reads back differently")
            n_read += 1
    finally:
        capture.release()
    if n_read != len(written):
        raise _refused(path, codec, f"{n_read} of {len(written)} frames read back")


def _refused(path: Path, codec: str, what: str) -> UnreadableFile:
    return UnreadableFile(
        f"the video was not written: {what} (codec {codec})",
        expected="an even width and height, and a codec and container that this build of OpenCV "
        "can write",
        fix="change the shape, or use FFV1 in .avi, mp4v in .mp4 or MJPG in .avi",
        file=path,
    )
