"""The parts of a vision file: their names, and how each is written below ``/vision``.

The layout is that of the older tracker, with more beside it: ``source``, ``feature_map``,
``tracking``, ``trajectories`` and ``signals``. Settings are JSON text; nothing is pickled.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from openprc.errors import ConfigError
from openprc.schema.plain_text import storable

if TYPE_CHECKING:
    from openprc.vision.detection.feature_map import FeatureMap
    from openprc.vision.source.video_source import VideoSource
    from openprc.vision.tracking.result import TrackingResult
    from openprc.vision.trajectories.trajectory_set import TrajectorySet

GROUP = "vision"
VERSION = "1.0"
#: Components of `openprc.vision.save` and the groups that hold them.
PARTS = {
    "source": "source",
    "feature_map": "feature_map",
    "tracking_result": "tracking",
    "trajectory_set": "trajectories",
    "signals": "signals",
}
#: Arrays of a feature map, one row a point.
FEATURES = (
    "keypoints", "descriptors", "sizes", "angles", "responses", "octaves", "track_sigma",
)  # fmt: skip
#: Arrays of a tracking run beyond those that the older layout has.
TRACKING_EXTRAS = ("quality", "sigma", "template", "deformation", "feature_ids")
TRAJECTORY_EXTRAS = ("observed", "quality", "sigma", "template", "positions_px")
#: What the older layout says of a video; the rest is stored as one JSON text.
_FACTS = ("source_type", "path", "fps", "width", "height", "frame_count", "content_hash")


def put(group: h5py.Group, name: str, array: Any) -> None:
    """Store an array compressed; one without elements as it is."""
    data = np.asarray(array)
    packed = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if data.size else {}
    group.create_dataset(name, data=data, **packed)


def as_json(value: Any) -> str:
    """Return settings as JSON text, without folders and without NaN.

    Raises
    ------
    ConfigError
        When something in it has no JSON.
    """
    try:
        return json.dumps(plain(value), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"settings that cannot be stored as JSON: {error}",
            expected="text keys, numbers, text, lists and mappings",
            fix="convert them first",
            key="settings",
        ) from error


def plain(value: Any) -> Any:
    """Return a value as numbers, text, lists and dicts; a path as its base name, NaN as None."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, str):
        return without_folders(value)
    return value.name if isinstance(value, Path) else value


def without_folders(text: str) -> str:
    """Return the base name of an absolute path; any other text as it is."""
    for flavour in (PurePosixPath, PureWindowsPath):
        path = flavour(text)
        if path.is_absolute() and path.name:
            return path.name
    return text


def write_source(group: h5py.Group, source: VideoSource) -> None:
    """Write what identifies a video: never where it lies."""
    described = plain(source.describe())
    for name in _FACTS:
        value = described.pop(name, None)
        if value is not None:
            group.attrs[name] = storable(value, key=name) if isinstance(value, str) else value
    group.attrs["description"] = as_json(described)


def write_feature_map(group: h5py.Group, features: FeatureMap) -> None:
    """Write the points that were detected."""
    for name in FEATURES:
        array = getattr(features, name)
        if array is not None:
            put(group, name, array)
    group.attrs["detector_name"] = storable(features.detector_name, key="detector_name")
    group.attrs["detector_config"] = as_json(features.detector_config)
    group.attrs["ref_frame_index"] = int(features.ref_frame_index)
    group.attrs["frame_shape"] = [int(edge) for edge in features.frame_shape]
    group.attrs["notes"] = as_json(features.notes)


def write_tracking(group: h5py.Group, result: TrackingResult) -> None:
    """Write the raw tracks [px]."""
    for name in ("positions", "status", *TRACKING_EXTRAS):
        put(group, name, getattr(result, name))
    group.create_dataset("timestamps", data=np.asarray(result.timestamps, dtype="f8"))
    group.attrs["fps"] = float(result.fps)
    group.attrs["frame_range"] = [0, int(result.n_frames)]
    group.attrs["reference_frame"] = int(result.reference_frame)
    group.attrs["noise"] = float(result.noise)
    config = None if result.config is None else result.config.as_dict()
    group.attrs["tracker_config"] = as_json(config or {})
    group.attrs["notes"] = as_json(result.notes)
    if result.time_axis is not None:
        axis = plain(result.time_axis)
        axis.pop("times", None)  # they are the timestamps
        group.attrs["time_axis"] = as_json(axis)
    if result.frame_shape is not None:
        group.attrs["frame_shape"] = [int(edge) for edge in result.frame_shape]


def write_trajectories(group: h5py.Group, tracks: TrajectorySet) -> None:
    """Write calibrated tracks, with what was done to them."""
    for name in ("positions", "status", *TRAJECTORY_EXTRAS):
        array = getattr(tracks, name)
        if array is not None:
            kind = "f4" if name == "positions_px" else None
            put(group, name, array if kind is None else np.asarray(array, dtype=kind))
    group.create_dataset("timestamps", data=tracks.timestamps)
    group.create_dataset("feature_ids", data=tracks.feature_ids)
    group.attrs["fps"] = float(tracks.fps)
    group.attrs["units"] = tracks.units
    group.attrs["frame"] = storable(tracks.frame, key="frame")
    group.attrs["axes"] = as_json(tracks.axes)
    calibration = tracks.calibration
    values = {} if calibration is None else calibration.as_dict()
    group.attrs["calibration"] = as_json(values)
    group.attrs["metadata"] = as_json(tracks.metadata)


def write_signals(group: h5py.Group, signals: Any, meta: Mapping[str, Any]) -> None:
    """Write an array of signals; what is said about it as attributes."""
    put(group, "data", signals)
    for name, value in meta.items():
        settled = plain(value)
        simple = isinstance(settled, bool | int | float | str)
        group.attrs[str(name)] = settled if simple else as_json(value)
