"""`save`: everything of a video experiment in one file, which is a simulation.h5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from openprc import __version__
from openprc.errors import ConfigError
from openprc.schema.atomic import atomic_file
from openprc.vision.storage import parts
from openprc.vision.storage.simulation import write_simulation
from openprc.vision.trajectories.trajectory_set import TrajectorySet

if TYPE_CHECKING:
    from openprc.vision.detection.feature_map import FeatureMap
    from openprc.vision.source.video_source import VideoSource
    from openprc.vision.tracking.result import TrackingResult


def save(
    path: str | Path,
    *,
    source: VideoSource | None = None,
    feature_map: FeatureMap | None = None,
    tracking_result: TrackingResult | None = None,
    trajectory_set: TrajectorySet | None = None,
    signals: ArrayLike | None = None,
    signals_meta: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write any of the components into one file.

    With a `trajectory_set`, or else a `tracking_result`, the file is a simulation.h5: positions,
    mask, quality and uncertainty stand where the contract has them, and `StateLoader` reads it
    like any other run. All components stand below ``/vision`` as well, each to be read back by
    `openprc.vision.load`. Without trajectories the file holds only that, is no simulation.h5, and
    says so.

    Parameters
    ----------
    path : path-like
    source : VideoSource, optional
        Stored as its name, size, rate and hash, never as the folder where it lies.
    feature_map : FeatureMap, optional
    tracking_result : TrackingResult, optional
    trajectory_set : TrajectorySet, optional
    signals : (T, N) or (T, N, d), optional
    signals_meta : mapping, optional
        What there is to say about the signals: dim, units, ...
    overwrite : bool
        Replace a file of this name, once the new one is whole.

    Returns
    -------
    Path
        Of the file, which appears under its name when it is complete.

    Raises
    ------
    ConfigError
        When there is nothing to save, or the signals are no numbers.
    ResultExists
        When `path` exists and `overwrite` is false.
    """
    given = {
        "source": source, "feature_map": feature_map, "tracking_result": tracking_result,
        "trajectory_set": trajectory_set, "signals": signals,
    }  # fmt: skip
    if all(value is None for value in given.values()):
        raise ConfigError(
            "there is nothing to save",
            expected="at least one of " + ", ".join(given),
            fix="pass what is to be kept",
            key="save",
        )
    if signals_meta and signals is None:
        raise ConfigError(
            "signals_meta without signals",
            expected="the signals that it speaks of",
            fix="pass signals, or leave signals_meta out",
            key="signals_meta",
        )
    data = None if signals is None else _numbers(signals)
    tracks = trajectory_set
    if tracks is None and tracking_result is not None:
        tracks = TrajectorySet.from_tracking_result(tracking_result)
    path = Path(path)
    with atomic_file(path, overwrite=overwrite) as temporary:
        if tracks is not None:
            _simulation(temporary, tracks, given)
        with h5py.File(temporary, "r+" if tracks is not None else "w") as file:
            group = file.create_group(parts.GROUP)
            group.attrs.update({"version": parts.VERSION, "openprc_version": __version__})
            if tracks is None:
                file.attrs["comment"] = (
                    "part of a video experiment, without trajectories: no simulation.h5"
                )
            for name, value in given.items():
                if value is not None:
                    _write(group.create_group(parts.PARTS[name]), name, value, data, signals_meta)
    return path


def _simulation(path: Path, tracks: TrajectorySet, given: Mapping[str, Any]) -> None:
    source, result = given["source"], given["tracking_result"]
    notes = [*getattr(source, "notes", ()), *getattr(result, "notes", ())]
    settings: dict[str, Any] = {}
    if tracks.calibration is not None:
        settings["calibration"] = tracks.calibration.as_dict()
    if result is not None and result.config is not None:
        settings["tracker"] = result.config.as_dict()
    if given["feature_map"] is not None:
        settings["detector"] = {
            "name": given["feature_map"].detector_name,
            **dict(given["feature_map"].detector_config),
        }
    video = getattr(source, "path", None)
    read = [(Path(video), "video")] if video is not None and Path(video).exists() else []
    write_simulation(path, tracks, sources=read, notes=notes, settings=settings)


def _write(
    group: h5py.Group, name: str, value: Any, data: Any, meta: Mapping[str, Any] | None
) -> None:
    if name == "signals":
        parts.write_signals(group, data, meta or {})
        return
    {
        "source": parts.write_source,
        "feature_map": parts.write_feature_map,
        "tracking_result": parts.write_tracking,
        "trajectory_set": parts.write_trajectories,
    }[name](group, value)


def _numbers(signals: ArrayLike) -> Any:
    data = np.asarray(signals)
    if data.dtype.kind not in "fiu" or data.ndim not in (2, 3):
        raise ConfigError(
            f"signals of type {data.dtype} and shape {data.shape}",
            expected="real numbers of shape (T, N) or (T, N, d)",
            fix="pass what TrajectorySet.to_signals returns",
            key="signals",
        )
    return data
