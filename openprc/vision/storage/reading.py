"""How each part of a vision file is read, the older tracker's files included."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import OpenPRCError, UnreadableFile
from openprc.schema.legacy_kinds import attribute, numeric, read
from openprc.schema.legacy_vision import json_object, read_tracks
from openprc.schema.units import UNITS
from openprc.vision.storage.parts import FEATURES, TRACKING_EXTRAS, TRAJECTORY_EXTRAS
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.trajectories.trajectory_set import TrajectorySet


def read_source(group: h5py.Group, path: Path) -> dict[str, Any]:
    """Return what is known of the video, as plain values."""
    facts = {name: _scalar(value) for name, value in group.attrs.items()}
    if "description" in facts:
        stated = json_object(facts.pop("description"), path, "source@description")
        facts = {**stated, **facts}
    return facts


def read_feature_map(group: h5py.Group, path: Path) -> Any:
    """Return the `FeatureMap`."""
    from openprc.vision.detection.feature_map import FeatureMap  # noqa: PLC0415 - on demand

    arrays: dict[str, Any] = {}
    for name in FEATURES:
        item = numeric(group, name)
        arrays[name] = None if item is None else read(item)
    keypoints = arrays["keypoints"]
    if keypoints is None or keypoints.ndim != 2 or keypoints.shape[1] != 2:
        found = "no numbers" if keypoints is None else f"shape {keypoints.shape}"
        raise wrong(path, "feature_map/keypoints", found, "(N, 2)")
    for name, array in arrays.items():
        if array is not None and len(array) != len(keypoints):
            raise wrong(path, f"feature_map/{name}", f"{len(array)} rows", f"{len(keypoints)}")
    n_points = len(keypoints)
    # The older tracker knew no track_sigma, and rounded places to single precision.
    blanks = {"sizes": 0.0, "angles": -1.0, "responses": 0.0, "octaves": 0, "track_sigma": np.nan}
    for name, blank in blanks.items():
        stored = arrays[name]
        values = np.full(n_points, blank) if stored is None else stored
        arrays[name] = values.astype(np.int32 if name == "octaves" else np.float64)
    arrays["keypoints"] = keypoints.astype(np.float64)
    edges = [int(edge) for edge in np.ravel(group.attrs.get("frame_shape", (0, 0)))]
    config = group.attrs.get("detector_config", "{}")
    return FeatureMap(
        **arrays,
        detector_name=str(_scalar(group.attrs.get("detector_name", ""))),
        detector_config=json_object(config, path, "feature_map@detector_config"),
        ref_frame_index=int(attribute(group, "ref_frame_index", 0)),
        frame_shape=(edges[0], edges[1]),
        notes=_notes(group, path, "feature_map"),
    )


def read_tracking(group: h5py.Group, path: Path) -> TrackingResult:
    """Return the `TrackingResult`; places of points that are lost become NaN."""
    tracks = read_tracks(group.file, path, "tracking")
    shape = tracks.places.shape
    if shape[2] != 2:
        raise wrong(path, "tracking/positions", f"shape {shape}", "(T, N, 2) in px")
    extras = _extras(group, path, "tracking", TRACKING_EXTRAS, shape)
    if tracks.ids is not None:
        extras["feature_ids"] = np.array(tracks.ids)
    notes = _notes(group, path, "tracking")
    config, remark = _config(group, path)
    edges = group.attrs.get("frame_shape")
    return TrackingResult(
        positions=np.where((tracks.marks > 0)[..., np.newaxis], tracks.places, np.nan),
        status=tracks.status,
        timestamps=tracks.times.astype(np.float64),
        reference_frame=int(attribute(group, "reference_frame", 0)),
        noise=attribute(group, "noise", float("nan")),
        config=config,
        time_axis=_time_axis(group, path, tracks.times.astype(np.float64)),
        frame_shape=None if edges is None else tuple(int(edge) for edge in np.ravel(edges)),  # type: ignore[arg-type]
        notes=(*notes, *remark),
        **extras,
    )


def read_trajectories(group: h5py.Group, path: Path) -> TrajectorySet:
    """Return the `TrajectorySet`; places of points that are lost become NaN."""
    tracks = read_tracks(group.file, path, "trajectories")
    extras = _extras(group, path, "trajectories", TRAJECTORY_EXTRAS, tracks.places.shape)
    marks = extras.pop("observed", tracks.marks)
    calibration, remarks = _calibration(group, path)
    stated = json_object(group.attrs.get("metadata", "{}"), path, "trajectories@metadata")
    units = str(_scalar(group.attrs.get("units", "")))
    if not units:
        units = getattr(calibration, "units", "")
    if units not in UNITS:
        remarks.append(f"the unit {units!r} of the file is none here: arb")
        units = "arb"
    axes = stated.get("axes")
    operations, notes = stated.get("operations", []), stated.get("notes", [])
    return TrajectorySet(
        np.where((marks > 0)[..., np.newaxis], tracks.places, np.nan),
        tracks.times.astype(np.float64),
        status=tracks.status,
        observed=marks,
        units=units,
        axes=tuple(axes) if isinstance(axes, list) else (),
        frame=str(_scalar(group.attrs.get("frame", "image"))),
        feature_ids=None if tracks.ids is None else np.array(tracks.ids),  # type: ignore[arg-type]
        calibration=calibration,
        operations=tuple(item for item in operations if isinstance(item, dict)),
        notes=(*(str(note) for note in notes), *remarks),
        **extras,
    )


def read_signals(group: h5py.Group, path: Path) -> tuple[NDArray[Any], dict[str, Any]]:
    """Return the signals and what is said about them."""
    item = numeric(group, "data")
    if item is None or item.ndim not in (2, 3):
        raise wrong(path, "signals/data", "no such array of numbers", "(T, N) or (T, N, d)")
    return read(item), {name: _scalar(value) for name, value in group.attrs.items()}


def _extras(
    group: h5py.Group, path: Path, part: str, names: tuple[str, ...], shape: tuple[int, ...]
) -> dict[str, Any]:
    tails: dict[str, tuple[int, ...]] = {
        "sigma": (shape[2],), "deformation": (2, 2), "positions_px": (2,),
    }  # fmt: skip
    found: dict[str, Any] = {}
    for name in names:
        item = numeric(group, name)
        if item is None or name == "feature_ids":
            continue
        wanted = (*shape[:2], *tails.get(name, ()))
        if item.shape != wanted:
            raise wrong(path, f"{part}/{name}", f"shape {item.shape}", f"{wanted}")
        found[name] = read(item)
    return found


def _notes(group: h5py.Group, path: Path, part: str) -> tuple[str, ...]:
    text = _scalar(group.attrs.get("notes", "[]"))
    wrapped = json_object(f'{{"notes": {text}}}', path, f"{part}@notes")
    notes = wrapped["notes"]
    return tuple(str(note) for note in notes) if isinstance(notes, list) else ()


def _config(group: h5py.Group, path: Path) -> tuple[Any, tuple[str, ...]]:
    from openprc.vision.tracking.config import KLTConfig  # noqa: PLC0415 - on demand
    from openprc.vision.tracking.refinement import RefineSettings  # noqa: PLC0415 - on demand

    values = json_object(group.attrs.get("tracker_config", "{}"), path, "tracking@tracker_config")
    if not values:
        return None, ()
    try:
        settings = dict(values)
        if isinstance(settings.get("refinement"), dict):
            settings["refinement"] = RefineSettings(**settings["refinement"])
        return KLTConfig(**settings), ()
    except (TypeError, OpenPRCError):
        return None, (f"settings of another version of the tracker: {values}",)


def _time_axis(group: h5py.Group, path: Path, times: NDArray[np.float64]) -> Any:
    if "time_axis" not in group.attrs:
        return None
    from openprc.vision.source.time_axis import Drop, TimeAxis  # noqa: PLC0415 - on demand

    values = json_object(group.attrs["time_axis"], path, "tracking@time_axis")
    try:
        values["dropped"] = tuple(Drop(*item) for item in values.get("dropped", ()))
        for name in ("duplicated", "notes"):
            values[name] = tuple(values.get(name, ()))
        return TimeAxis(times=times, **values)
    except TypeError as error:
        raise wrong(
            path, "tracking@time_axis", f"values that make no time axis: {error}", "those of one"
        ) from error


def _calibration(group: h5py.Group, path: Path) -> tuple[Any, list[str]]:
    text = group.attrs.get("calibration", "{}")
    values = json_object(text, path, "trajectories@calibration")
    if not values:
        return None, []
    from openprc.vision.calibration.calibration_file import (  # noqa: PLC0415 - on demand
        calibration_from_dict,
    )

    try:
        return calibration_from_dict(values), []
    except OpenPRCError as error:
        return None, [f"the calibration of the file is not known here: {error.found}"]


def _scalar(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, np.ndarray):
        return [_scalar(item) for item in value.tolist()]
    return value.item() if isinstance(value, np.generic) else value


def wrong(path: Path, key: str, found: str, expected: str) -> UnreadableFile:
    """Return the error for a damaged part."""
    return UnreadableFile(
        found,
        expected=expected,
        fix="load the other parts with components=..., or save the file again",
        file=path,
        key=f"/vision/{key}",
    )
