"""The producer ``vision``: a video becomes a planar trajectory that says how good it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData
from openprc.vision.finished_tracks import FinishedTracks, PointFigures, chosen_points
from openprc.vision.import_settings import ImportSettings
from openprc.vision.run_figures import run_figures
from openprc.vision.sniffing import sniff_video
from openprc.vision.source.opening import open_source
from openprc.vision.source.time_axis import TimeAxis
from openprc.vision.start_points import StartPoints, read_bars, start_points
from openprc.vision.track_writing import write_tracks
from openprc.vision.tracking.tracker import Tracker
from openprc.vision.tracks_spool import TracksSpool

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter
    from openprc.vision.source.video_source import VideoSource
    from openprc.vision.tracking.result import TrackingResult


@dataclass(frozen=True)
class TrackedVideo:
    """What an import leaves in the hands of its caller, beside the file.

    Attributes
    ----------
    source : VideoSource
    result : TrackingResult
        All points as they were measured [px], one row a frame, mapped from a nameless file
        that goes with the object.
    calibration : object or None
    nodes : (n,) int
        The points that became nodes.
    figures : dict
        Of the whole run, as plain values.
    """

    source: VideoSource
    result: TrackingResult
    calibration: Any
    nodes: NDArray[np.intp]
    figures: dict[str, Any] = field(default_factory=dict)


class VisionProducer:
    """Tracks points through a video (capability ``import``).

    The options are those of `openprc.vision.import_settings.ImportSettings`. Memory does not
    grow with the length of the video, but for ``stabilise``, which looks at all points of all
    frames. On Ctrl-C what was tracked so far is written, and kept as the unfinished file that
    ``openprc repair`` makes whole.

    Attributes
    ----------
    progress : callable or None
        Called as ``progress(done, total)`` with the frames done and declared (None where the
        number is not known).
    tracked : TrackedVideo or None
        The last import.
    """

    def __init__(self) -> None:
        self.progress: Callable[[int, int | None], None] | None = None
        self.tracked: TrackedVideo | None = None

    def sniff(self, path: Path) -> float:
        """Return 0.7 for a recording by its content, 0.3 for the name alone; see `sniff_video`."""
        return sniff_video(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Track `path` and write node positions (T, N, 2) with mask, quality and sigma.

        Raises
        ------
        UnreadableFile
            Not a video, or one that delivers no frame (`VideoError`).
        NoFeaturesError
            No point is found in the reference frame.
        CalibrationError
            The calibration does not fit the recording.
        ConfigError
            An option is out of range, does not fit the video, or no frame rate is known.
        MissingData
            No point is left to be written.
        """
        self.tracked = None
        settings = ImportSettings.from_options(options)
        with open_source(
            path, fps=settings.fps, strict=settings.strict, value_range=settings.value_range
        ) as source:
            calibration, notes = settings.mapping(source.shape)
            _check_drive(settings, source)
            start = _start(source, settings, path=Path(path))
            bars = None
            if settings.bars is not None:
                bars = read_bars(settings.bars, len(start.places))
            run = _follow(source, start.places, settings, writer.path.parent, self.progress)
        for option in ("points", "mask", "bars", "calibration"):
            named = getattr(settings, option)
            if named is not None:
                writer.add_source(named, role=option)
        if settings.drive is not None and settings.drive.file is not None:
            writer.add_source(settings.drive.file, role="drive")
        result = run.result
        figures = PointFigures.of(result)
        if settings.strict and not figures.seen[result.status[-1] != 1].any():
            raise MissingData(
                "all points are lost at the end of the video",
                expected="at least one, as strict asks",
                fix="leave strict out, or track what stays in view",
                file=path,
                key="strict",
            )
        held = set() if bars is None else set(bars.ravel().tolist())
        if start.marker is not None:
            held.add(start.marker)
        chosen, dropped = chosen_points(figures, settings, always=sorted(held), file=Path(path))
        tracks = FinishedTracks(result, settings, calibration, chosen, folder=writer.path.parent)
        summary = _figures(source, run, figures, settings)
        self.tracked = TrackedVideo(source, result, calibration, chosen, summary)
        record = {
            "source": source.describe(),
            "tracker": settings.tracker_config().as_dict(),
            "calibration": None if calibration is None else calibration.as_dict(),
            "figures": summary,
        }
        write_tracks(
            writer, tracks, settings, start=start, bars=bars, calibration=calibration,
            frame_times=result.timestamps, interrupted=run.interrupted,
            record=json.dumps(record, default=str),
        )  # fmt: skip
        for note in dict.fromkeys(
            (*_about(source, run), *notes, *start.notes, *result.notes, *dropped, *tracks.notes)
        ):
            writer.note(note)
        if run.interrupted:
            writer.keep()
            raise KeyboardInterrupt


@dataclass(frozen=True)
class _Run:
    result: TrackingResult
    axis: TimeAxis
    interrupted: bool


def _check_drive(settings: ImportSettings, source: VideoSource) -> None:
    """Refuse a drive that cannot fit before an hour is spent on tracking."""
    drive = settings.drive
    if drive is None or not drive.per_frame or len(drive.values) == source.frame_count:
        return
    # What is declared may be wrong either way; only counting tells.
    drive.check_length(sum(1 for _ in source.frames()))


def _start(source: VideoSource, settings: ImportSettings, *, path: Path) -> StartPoints:
    number = settings.reference_frame
    frame = next(source.frames(start=number), None)
    if frame is None:
        raise ConfigError(
            f"there is no frame {number} in the video",
            expected="a reference frame that is there, counted from 0",
            fix="choose an earlier one",
            file=path,
            key="reference_frame",
        )
    return start_points(frame.grey, settings, file=path)


def _follow(
    source: VideoSource,
    places: NDArray[np.float64],
    settings: ImportSettings,
    folder: Path,
    progress: Callable[[int, int | None], None] | None,
) -> _Run:
    tracker = Tracker(
        source, places, config=settings.tracker_config(),
        reference_frame=settings.reference_frame, progress=progress,
    )  # fmt: skip
    interrupted = False
    with TracksSpool(folder, len(places)) as spool:
        try:
            for step in tracker.steps():
                spool.append(step)
        except KeyboardInterrupt:
            if len(spool) <= settings.reference_frame:
                raise
            interrupted = True
        stamps, duplicated = spool.clock()
        notes = list(tracker.notes)
        if interrupted:
            # The declared number of frames says nothing of what was stopped half way.
            axis = TimeAxis.from_stamps(
                stamps, declared_fps=source.fps, fps=settings.fps, duplicated=duplicated
            )
            notes.append(f"interrupted: the tracks end with frame {len(spool) - 1}")
        else:
            axis = source.time_axis(stamps, duplicated=duplicated)
        result = spool.result(
            axis, reference_frame=settings.reference_frame, noise=tracker.noise,
            config=tracker.config, notes=tuple(notes),
        )  # fmt: skip
    return _Run(result, axis, interrupted)


def _about(source: VideoSource, run: _Run) -> list[str]:
    axis = run.axis
    height, width = source.shape
    return [
        f"{source.container}, codec {source.codec}, {width} x {height} px, "
        f"{len(axis.times)} frames decoded"
        + (f", {source.frame_count} declared" if source.frame_count > 0 else ""),
        f"frame times: {axis.how}",
        *axis.notes,
        *source.notes,
    ]


def _figures(
    source: VideoSource, run: _Run, figures: Any, settings: ImportSettings
) -> dict[str, Any]:
    """Return what tells whether the run can be trusted, as plain values."""
    return {
        **run_figures(run.result, figures),
        "declared_frames": source.frame_count or None,
        "container": source.container,
        "codec": source.codec,
        "image": [source.width, source.height],
        "detector": None if settings.points else settings.detector,
        "interrupted": run.interrupted,
        "settings": {
            key: value
            for key, value in asdict(settings).items()
            if key not in ("drive", "points", "mask", "bars", "calibration")
        },
    }
