"""A video of what was tracked: points by status, their trails, and how many are found."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, VideoError
from openprc.schema import atomic
from openprc.vision.opencv import load_cv2
from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.vision.source.video_source import VideoSource
    from openprc.vision.tracking.result import TrackingResult

#: Suffix to the codec that every wheel of OpenCV can write there.
CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".avi": "MJPG", ".mkv": "MJPG",
          ".webm": "VP80"}  # fmt: skip
#: Blue, green, red: told apart with any common colour blindness (Okabe and Ito 2008).
COLOURS = {
    Status.TRACKED: (115, 158, 0),
    Status.REFERENCE: (115, 158, 0),
    Status.INTERPOLATED: (233, 180, 86),
    Status.DRIFT: (66, 228, 240),
    Status.LOST: (0, 94, 213),
    Status.OOB: (167, 121, 204),
}
#: Frames that a trail is long, and that a lost point is still shown where it was last seen.
TRAIL, FADE = 25, 10
_BAR = 26
_LARGEST, _SMALLEST = 1600, 800


def annotate_video(
    source: VideoSource,
    result: TrackingResult,
    path: str | Path,
    *,
    overwrite: bool = False,
    trail: int = TRAIL,
    labels: bool | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> Path:
    """Write the video again with what was tracked drawn over it.

    Every point carries its number and a trail of where it was. Green was found, orange lost,
    pink left the image, yellow failed a check, and these are drawn as crosses where they were
    last seen. The bar at the bottom shows how many points are found in the frame.

    Parameters
    ----------
    source : VideoSource
    result : TrackingResult
        Of this source; a run that was cut short is drawn as far as it goes.
    path : path-like
        The suffix chooses the codec: ``.mp4``, ``.avi``, ``.mkv``, ``.webm``.
    overwrite : bool
    trail : int
        Frames of the trail.
    labels : bool, optional
        Draw numbers; by default where there are no more than 150 points.
    progress : callable, optional
        Called with the frames done and in all.

    Raises
    ------
    ConfigError
        The suffix is none that can be written, or result and source do not belong together.
    ResultExists
        `path` exists and `overwrite` is false.
    VideoError
        OpenCV does not write the video, or reads back another number of frames.
    """
    path = Path(path)
    codec = codec_of(path)
    if not overwrite:
        atomic.refuse_existing(path)
    height, width = source.shape
    scale = _scale(width, height)
    # Encoders crop odd sizes or refuse them.
    size = (2 * round(width * scale / 2), 2 * round(height * scale / 2) + _BAR)
    rate = float(np.clip(source.fps if np.isfinite(source.fps) else 30.0, 1.0, 60.0))
    painter = _Painter(result, scale, size, trail=trail, labels=labels)
    with _video(path, codec, rate, size) as (write, temporary):
        for frame in source.frames():
            if frame.index >= result.n_frames:
                break
            write(painter.paint(frame.grey, frame.index))
            if progress is not None:
                progress(frame.index + 1, result.n_frames)
        if painter.done != result.n_frames:
            raise ConfigError(
                f"the tracks have {result.n_frames} frames, the video {painter.done}",
                expected="tracks of this video",
                fix="pass the source that was tracked",
                file=path,
                key="result",
            )
        _close_and_check(write, temporary, painter.done, path=path)
    return path


def codec_of(path: Path) -> str:
    """Return the codec for a file name.

    Raises
    ------
    ConfigError
    """
    codec = CODECS.get(Path(path).suffix.lower())
    if codec is None:
        raise ConfigError(
            f"a video cannot be named {Path(path).name!r}",
            expected="a name that ends in " + " ".join(CODECS),
            fix="choose .mp4 or .avi",
            file=path,
            key="annotate",
        )
    return codec


def _scale(width: int, height: int) -> float:
    largest = max(width, height)
    if largest > _LARGEST:
        return _LARGEST / largest
    # Numbers on a small image would hide it.
    return float(max(1, -(-_SMALLEST // largest))) if largest < _SMALLEST else 1.0


class _Painter:
    """Draws one frame after the other."""

    def __init__(
        self,
        result: TrackingResult,
        scale: float,
        size: tuple[int, int],
        *,
        trail: int,
        labels: bool | None,
    ) -> None:
        self._result = result
        self._scale = scale
        self._size = size
        self._labels = result.n_features <= 150 if labels is None else labels
        self._trail: deque[NDArray[np.float64]] = deque(maxlen=trail + 1)
        self._last = np.full((result.n_features, 2), np.nan)
        self._age = np.full(result.n_features, FADE + 1)
        self.done = 0

    def paint(self, grey: NDArray[np.uint8], index: int) -> NDArray[np.uint8]:
        """Return the picture of a frame, (H, W, 3)."""
        cv2 = load_cv2()
        width, height = self._size
        kind = cv2.INTER_AREA if self._scale < 1 else cv2.INTER_CUBIC
        image = cv2.resize(grey, (width, height - _BAR), interpolation=kind)
        # A little paler, so that colours stand out on black and on white.
        image = cv2.cvtColor((0.75 * image + 40).astype(np.uint8), cv2.COLOR_GRAY2BGR)
        places = self._scaled(np.asarray(self._result.positions[index]))
        status = np.asarray(self._result.status[index])
        seen = np.isfinite(places).all(axis=1)
        self._last[seen] = places[seen]
        self._age = np.where(seen, 0, self._age + 1)
        self._trail.append(places)
        self._trails(image)
        for point in np.flatnonzero(self._age <= FADE):
            self._mark(image, int(point), int(status[point]), found=bool(seen[point]))
        self.done = index + 1
        return self._with_bar(image, index, status)

    def _scaled(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        # The corner of the image stays where it is, not the centre of its first pixel.
        return (places + 0.5) * self._scale - 0.5

    def _trails(self, image: NDArray[np.uint8]) -> None:
        cv2 = load_cv2()
        steps = list(self._trail)
        for count, (before, after) in enumerate(pairwise(steps)):
            share = (count + 1) / len(steps)
            mixed = (1 - share) * np.array((60, 60, 60)) + share * np.array((255, 190, 40))
            colour = tuple(int(c) for c in mixed)
            both = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
            ends = np.rint(np.stack([before[both], after[both]], axis=1) * 8).astype(np.int32)
            if len(ends):
                cv2.polylines(image, list(ends), False, colour, 1, cv2.LINE_AA, 3)

    def _mark(self, image: NDArray[np.uint8], point: int, status: int, *, found: bool) -> None:
        cv2 = load_cv2()
        colour = COLOURS.get(Status(status), (128, 128, 128))
        x, y = (int(v) for v in np.rint(self._last[point] * 8))
        if found:
            cv2.circle(image, (x, y), 8 * 4, (255, 255, 255), 2, cv2.LINE_AA, 3)
            cv2.circle(image, (x, y), 8 * 4, colour, 1, cv2.LINE_AA, 3)
            cv2.circle(image, (x, y), 8, colour, -1, cv2.LINE_AA, 3)
        else:
            place = (x // 8, y // 8)
            cv2.drawMarker(image, place, colour, cv2.MARKER_TILTED_CROSS, 8, 2, cv2.LINE_AA)
        if self._labels:
            text = str(int(self._result.feature_ids[point]))
            _text(image, text, (x // 8 + 6, y // 8 - 4), 0.33, colour)

    def _with_bar(
        self, image: NDArray[np.uint8], index: int, status: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        cv2 = load_cv2()
        width = image.shape[1]
        bar = np.full((_BAR, width, 3), 30, np.uint8)
        found = np.isin(status, (Status.TRACKED, Status.REFERENCE))
        share = float(found.mean()) if len(found) else 0.0
        failed = ((status == code, code) for code in (Status.DRIFT, Status.OOB, Status.LOST))
        left = 0.0
        for members, code in ((found, Status.TRACKED), *failed):
            right = left + float(members.mean()) * width if len(members) else left
            if right > left:
                corner = (round(right) - 1, _BAR - 1)
                cv2.rectangle(bar, (round(left), _BAR - 5), corner, COLOURS[code], -1)
            left = right
        time = float(self._result.timestamps[index])
        words = (
            f"frame {index}   {time:.4g} s   found {int(found.sum())}/{len(found)} "
            f"({100 * share:.0f} %)"
        )
        counts = "".join(
            f"   {name} {int((status == code).sum())}"
            for name, code in (("lost", Status.LOST), ("out", Status.OOB), ("drift", Status.DRIFT))
            if (status == code).any()
        )
        # Of a narrow picture the counts are what can be done without.
        size = 0.42
        room = width - 8
        while words and cv2.getTextSize(words + counts, 0, size, 1)[0][0] > room and size > 0.3:
            size -= 0.03
        if cv2.getTextSize(words + counts, 0, size, 1)[0][0] > room:
            counts = ""
        cv2.putText(bar, words + counts, (4, 15), 0, size, (235, 235, 235), 1, cv2.LINE_AA)
        joined: NDArray[np.uint8] = np.vstack([image, bar])
        return joined


def _text(
    image: NDArray[np.uint8], text: str, place: tuple[int, int], size: float, colour: Any
) -> None:
    cv2 = load_cv2()
    # A dark rim keeps numbers legible on any texture.
    cv2.putText(image, text, place, 0, size, (20, 20, 20), 2, cv2.LINE_AA)
    light = tuple(int(127 + c / 2) for c in colour)
    cv2.putText(image, text, place, 0, size, light, 1, cv2.LINE_AA)


class _Writer:
    """A video that is being written; called with every picture."""

    def __init__(self, path: Path, codec: str, rate: float, size: tuple[int, int]) -> None:
        cv2 = load_cv2()
        self._writer = cv2.VideoWriter(
            str(path), cv2.VideoWriter.fourcc(*codec), rate, size, isColor=True
        )
        self.opened = bool(self._writer.isOpened())

    def __call__(self, image: NDArray[np.uint8]) -> None:
        self._writer.write(image)

    def close(self) -> None:
        self._writer.release()


@contextmanager
def _video(
    path: Path, codec: str, rate: float, size: tuple[int, int]
) -> Iterator[tuple[_Writer, Path]]:
    """Give a writer to a temporary name; publish it when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # OpenCV chooses the container by the suffix, so that stays at the end.
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    writer = _Writer(temporary, codec, rate, size)
    try:
        if not writer.opened:
            raise _not_written(path, codec, "OpenCV cannot open it for writing")
        yield writer, temporary
        atomic.publish(temporary, path)
    finally:
        writer.close()
        with suppress(FileNotFoundError):
            temporary.unlink()


def _close_and_check(writer: _Writer, temporary: Path, count: int, *, path: Path) -> None:
    # OpenCV drops frames that it cannot write without a word: only reading tells.
    writer.close()
    cv2 = load_cv2()
    capture = cv2.VideoCapture(str(temporary))
    found = 0
    try:
        while capture.grab():
            found += 1
    finally:
        capture.release()
    if found != count:
        raise _not_written(path, codec_of(path), f"{found} of {count} frames read back")


def _not_written(path: Path, codec: str, what: str) -> VideoError:
    return VideoError(
        f"the annotated video was not written: {what} (codec {codec})",
        expected="a folder with room, and a codec that this build of OpenCV has",
        fix="choose another folder, or another ending: .avi (MJPG) is the safest",
        file=path,
    )
