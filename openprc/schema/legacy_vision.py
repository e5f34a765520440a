"""Output of the older video tracker: everything lies below ``/vision``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema.legacy_clock import read_times, rebuild
from openprc.schema.legacy_kinds import attribute, numeric, read
from openprc.schema.legacy_recordings import declare_tracks
from openprc.schema.units import UNITS

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

#: Status codes of that tracker, as marks of the contract: 0 missing, 1 measured, 2 filled in.
#: In order: tracked, lost, out of the image, drifted, interpolated, reference frame.
_MARKS = np.array([1, 0, 0, 0, 2, 1], dtype=np.uint8)
_LOST, _INTERPOLATED = (1, 2, 3), 4


@dataclass(frozen=True)
class StoredTracks:
    """Tracks as they are stored below ``/vision``.

    Attributes
    ----------
    places : (T, N, 2 or 3)
        Also of points that count as missing.
    times : (T,) [s]
    status : (T, N)
        Codes 0 to 5.
    marks : (T, N)
        0 missing, 1 measured, 2 filled in.
    ids : list of int or None
    fps : float [Hz]
    """

    places: NDArray[np.float64]
    times: NDArray[np.floating[Any]]
    status: NDArray[np.uint8]
    marks: NDArray[np.uint8]
    ids: list[int] | None
    fps: float


def read_tracks(file: h5py.File, path: Path, part: str) -> StoredTracks:
    """Return what stands below ``/vision/<part>``, ``trajectories`` or ``tracking``.

    Raises
    ------
    UnreadableFile
        The datasets do not fit together, or a status code is not known.
    """
    group = file[f"vision/{part}"]
    item = numeric(group, "positions")
    if item is None or item.ndim != 3 or item.shape[2] not in (2, 3) or 0 in item.shape:
        found = "no numbers" if item is None else f"shape {item.shape}"
        raise _wrong(path, f"{part}/positions", found, "(T, N, 2), not empty")
    places = read(item).astype(np.float64)
    clock = numeric(group, "timestamps")
    if clock is None:
        raise _wrong(path, f"{part}/timestamps", "no numbers", f"{len(places)}, one a frame")
    times = read_times(clock, len(places), path=path)
    if len(times) != len(places):
        raise _wrong(
            path, f"{part}/timestamps", f"{len(times)} times", f"{len(places)}, one a frame"
        )
    status = _status(group, path, part, places.shape[:2])
    marks = _MARKS[status] * np.isfinite(places).all(axis=2)
    fps = attribute(group, "fps", 0.0)
    return StoredTracks(places, times, status, marks, _ids(group, places.shape[1]), fps)


def import_vision(
    file: h5py.File, path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> None:
    """Write the calibrated trajectories, or the raw tracks where there are none.

    Raises
    ------
    UnreadableFile
        The datasets do not fit together, or a status code is not known.
    """
    part = "trajectories" if "vision/trajectories/positions" in file else "tracking"
    tracks = read_tracks(file, path, part)
    places, status = tracks.places, tracks.status
    clock = rebuild(tracks.times, rates=[tracks.fps])
    if clock.remark:
        writer.note(clock.remark)
    unit = "px"
    if part == "trajectories":
        places, unit = _undo_calibration(file[f"vision/{part}"], path, places, writer)
    drifted = int((np.isin(status, _LOST) & np.isfinite(places).all(axis=2)).sum())
    if drifted:
        writer.note(
            f"{drifted} places of points marked as lost have numbers; they count as missing"
        )
    filled = int((status == _INTERPOLATED).sum())
    if filled:
        writer.note(
            f"{filled} places were filled in by that program, which extended the line through "
            "the last measurements where a point did not come back (observed = 2)"
        )
    places, seen = declare_tracks(
        writer, places, path=path, unit=unit, status=_MARKS[status], ids=tracks.ids
    )
    writer.note(
        f"times are those of that program, frame number / {tracks.fps:g} Hz: wrong for a "
        "recording with a variable rate"
    )
    writer.note("nothing says what drove the body")
    _note_source(file, writer)
    writer.append(clock.time, positions=places, observed=seen)


def _status(group: h5py.Group, path: Path, part: str, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    item = numeric(group, "status")
    if item is None or item.shape != shape or item.dtype.kind not in "iu":
        found = "no codes" if item is None else f"{item.dtype} of shape {item.shape}"
        raise _wrong(path, f"{part}/status", found, f"whole numbers of shape {shape}")
    status = read(item)
    if status.min() < 0 or status.max() >= len(_MARKS):
        raise _wrong(path, f"{part}/status", f"the code {status.max()}", "0 to 5")
    return status.astype(np.uint8)


def _undo_calibration(
    group: h5py.Group, path: Path, places: NDArray[np.float64], writer: TrajectoryWriter
) -> tuple[NDArray[np.float64], str]:
    """Return positions and their unit.

    The normalised calibration divides x by the width and y by the height of the image, which
    distorts lengths and angles; multiplying puts them back into px.
    """
    calibration = json_object(
        group.attrs.get("calibration", "{}"), path, "trajectories@calibration"
    )
    kind = calibration.get("kind")
    if kind == "normalized":
        frame = calibration.get("frame_shape")
        if not (isinstance(frame, list) and len(frame) == 2 and min(frame) > 0):
            raise _wrong(
                path, "trajectories@calibration", f"frame_shape {frame}", "[height, width]"
            )
        writer.note(
            "positions were stored divided by the width and height of the image; they were "
            f"multiplied by {frame[1]} and {frame[0]} to be in px again"
        )
        return places * (float(frame[1]), float(frame[0])), "px"
    stated = calibration.get("physical_units")
    if isinstance(stated, str) and stated in UNITS and UNITS[stated].dimension == "length":
        writer.note(
            f"positions are in {stated} as calibrated; that calibration undoes lens distortion "
            "to about 0.003 px and takes the scene for flat"
        )
        return places, stated
    if kind is None and stated is None:
        writer.note("no calibration is stored and no unit of length: arb")
        return places, "arb"
    writer.note(f"the calibration {kind!r} states the unit {stated!r}, which is none here: arb")
    return places, "arb"


def json_object(text: Any, path: Path, key: str) -> dict[str, Any]:
    """Return the JSON object that an attribute holds.

    Raises
    ------
    UnreadableFile
        When it holds something else.
    """
    text = text.decode("utf-8", errors="replace") if isinstance(text, bytes) else text
    try:
        data = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        data = None
    if not isinstance(data, dict):
        raise _wrong(path, key, f"{text!r}", "a JSON object")
    return data


def _ids(group: h5py.Group, n: int) -> list[int] | None:
    item = numeric(group, "feature_ids")
    if item is None or item.shape != (n,) or item.dtype.kind not in "iu":
        return None
    ids = [int(number) for number in read(item)]
    return ids if len(set(ids)) == n else None


def _note_source(file: h5py.File, writer: TrajectoryWriter) -> None:
    source = file.get("vision/source")
    if not isinstance(source, h5py.Group):
        return
    name = str(source.attrs.get("path", "")).replace("\\", "/").rpartition("/")[2]
    size = [source.attrs.get(key) for key in ("width", "height")]
    facts = [f"video {name}"] if name else []
    facts += [f"{size[0]} x {size[1]} px"] if None not in size else []
    digest = source.attrs.get("content_hash")
    facts += [f"sha256 {digest}"] if isinstance(digest, str) and digest else []
    if facts:
        writer.note("tracked in " + ", ".join(facts))


def _wrong(path: Path, key: str, found: str, expected: str) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected=expected,
        fix="save it again with the program that wrote it",
        file=path,
        key=f"/vision/{key}",
    )
