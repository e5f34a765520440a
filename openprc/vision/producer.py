"""The producer ``vision``: a video becomes a planar trajectory in pixels."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, UnreadableFile
from openprc.schema import safety
from openprc.vision.detectors import DETECTORS
from openprc.vision.old_klt import LucasKanade
from openprc.vision.video import Video, container, frame_times

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

SUFFIXES = (".avi", ".mp4", ".m4v", ".mkv", ".webm", ".mov", ".mpg", ".mpeg")


class VisionProducer:
    """Tracks points through a video (capability ``import``).

    Options: ``detector`` and ``max_points``, or ``points`` (a CSV file of x, y in px of the
    first frame); ``win_size``, ``levels`` and ``fb_threshold`` of
    `openprc.vision.old_klt.LucasKanade`; ``fps`` where the container does not know the rate
    of the camera. The tracks of all frames are held in memory, the images are not.
    """

    def sniff(self, path: Path) -> float:
        """Return 0.7 for the leading bytes of a video container, 0.3 for the name alone."""
        path = Path(path)
        try:
            if path.is_file() and container(path) is not None:
                return 0.7
        except OSError:
            return 0.0
        return 0.3 if path.suffix.lower() in SUFFIXES else 0.0

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Track `path` and write node positions (T, N, 2) [px] with the observed mask.

        Raises
        ------
        UnreadableFile
            Not a video, or one that delivers no frame.
        MissingData
            No point is found in the first frame.
        ConfigError
            An option is out of range, or no frame rate is known.
        """
        tracker = LucasKanade(
            win_size=int(_option(options, "win_size", 21)),
            levels=int(_option(options, "levels", 3)),
            fb_threshold=float(_option(options, "fb_threshold", 1.0)),
        )
        fps = options.get("fps")
        if fps is not None and not (np.isfinite(fps) and fps > 0):
            raise ConfigError(
                f"fps is {fps}", expected="a positive number [Hz]", fix="leave it out", key="fps"
            )
        video = Video.open(Path(path))
        tracks: list[NDArray[np.float64]] = []
        stamps: list[float] = []
        previous: NDArray[np.uint8] | None = None
        for image, stamp in video.frames():
            tracks.append(
                _start(image, video.path, writer, options)
                if previous is None
                else tracker.step(previous, image, tracks[-1])
            )
            stamps.append(stamp)
            previous = image
        if previous is None:
            raise UnreadableFile(
                f"the video (codec {video.codec}) opens but delivers no frame",
                expected="frames that the installed OpenCV can decode",
                fix="convert it, for example to MJPG or H.264, or install another OpenCV",
                file=path,
            )
        times, how = frame_times(np.array(stamps), video.declared_fps, fps=fps)
        _write(writer, times, np.stack(tracks), image_shape=previous.shape)
        writer.note(f"{video.container} video, codec {video.codec}; {how}")
        if video.declared_frames != len(times):
            writer.note(
                f"the container declares {video.declared_frames} frames and delivered "
                f"{len(times)}; what was delivered is used"
            )
        _note_holes(writer, times)


def _option(options: Mapping[str, Any], name: str, default: Any) -> Any:
    value = options.get(name)
    return default if value is None else value


def _start(
    image: NDArray[np.uint8], path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> NDArray[np.float64]:
    """Return the points to follow, (N, 2) [px]."""
    listed = options.get("points")
    if listed is not None:
        writer.add_source(Path(listed), role="points")
        return _read_points(Path(listed), image.shape)
    name = _option(options, "detector", "shi-tomasi")
    if name not in DETECTORS:
        raise ConfigError(
            f"unknown detector {name!r}",
            expected="one of " + ", ".join(DETECTORS),
            fix="choose one of these",
            key="detector",
        )
    most = int(_option(options, "max_points", 100))
    if most < 1:
        raise ConfigError(
            f"max_points is {most}", expected="at least 1", fix="raise it", key="max_points"
        )
    points: NDArray[np.float64] = DETECTORS[name](max_points=most).detect(image)
    if not len(points):
        raise MissingData(
            f"the detector {name!r} finds no point in the first frame",
            expected="texture or marks that can be followed",
            fix="choose another detector, or list the points in a CSV file (option points)",
            file=path,
            key="detector",
        )
    return points


def _read_points(path: Path, shape: tuple[int, ...]) -> NDArray[np.float64]:
    path = safety.check_readable(path)
    points: list[tuple[float, float]] = []
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        for number, row in enumerate(csv.reader(stream), start=1):
            if not row or (number == 1 and [c.strip().lower() for c in row] == ["x", "y"]):
                continue
            try:
                x, y = (float(cell) for cell in row)
            except ValueError:
                x = y = np.nan
            if not (0 <= x <= shape[1] - 1 and 0 <= y <= shape[0] - 1):
                raise ConfigError(
                    f"line {number} is {','.join(row)!r}",
                    expected=f"x,y in px inside the image of {shape[1]} x {shape[0]}",
                    fix="one point a line; the first line may be the header x,y",
                    file=path,
                    key="points",
                )
            points.append((x, y))
    if not points:
        raise ConfigError(
            "no point is listed", expected="lines x,y", fix="list some", file=path, key="points"
        )
    return np.array(points)


def _write(
    writer: TrajectoryWriter,
    times: NDArray[np.float64],
    tracks: NDArray[np.float64],
    *,
    image_shape: tuple[int, ...],
) -> None:
    seen = np.asarray(np.isfinite(tracks).all(axis=2))
    writer.declare_nodes(tracks.shape[1], 2, unit="px", axes="x,y", frame="image", observed=True)
    writer.declare_channel("fraction_tracked", ["fraction"], unit="1", quantity="fraction")
    writer.append(
        times,
        positions=tracks,
        observed=seen.astype(np.uint8),
        channels={"fraction_tracked": seen.mean(axis=1)[:, None]},
    )
    writer.note(
        f"image of {image_shape[1]} x {image_shape[0]} px, origin at the centre of the upper "
        "left pixel, x to the right, y down"
    )
    lost = int((~seen[-1]).sum())
    if lost:
        writer.note(
            f"{lost} of {tracks.shape[1]} points are lost before the last frame and stay NaN"
        )


def _note_holes(writer: TrajectoryWriter, times: NDArray[np.float64]) -> None:
    if len(times) < 3:
        return
    steps = np.diff(times)
    holes = np.flatnonzero(steps > 1.5 * np.median(steps))
    if len(holes):
        writer.note(
            f"{len(holes)} gaps between frames are longer than 1.5 times the usual one, the "
            f"first after frame {holes[0]}: frames were dropped or the rate varies"
        )
