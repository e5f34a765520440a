"""`VideoSource`: a recording, frame by frame, whatever it is kept in."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, VideoError
from openprc.vision.source.content_hash import hash_source
from openprc.vision.source.frame import Frame, same_pixels
from openprc.vision.source.frame_rate import plausible_rate
from openprc.vision.source.grey_levels import GreyLevels
from openprc.vision.source.interlacing import INTERLACED, CombCheck
from openprc.vision.source.readers import Reader, open_reader
from openprc.vision.source.time_axis import TimeAxis, check_rate
from openprc.vision.source.video_file import VideoFile

#: So many frames are looked at on opening.
_FIRST = 8


class VideoSource:
    """A recording that is read frame by frame.

    Parameters
    ----------
    path : path-like
        A video file; a folder of numbered images; a pattern such as ``img_%04d.png`` or
        ``img_*.png``; a list of images in order; a Photron recording (``.cih`` or ``.mraw``);
        a stack (``.npy`` or TIFF pages).
    fps : float [Hz], optional
        The rate of the camera; wins over what the file says. Required where it says nothing.
    strict : bool
        Raise where damage would otherwise only be noted.
    value_range : (low, high), optional
        What becomes grey 0 and 255 in recordings deeper than 8 bits; one for the whole clip.
    bayer : {"RGGB", "BGGR", "GRBG", "GBRG"}, optional
        The images are raw colour mosaics.

    Raises
    ------
    UnreadableFile
        Missing, empty, or a directory without images.
    VideoError
        Not a video, damaged beyond opening, or without a frame that can be decoded.
    ConfigError
        A rate is needed and not given, or an option is out of range.

    Notes
    -----
    Colour becomes grey by ITU-R BT.601. What the user should know is collected in `notes`.
    """

    def __init__(
        self,
        path: str | Path | Sequence[str | Path],
        *,
        fps: float | None = None,
        strict: bool = False,
        value_range: tuple[float, float] | None = None,
        bayer: str | None = None,
    ) -> None:
        check_rate(fps)
        reader = open_reader(path, fps=fps)
        self._begin(
            reader,
            name=reader.path.name if reader.path else "images",
            fps=fps,
            strict=strict,
            value_range=value_range,
            bayer=bayer,
        )

    def _begin(
        self,
        reader: Reader,
        *,
        name: str,
        fps: float | None,
        strict: bool,
        value_range: tuple[float, float] | None,
        bayer: str | None = None,
    ) -> None:
        self._reader = reader
        self.name = name
        self.strict = strict
        self.asked_fps = fps
        self.decoded: int | None = None
        self._levels = GreyLevels(
            value_range or reader.value_range, bayer=bayer, file=reader.path or name
        )
        self._stream: Iterator[Frame] | None = None
        self._stray: Iterator[tuple[NDArray[Any], float]] | None = None
        self._next = 0
        self._last: tuple[int, NDArray[Any]] | None = None
        self._notes: list[str] = []
        self._look_at_first_frames()
        self._fault(*reader.faults)

    def _look_at_first_frames(self) -> None:
        """Find size, depth and plausible rate, and fail now rather than at the end."""
        stamps: list[float] = []
        with closing(self._reader.images(start=0)) as images:
            for image, stamp in islice(images, _FIRST):
                self._levels.learn(image, index=len(stamps))
                self.height, self.width = image.shape[:2]
                self.bit_depth = 8 * image.itemsize
                stamps.append(stamp)
                if self.kind != "video" and self.bit_depth == 8:
                    break  # Neither the clock nor the range of values has to be guessed.
        if not stamps:
            raise self._no_frame()
        self._levels.settle()
        steps = np.diff(stamps)
        regular = len(steps) > 0 and bool(np.all(steps > 0))
        declared = plausible_rate(self._reader.declared_fps)
        self._fps = self.asked_fps or declared or np.nan
        if self.asked_fps is not None or len(steps) == 0:
            return
        if regular and (declared is None or not 0.5 < np.median(steps) * declared < 2.0):
            self._fps = 1.0 / float(np.median(steps))
            self._notes.append(
                f"the container declares {self._reader.declared_fps:g} frames per second; the "
                f"stamps of the first frames say {self._fps:.6g}, and stamps are what is used"
            )
        elif declared is None and not regular:
            raise ConfigError(
                f"there are no time stamps and the declared rate is {self._reader.declared_fps:g}",
                expected="the rate at which the camera recorded",
                fix="pass the option fps",
                file=self.path or self.name,
                key="fps",
            )

    # --- what is known beforehand ---

    @property
    def path(self) -> Path | None:
        """The file or folder, None for images in memory."""
        return self._reader.path

    @property
    def kind(self) -> str:
        """One of video, images, raw, array."""
        return self._reader.kind

    @property
    def container(self) -> str:
        """Name of the container."""
        return self._reader.container

    @property
    def codec(self) -> str:
        """Four letters of the codec, or the pixel type."""
        return self._reader.codec

    @property
    def orientation(self) -> int:
        """Rotation that the container asks for, already applied [degrees]."""
        return self._reader.orientation

    @property
    def fps(self) -> float:
        """What was asked for, else declared, else what the first stamps say [Hz]."""
        return float(self._fps)

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) [px]."""
        return self.height, self.width

    @property
    def frame_count(self) -> int:
        """As declared; 0 where unknown. What counts is what can be decoded."""
        return self._reader.frame_count

    @property
    def value_range(self) -> tuple[float, float] | None:
        """The values that become grey 0 and 255; None for 8 bit."""
        return self._levels.value_range

    @property
    def bayer(self) -> str | None:
        """The colours of the upper left 2 x 2 pixels of a raw mosaic, as was asked."""
        return self._levels.bayer

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know; grows while frames are read."""
        return tuple(dict.fromkeys((*self._reader.notes, *self._notes, *self._levels.notes)))

    # --- frames ---

    def frames(self, *, start: int = 0) -> Iterator[Frame]:
        """Yield the frames from number `start` on, in order, holding two at a time.

        Raises
        ------
        VideoError
            A frame differs in size or type; `strict` and fewer or more frames than declared.
        """
        count = start
        for frame in self._decoded(start):
            count += 1
            yield frame
        self.decoded = count
        self._fault(*self._reader.ended(count))

    def _decoded(self, start: int = 0) -> Generator[Frame]:
        if start < 0:
            raise ConfigError(
                f"start is {start}", expected="a frame number from 0", fix="take 0", key="start"
            )
        # One frame more, to tell whether the first is a duplicate.
        before: NDArray[Any] | None = None
        combs = CombCheck()
        early = max(0, start - 1)
        for index, (image, stamp) in enumerate(self._reader.images(start=early), start=early):
            grey, intensity = self._levels.convert(image, index=index)
            same = before is not None and same_pixels(before, intensity)
            if grey is intensity and before is not None and combs.look(before, grey, index=index):
                self._notes.append(INTERLACED)
            before = intensity
            if index >= start:
                yield Frame(index, stamp, grey, intensity, same)

    def __iter__(self) -> Iterator[Frame]:
        return self.frames()

    def read_frame(self, index: int) -> NDArray[Any]:
        """Return frame number `index`: (H, W), or (H, W, 3) blue-green-red.

        Frames are decoded one after the other up to `index`, because a seek lands beside it in
        some containers; going backward starts anew.

        Raises
        ------
        VideoError
            The recording has fewer frames.
        ConfigError
            A negative number.
        """
        if index < 0 or int(index) != index:
            raise ConfigError(
                f"the frame number is {index}",
                expected="a whole number from 0",
                fix="count from the first frame",
                key="index",
            )
        if self._last is not None and self._last[0] == index:
            return self._last[1].copy()
        if self._stray is None or index < self._next:
            self._stray = self._reader.images(start=index)
            self._next = index
        for image, _ in self._stray:
            self._next += 1
            if self._next > index:
                self._last = (int(index), image)
                return image.copy()
        ended = self._next
        self._stray, self._next = None, 0
        raise VideoError(
            f"there is no frame {index}: the recording ends after {ended}",
            expected=f"a frame number below {ended}",
            fix="choose an earlier frame",
            file=self.path or self.name,
        )

    def read(self) -> Frame | None:
        """Return the next frame, None at the end."""
        if self._stream is None:
            self._stream = self.frames()
        return next(self._stream, None)

    def reset(self) -> None:
        """Start anew with the first frame."""
        self._stream = None

    def release(self) -> None:
        """Close the file; the source can still be read from the beginning."""
        self._stream = self._stray = self._last = None
        self._next = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    # --- time and provenance ---

    def time_axis(self, stamps: ArrayLike, *, duplicated: Sequence[int] = ()) -> TimeAxis:
        """Return the times of all frames from their `stamps` (T,) [s]."""
        return TimeAxis.from_stamps(
            stamps,
            declared_fps=self._reader.declared_fps,
            fps=self.asked_fps,
            duplicated=duplicated,
            declared_frames=self.frame_count,
            strict=self.strict,
        )

    def content_hash(self, *, full: bool = False) -> str:
        """Return a SHA-256 of the content (hexadecimal).

        Of a file: its size, its first, middle and last MiB and the pixels of frame 0; with
        `full`, all bytes. Neither depends on the name.
        """
        return hash_source(self._reader, full=full)

    def describe(self) -> dict[str, Any]:
        """Return what is known about the recording, as JSON can hold it; no folder names."""
        fps = self.fps
        return {
            "source_type": self.kind,
            "path": self.name,
            "container": self.container,
            "codec": self.codec,
            "fps": fps if np.isfinite(fps) else None,
            "width": self.width,
            "height": self.height,
            "bit_depth": self.bit_depth,
            "frame_count": self.frame_count,
            "frames_decoded": self.decoded,
            "orientation": self.orientation,
            "grey_conversion": "ITU-R BT.601",
            "value_range": list(self.value_range) if self.value_range else None,
            "content_hash": self.content_hash(),
            "notes": list(self.notes),
        }

    def _fault(self, *texts: str) -> None:
        """Note damage, or raise it when `strict`."""
        if self.strict and texts:
            raise VideoError(
                "; ".join(texts),
                expected="an undamaged recording, as strict=True asks",
                fix="record or copy it again, or leave strict out and read the notes",
                file=self.path or self.name,
            )
        self._notes += [text for text in texts if text not in self._notes]

    def _no_frame(self) -> VideoError:
        if isinstance(self._reader, VideoFile):
            return self._reader.no_frame()
        return VideoError(
            "there is no frame",
            expected="at least one",
            fix="check the file",
            file=self.path or self.name,
        )
