"""Telling the files of the older 0.1 packages apart."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import NotATrajectory, OpenPRCError, UnreadableFile
from openprc.schema import safety

#: Where a run lies in a folder.
RUNS = ("output/simulation.h5", "simulation.h5", "experiment.h5")
_MAX_JSON = 16 << 20


@dataclass(frozen=True)
class Kind:
    """What a file is, how sure that is, and for files without a trajectory what to do."""

    name: str
    sureness: float
    what: str
    advice: str = ""

    def refuse(self, path: Path) -> NotATrajectory:
        """Return the error that says what the file is instead of a trajectory."""
        return NotATrajectory(
            f"this is {self.what}, not a trajectory",
            expected="a simulation.h5, a recording, or an experiment folder with a finished run",
            fix=self.advice,
            file=path,
        )


ENGINE = Kind("engine", 1.0, "a run of the older engine")
LABORATORY = Kind("laboratory", 0.7, "a laboratory recording in the layout of the older engine")
TRACKS = Kind("tracks", 0.7, "tracked points of a video")
DISPLACEMENT = Kind("displacement", 0.7, "one displacement, cut from a recording")
VISION = Kind("vision", 1.0, "a result of the older video tracker")

_RUN = "simulate the experiment it belongs to: `openprc run DIR`"
_INFO = "see what is in it with `openprc info FILE`; import the simulation.h5 it was made from"
GEOMETRY = Kind("geometry", 0.7, "the geometry of an experiment (geometry.h5)", _RUN)
SIGNALS = Kind(
    "signals",
    0.7,
    "the signals file of an experiment (signals.h5)",
    _RUN + "; or import its output/simulation.h5, which finds the signals beside it",
)
SETTINGS = Kind("settings", 0.7, "the settings file of an experiment (config.json)", _RUN)
VISUALIZATION = Kind("visualization", 0.7, "a list of faces for display (visualization.h5)", _RUN)
READOUT = Kind("readout", 0.7, "a trained readout", _INFO)
METRICS = Kind("metrics", 0.7, "a file of benchmark results (metrics.h5)", _INFO)
EQUILIBRIA = Kind("equilibria", 0.7, "a list of equilibria", "see it with `openprc info FILE`")
FEATURES = Kind(
    "features",
    0.7,
    "a set of points detected in one image",
    "import the video itself: `openprc import VIDEO`",
)
EXPERIMENT = Kind(
    "experiment",
    0.7,
    "an experiment folder that holds inputs and no finished run",
    "simulate it: `openprc run DIR`",
)
TRAJECTORIES = (ENGINE, LABORATORY, TRACKS, DISPLACEMENT, VISION)


def find_run(folder: Path) -> Path | None:
    """Return the run inside an experiment folder, if there is one."""
    return next((folder / name for name in RUNS if (folder / name).is_file()), None)


def identify(path: Path) -> Kind | None:
    """Say what `path` is, or None when it is none of the older files.

    Raises
    ------
    OpenPRCError
        When a file has the HDF5 signature and cannot be opened safely.
    OSError
        When the path cannot be read at all.
    """
    if path.is_dir():
        run = find_run(path)
        if run is not None:
            kind = identify(run)
            return kind if kind in TRAJECTORIES else None
        inputs = path / "input" if (path / "input").is_dir() else path
        has_both = (inputs / "geometry.h5").is_file() and (inputs / "config.json").is_file()
        return EXPERIMENT if has_both else None
    if not path.is_file() or path.stat().st_size == 0:
        return None
    if not safety.is_hdf5(path):
        return SETTINGS if _is_settings(path) else None
    # Text of variable length is only skipped over here, never read.
    with safety.open_hdf5(path, allow_vlen=True) as file:
        try:
            return _identify_hdf5(file)
        except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
            # Damaged attributes surface as any of these, depending on which byte was hit.
            raise UnreadableFile(
                f"its attributes are damaged: {error}",
                expected="readable HDF5 metadata",
                fix="copy the file again",
                file=path,
            ) from error


def sureness(path: Path) -> float:
    """Return how sure it is that `path` is one of the older files; never raises."""
    try:
        kind = identify(Path(path))
    except (OpenPRCError, OSError):
        return 0.0
    return 0.0 if kind is None else kind.sureness


def _identify_hdf5(file: h5py.File) -> Kind | None:
    if "openprc_schema" in file.attrs:
        return None
    return next((kind for kind, fits in _TESTS if fits(file)), None)


def numeric(parent: h5py.Group, name: str) -> h5py.Dataset | None:
    """Return a dataset of real numbers, or None when there is none of that name."""
    item = parent.get(name)
    good = isinstance(item, h5py.Dataset) and item.shape is not None and item.dtype.kind in "fiu"
    return item if good else None


def shape(file: h5py.File, name: str) -> tuple[int, ...] | None:
    """Return the shape of a dataset of numbers, or None when there is no such dataset."""
    item = numeric(file, name)
    return None if item is None else item.shape


def read(item: h5py.Dataset, rows: slice | None = None) -> NDArray[Any]:
    """Return the numbers of a dataset, or of some rows of it.

    Raises
    ------
    UnreadableFile
        When the bytes on disk are damaged.
    """
    try:
        return np.asarray(item[()] if rows is None else item[rows])
    except (OSError, RuntimeError, ValueError) as error:
        raise UnreadableFile(
            f"the data cannot be read: {error}",
            expected="numbers that can be decoded",
            fix="copy the file again",
            file=item.file.filename,
            key=item.name,
        ) from error


def attribute(owner: h5py.HLObject, name: str, default: float) -> float:
    """Return a number among the attributes, or `default` when there is no such number."""
    value = np.asarray(owner.attrs.get(name, default))
    return float(value) if value.ndim == 0 and value.dtype.kind in "fiub" else default


def _has_series(file: h5py.File) -> bool:
    time, places = shape(file, "time_series/time"), shape(file, "time_series/nodes/positions")
    return time is not None and places is not None and len(places) == 3 and places[2] in (2, 3)


#: What else the engine left, for files whose version was lost when they were copied by hand.
_ENGINE_MARKS = ("source_geometry", "total_frames", "completed")
_ENGINE_PARTS = ("system/kinetic_energy", "system/damping_loss", "time_series/elements/bars/stress")


def _is_engine(file: h5py.File) -> bool:
    if not _has_series(file):
        return False
    marked = "schema_version" in file.attrs or any(name in file.attrs for name in _ENGINE_MARKS)
    return marked or any(shape(file, name) is not None for name in _ENGINE_PARTS)


def _is_tracks(file: h5py.File) -> bool:
    time, places = shape(file, "time"), shape(file, "trajectories")
    return (
        time is not None
        and places is not None
        and len(places) == 3
        and places[2] in (2, 3)
        and time[:1] == places[:1]
    )


def _is_displacement(file: h5py.File) -> bool:
    return shape(file, "displacement") is not None and "fps" in file.attrs


def _is_vision(file: h5py.File) -> bool:
    return any(
        shape(file, f"vision/{part}/positions") is not None
        and shape(file, f"vision/{part}/timestamps") is not None
        for part in ("trajectories", "tracking")
    )


def _is_features(file: h5py.File) -> bool:
    return "vision" in file or {"content_hash", "video_path"} <= set(file.attrs)


def _is_geometry(file: h5py.File) -> bool:
    places = shape(file, "nodes/positions")
    parts = ("nodes/masses", "nodes/attributes", "elements")
    return places is not None and len(places) == 2 and any(part in file for part in parts)


def _is_signals(file: h5py.File) -> bool:
    return "dt_base" in file.attrs


def _is_visualization(file: h5py.File) -> bool:
    return shape(file, "faces") is not None or shape(file, "faces/triangles") is not None


def _is_readout(file: h5py.File) -> bool:
    # Other programs keep weights of networks under that name: what the trainer puts beside them
    # decides.
    named = "task_name" in file.attrs and "feature_config" in file.attrs
    scaled = shape(file, "preprocessing/X_mean") is not None
    return shape(file, "model/weights") is not None and (named or scaled)


def _is_metrics(file: h5py.File) -> bool:
    names = {name for group in file.values() if isinstance(group, h5py.Group) for name in group}
    known = {"capacities", "total_capacity", "linear_memory_capacity"}
    return bool(names & known) or any(name.endswith("_nrmse") for name in names)


def _is_equilibria(file: h5py.File) -> bool:
    return isinstance(file.get("equilibria"), h5py.Group)


#: In order: the first that fits wins.
_TESTS: tuple[tuple[Kind, Callable[[h5py.File], bool]], ...] = (
    (ENGINE, _is_engine),
    (LABORATORY, _has_series),
    (VISION, _is_vision),
    (FEATURES, _is_features),
    (TRACKS, _is_tracks),
    (DISPLACEMENT, _is_displacement),
    (GEOMETRY, _is_geometry),
    (SIGNALS, _is_signals),
    (VISUALIZATION, _is_visualization),
    (READOUT, _is_readout),
    (METRICS, _is_metrics),
    (EQUILIBRIA, _is_equilibria),
)


def _is_settings(path: Path) -> bool:
    if path.suffix.lower() != ".json" or path.stat().st_size > _MAX_JSON:
        return False
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError):
        return False
    if not isinstance(data, dict) or not isinstance(data.get("simulation"), dict):
        return False
    return bool({"global_physics", "physics", "actuators", "openprc_config"} & set(data))
