"""Feature maps kept beside the video, so that nothing is detected twice."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from openprc import __version__
from openprc.schema import atomic
from openprc.vision.detection.feature_map import PER_FEATURE, FeatureMap
from openprc.vision.detection.registry import ALIASES, detect, get_detector, grey_image, mask_image
from openprc.vision.opencv import load_cv2

SUFFIX = ".features.h5"
_FORMAT = "openprc feature maps 1"


@dataclass
class FeatureMapCache:
    """Detects, or gives what an earlier detection of the same thing found.

    A map is found again only for the same recording (by content, not by name), the same pixels
    of the reference frame, its number, the same mask, detector and settings, and the same
    version of OpenCV. It lies in ``NAME.features.h5`` beside the recording; where that folder
    cannot be written, in `cache_dir` or in the user's cache folder. A file of that name that
    is not ours is never touched.

    Parameters
    ----------
    source : VideoSource
        A source without a file is remembered by this object alone.
    cache_dir : path-like, optional
        Folder for the file, instead of the recording's own.

    Attributes
    ----------
    notes : list of str
        What went otherwise than usual.
    """

    source: Any
    cache_dir: str | Path | None = None
    notes: list[str] = field(default_factory=list)
    _memory: dict[str, FeatureMap] = field(default_factory=dict, repr=False)

    def get_or_detect(
        self,
        image: ArrayLike,
        method: str = "sift",
        *,
        mask: ArrayLike | None = None,
        ref_frame_index: int = 0,
        **settings: Any,
    ) -> FeatureMap:
        """Return the features of the reference frame; parameters as for `detect`."""
        grey = grey_image(image)
        allowed = None if mask is None else mask_image(mask, grey.shape)
        detector = get_detector(method, **settings)
        key = {
            "recording": self._recording(),
            "frame": int(ref_frame_index),
            "shape": list(grey.shape),
            "pixels": hashlib.sha256(grey.tobytes()).hexdigest(),
            "mask": None if allowed is None else hashlib.sha256(allowed.tobytes()).hexdigest(),
            "detector": ALIASES.get(method, method),
            "settings": repr(detector) if hasattr(detector, "features") else repr(settings),
            "opencv": load_cv2().__version__,
            "openprc": __version__,
        }
        name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32]
        if name in self._memory:
            return self._memory[name]
        paths = self._paths()
        for path in paths:
            found = self._read(path, name)
            if found is not None:
                self._memory[name] = found
                return found
        made = detect(grey, method, mask=allowed, ref_frame_index=ref_frame_index, **settings)
        self._memory[name] = made
        for path in paths:
            if self._write(path, name, key, made):
                break
        return made

    def _recording(self) -> str:
        digest = getattr(self.source, "content_hash", None)
        return str(digest()) if digest is not None and self._file() is not None else ""

    def _file(self) -> Path | None:
        path = getattr(self.source, "path", None)
        return None if path is None else Path(path)

    def _paths(self) -> list[Path]:
        """Return where the maps of this recording may lie, best first."""
        file = self._file()
        if file is None:
            return []
        # The pattern of an image sequence is no file name everywhere.
        name = file.name.replace("%", "_").replace("*", "_") + SUFFIX
        if self.cache_dir is not None:
            return [Path(self.cache_dir) / name]
        place = hashlib.sha256(str(file.resolve()).encode()).hexdigest()[:12]
        root = os.environ.get("XDG_CACHE_HOME")
        shared = Path(root) if root else Path.home() / ".cache"
        return [file.with_name(name), shared / "openprc" / "features" / f"{place}-{name}"]

    def _read(self, path: Path, name: str) -> FeatureMap | None:
        try:
            if not path.is_file():
                return None
            with h5py.File(path, "r") as file:
                if file.attrs.get("format") != _FORMAT or name not in file:
                    return None
                group = file[name]
                told = json.loads(group.attrs["about"])
                rows = {part: np.asarray(group[part]) for part in PER_FEATURE if part in group}
                counts = {len(value) for value in rows.values()}
                if len(counts) != 1 or not {*PER_FEATURE} - {"descriptors"} <= set(rows):
                    raise ValueError("columns are missing or of different length")
                return FeatureMap(
                    **rows,
                    detector_name=told["detector_name"],
                    detector_config=told["detector_config"],
                    ref_frame_index=told["ref_frame_index"],
                    frame_shape=tuple(told["frame_shape"]),
                    notes=tuple(told["notes"]),
                )
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            self._tell(f"{path.name} is damaged and its features are detected anew: {error}")
            return None

    def _write(self, path: Path, name: str, key: dict[str, Any], made: FeatureMap) -> bool:
        """Add a map to the file; False where it cannot be written."""
        try:
            kept = _ours(path)
            if kept is None:
                self._tell(f"{path.name} was not made by this cache and stays as it is")
                return False
            # The whole file is written anew under its own name: two processes may do so at
            # once, and whoever is last wins; no reader ever sees half of it.
            with (
                atomic.atomic_file(path, overwrite=True) as temporary,
                h5py.File(temporary, "w") as file,
            ):
                file.attrs["format"] = _FORMAT
                if kept:
                    with h5py.File(path, "r") as old:
                        for other in old:
                            if other != name:
                                old.copy(other, file)
                _store(file.create_group(name), key, made)
                file.flush()
        except OSError as error:
            self._tell(
                f"features cannot be kept in {path.parent.name or path.parent}: "
                f"{error.strerror or error}"
            )
            return False
        return True

    def _tell(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _ours(path: Path) -> bool | None:
    """Tell whether the file holds maps to be kept; None for somebody else's file."""
    if not path.exists():
        return False
    try:
        with h5py.File(path, "r") as file:
            return True if file.attrs.get("format") == _FORMAT else None
    except OSError:
        # A damaged file under our own suffix.
        return False


def _store(group: h5py.Group, key: dict[str, Any], made: FeatureMap) -> None:
    group.attrs["key"] = json.dumps(key)
    group.attrs["about"] = json.dumps(
        {
            "detector_name": made.detector_name,
            "detector_config": made.detector_config,
            "ref_frame_index": made.ref_frame_index,
            "frame_shape": list(made.frame_shape),
            "notes": list(made.notes),
        }
    )
    for part in PER_FEATURE:
        value = getattr(made, part)
        if value is not None:
            # Damage is found by the checksum, which needs chunks and so at least one row.
            group.create_dataset(part, data=value, compression="gzip", fletcher32=True)
