"""The sidecar: several feature maps in one HDF5 file, replaced as a whole."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from openprc.errors import ConfigError
from openprc.schema import atomic
from openprc.vision.detection.feature_map import PER_FEATURE, FeatureMap

FORMAT = "openprc feature maps 1"
#: Maps that a file holds; the oldest make room. Settings that are tried out would fill the disk.
MOST = 32

_DAMAGE = (
    OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, ConfigError,
)  # fmt: skip


class CacheFile:
    """A sidecar file, that may not be there, be damaged, or be somebody else's.

    Attributes
    ----------
    notes : list of str
        What was met while reading.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []

    def read(self, name: str) -> FeatureMap | None:
        """Return a map, None where it is not there."""
        try:
            if not self.path.is_file():
                return None
            # The file is never changed in place, and some file systems know no locks.
            with h5py.File(self.path, "r", locking=False) as file:
                if file.attrs.get("format") != FORMAT or name not in file:
                    return None
                return _loaded(file[name])
        except _DAMAGE as error:
            self.notes.append(
                f"{self.path.name} is damaged and its features are detected anew: {error}"
            )
            return None

    def add(self, name: str, key: dict[str, Any], made: FeatureMap) -> str | None:
        """Add a map; return why that cannot be done, or None when it is done.

        The whole file is written anew under its own name: two processes may do so at once, and
        whoever is last wins; no reader ever sees half of it.
        """
        try:
            if not self._is_ours():
                return f"{self.path.name} was not made by this cache and stays as it is"
            if _closed_to_all(self.path.parent):
                return f"features cannot be kept in {_folder(self.path)}: it is read-only"
            with (
                atomic.atomic_file(self.path, overwrite=True) as temporary,
                h5py.File(temporary, "w") as file,
            ):
                file.attrs["format"] = FORMAT
                self._copy_others(file, name)
                _store(file.create_group(name), key, made)
                file[name].attrs["number"] = len(file)
        except OSError as error:
            return f"features cannot be kept in {_folder(self.path)}: {error.strerror or error}"
        return None

    def _is_ours(self) -> bool:
        """Whether the file may be replaced: it is not there, empty, or says that it is ours."""
        if not self.path.exists():
            return True
        if not self.path.is_file():
            return False
        # The words stand near the beginning, also of a file that can no longer be opened.
        with self.path.open("rb") as stream:
            start = stream.read(1 << 16)
        return not start or FORMAT.encode() in start

    def _copy_others(self, file: h5py.File, name: str) -> None:
        """Copy the maps that the present file holds, as far as it can be read."""
        if not self.path.exists():
            return
        # A cache may forget, and `read` has told of the damage.
        with suppress(*_DAMAGE), h5py.File(self.path, "r", locking=False) as old:
            others = sorted((other for other in old if other != name), key=_number_in(old))
            for count, other in enumerate(others[-(MOST - 1) :]):
                with suppress(*_DAMAGE):
                    _loaded(old[other])  # what is damaged is not carried on
                    old.copy(other, file)
                    file[other].attrs["number"] = count


def _number_in(file: h5py.File) -> Callable[[str], int]:
    """Return a function that says how many maps are older than a map."""
    return lambda name: int(file[name].attrs.get("number", 0))


def _closed_to_all(folder: Path) -> bool:
    """Whether the folder is marked read-only; an administrator could write there nonetheless."""
    return folder.is_dir() and not folder.stat().st_mode & 0o222


def _folder(path: Path) -> str:
    return path.parent.name or str(path.parent)


def _loaded(group: h5py.Group) -> FeatureMap:
    told = json.loads(group.attrs["about"])
    return FeatureMap(
        **{
            part: np.asarray(group[part])
            for part in PER_FEATURE
            if part != "descriptors" or part in group
        },
        detector_name=told["detector_name"],
        detector_config=told["detector_config"],
        ref_frame_index=told["ref_frame_index"],
        frame_shape=tuple(told["frame_shape"]),
        notes=tuple(told["notes"]),
    )


def _store(group: h5py.Group, key: dict[str, Any], made: FeatureMap) -> None:
    group.attrs["key"] = json.dumps(key)
    about = {
        "detector_name": made.detector_name,
        "detector_config": made.detector_config,
        "ref_frame_index": made.ref_frame_index,
        "frame_shape": list(made.frame_shape),
        "notes": list(made.notes),
    }
    # Of a plugin's own settings that JSON cannot hold, the words are kept.
    group.attrs["about"] = json.dumps(about, default=repr)
    for part in PER_FEATURE:
        value = getattr(made, part)
        if value is not None:
            # The checksum finds damage within the columns.
            group.create_dataset(part, data=value, compression="gzip", fletcher32=True)
