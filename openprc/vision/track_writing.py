"""From finished tracks to a simulation.h5: nodes, bars, the input, and what the tracker knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.drive import NAME as DRIVE
from openprc.vision.drive import Drive, marker_drive
from openprc.vision.finished_tracks import FinishedTracks
from openprc.vision.import_settings import ImportSettings
from openprc.vision.start_points import StartPoints
from openprc.vision.storage.extension import NAME as EXTENSION
from openprc.vision.storage.extension import declare_tracking, tracking_rows
from openprc.vision.storage.simulation import node_labels

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_SERIES = ("quality", "sigma", "status", "template")


def write_tracks(
    writer: TrajectoryWriter,
    tracks: FinishedTracks,
    settings: ImportSettings,
    *,
    start: StartPoints,
    bars: NDArray[np.int64] | None,
    calibration: Any,
    frame_times: NDArray[np.float64],
    interrupted: bool,
    record: str,
) -> None:
    """Declare and append everything, a block of frames at a time.

    Parameters
    ----------
    start : StartPoints
        Where tracking began; rest positions are taken from there.
    bars : (M, 2) int or None
        Pairs of the points as they were numbered at the start.
    frame_times : (T,) [s]
    interrupted : bool
        The video was not followed to its end.
    record : str
        JSON with source, settings, calibration and figures, kept in the extension.

    Raises
    ------
    MissingData
        The marker is not seen in every frame.
    ConfigError
        The drive does not fit the frames, or the marker was the only point.
    """
    drive, nodes = _drive(tracks, settings, start, frame_times, interrupted)
    numbers = tracks.points[nodes]
    rest = _placed(start.places[numbers], calibration)
    unit = tracks.unit
    writer.declare_nodes(
        len(nodes), len(tracks.axes), unit=unit, axes=",".join(tracks.axes), frame=tracks.frame,
        observed=True, rest=None if settings.stabilise else rest,
        ids=[int(number) for number in numbers], labels=node_labels(numbers),
    )  # fmt: skip
    writer.declare_channel("fraction_tracked", ["fraction"], unit="1", quantity="fraction")
    declare_tracking(writer, len(nodes), len(tracks.axes), unit=unit, names=_SERIES)
    writer.put_extension(
        EXTENSION, "record", [record], comment="JSON: source, settings, calibration, figures"
    )
    members = None
    if bars is not None:
        members = _Bars.among(bars, numbers, rest, marker=start.marker)
        members.declare(writer, unit)
    if drive is not None:
        drive.declare(writer)
        writer.note(_about_drive(drive, settings, kept=settings.keep_marker))
    for block in tracks.blocks(nodes):
        rows: dict[str, Any] = {"positions": block.positions, "observed": block.observed}
        if members is not None:
            rows["elements"] = members.series(block.positions)
        if drive is not None:
            rows["inputs"] = {DRIVE: drive.on_clock(block.times, frame_times)}
        writer.append(
            block.times,
            **rows,
            channels={"fraction_tracked": (block.observed == 1).mean(axis=1)[:, np.newaxis]},
            extensions=tracking_rows({name: getattr(block, name) for name in _SERIES}),
        )
    _note_frame(writer, unit, calibration)


def _drive(
    tracks: FinishedTracks,
    settings: ImportSettings,
    start: StartPoints,
    frame_times: NDArray[np.float64],
    interrupted: bool,
) -> tuple[Drive | None, NDArray[np.intp]]:
    """Return the input, and which of the chosen points are nodes."""
    nodes = np.arange(len(tracks.points))
    if start.marker is None:
        drive = settings.drive
        if drive is not None:
            drive = drive.cut(len(frame_times)) if interrupted else drive
            drive.check_length(len(frame_times))
            drive.on_clock(tracks.times[[0, -1]], frame_times)
        return drive, nodes
    place = int(np.flatnonzero(tracks.points == start.marker)[0])
    path = tracks.path_of(place)
    marker = marker_drive(path, unit=tracks.unit, axes=tracks.axes, label=f"point {start.marker}")
    if settings.rate:
        # On the new clock there is one value for each instant, not for each frame.
        marker = Drive(
            values=marker.values, columns=marker.columns, unit=marker.unit,
            quantity=marker.quantity, times=tracks.times,
        )  # fmt: skip
    if not settings.keep_marker:
        nodes = np.delete(nodes, place)
    if not len(nodes):
        raise ConfigError(
            "the marker is the only point",
            expected="points beside it, whose motion answers to that of the marker",
            fix="track more points, or keep it as a node, too (keep_marker=true)",
            key="drive_marker",
        )
    return marker, nodes


def _about_drive(drive: Drive, settings: ImportSettings, *, kept: bool) -> str:
    if settings.drive is None:
        fate = (
            "it is a node as well, so that states hold the input itself"
            if kept
            else "it is not a node, so that states do not hold the input itself"
        )
        return f"the input is the displacement of a marker since the first frame; {fate}"
    if drive.hold is not None:
        return f"the drive has {len(drive.values)} symbols of {drive.hold:.6g} s each"
    return (
        "the drive has one value a frame" if drive.times is None else "the drive has its own times"
    )


def _placed(points: NDArray[np.float64], calibration: Any) -> NDArray[np.float64]:
    if calibration is None:
        return points
    placed: NDArray[np.float64] = np.asarray(calibration.to_physical(points), dtype=np.float64)
    return placed


@dataclass(frozen=True)
class _Bars:
    pairs: NDArray[np.int64]
    rest: NDArray[np.float64]

    @classmethod
    def among(
        cls,
        bars: NDArray[np.int64],
        numbers: NDArray[np.intp],
        rest: NDArray[np.float64],
        *,
        marker: int | None,
    ) -> _Bars:
        """Renumber bars from points at the start to nodes; rest lengths are those there."""
        if len(bars) and not np.isin(bars, numbers).all():
            first = int(np.flatnonzero(~np.isin(bars, numbers).all(axis=1))[0])
            raise ConfigError(
                f"bar {first} ends at point {marker}, the marker, which is no node",
                expected="bars between nodes",
                fix="keep the marker as a node (keep_marker=true), or leave the bar out",
                key="bars",
            )
        pairs = np.searchsorted(numbers, bars)
        lengths = np.linalg.norm(rest[pairs[:, 0]] - rest[pairs[:, 1]], axis=1)
        if not (lengths > 0).all():
            first = int(np.flatnonzero(~(lengths > 0))[0])
            raise ConfigError(
                f"both ends of bar {first} lie in the same place",
                expected="two different points",
                fix="correct the list of points or of bars",
                key="bars",
            )
        return cls(pairs, lengths)

    def declare(self, writer: TrajectoryWriter, unit: str) -> None:
        writer.declare_elements(
            "bars", self.pairs, series={"length": unit, "strain": "1"},
            static={"rest_length": (self.rest, unit)},
        )  # fmt: skip

    def series(self, positions: NDArray[np.float64]) -> dict[tuple[str, str], NDArray[np.float64]]:
        """Return lengths and strains; NaN where an end is missing."""
        ends = positions[:, self.pairs[:, 0]] - positions[:, self.pairs[:, 1]]
        lengths = np.linalg.norm(ends, axis=2)
        return {("bars", "length"): lengths, ("bars", "strain"): lengths / self.rest - 1.0}


def _note_frame(writer: TrajectoryWriter, unit: str, calibration: Any) -> None:
    if calibration is None:
        writer.note(
            "positions are in px of the image: origin at the centre of the upper left pixel, x to "
            "the right, y down"
        )
    else:
        up = "up" if getattr(calibration, "y_up", False) else "down"
        kind = getattr(calibration, "kind", type(calibration).__name__)
        writer.note(f"positions are in {unit} by the calibration {kind!r}, y {up} in the image")
