"""Feature maps kept beside the video, so that nothing is detected twice."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc import __version__
from openprc.vision.detection.cache_file import CacheFile
from openprc.vision.detection.detectors import OpenCVDetector
from openprc.vision.detection.feature_map import FeatureMap
from openprc.vision.detection.images import grey_image, mask_image
from openprc.vision.detection.registry import detect, get_detector, identity
from openprc.vision.opencv import conflict_note, load_cv2

SUFFIX = ".fmap.h5"


@dataclass
class FeatureMapCache:
    """Detects, or gives what an earlier detection of the same thing found.

    A map is found again only for the same recording (by content, not by name), the same pixels
    of the reference frame, its number, the same mask, detector and settings, and the same
    versions of OpenCV and of the detector. It lies in ``NAME.fmap.h5`` beside the recording, or
    beside the folder of images; where that place cannot be written, or holds a file of that
    name that is not ours, in the user's cache folder, with a note. A detector that was
    registered with `register_detector` is asked every time, because its code may change without
    a sign; so is a plugin's whose settings are more than plain numbers and texts.

    Parameters
    ----------
    source : VideoSource
        A source without a file is remembered by this object alone.
    cache_dir : path-like, optional
        Folder for the file, instead of the recording's own and the user's.

    Attributes
    ----------
    notes : list of str
        What went otherwise than usual; the maps that are returned have it, too.
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
        """Return the features of the reference frame; parameters as for `detect`.

        Images deeper than 8 bits are scaled as the source scales its frames; of 8 bits are taken
        as they are.
        """
        grey, told = self._grey(image)
        allowed = None if mask is None else mask_image(mask, grey.shape)
        detector = get_detector(method, **settings)
        kind, said = identity(method), _said(detector, settings)
        if kind is None or said is None:
            anew = detect(grey, method, mask=allowed, ref_frame_index=ref_frame_index, **settings)
            return replace(anew, notes=(*told, *anew.notes))
        key = {
            "recording": self._recording(),
            "frame": int(ref_frame_index),
            "shape": list(grey.shape),
            "pixels": hashlib.sha256(grey.tobytes()).hexdigest(),
            "mask": None if allowed is None else hashlib.sha256(allowed.tobytes()).hexdigest(),
            "detector": kind,
            "settings": said,
            "opencv": load_cv2().__version__,
            "openprc": __version__,
        }
        name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32]
        files = [CacheFile(path) for path in self._paths()]
        made = self._memory.get(name)
        for file in files:
            if made is None:
                made = file.read(name)
                self._tell(*file.notes)
        if made is None:
            made = detect(grey, method, mask=allowed, ref_frame_index=ref_frame_index, **settings)
            # What is wrong with the environment today is not kept.
            lasting = tuple(note for note in made.notes if note != conflict_note())
            made = replace(made, notes=(*told, *lasting))
            self._write(files, name, key, made)
        self._memory[name] = made
        today = (conflict_note(),) if conflict_note() else ()
        return replace(made, notes=(*made.notes, *today, *self.notes))

    def _grey(self, image: ArrayLike) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
        from openprc.vision.source.interlacing import looks_like_mosaic  # noqa: PLC0415 - light

        given = np.asarray(image)
        bayer = getattr(self.source, "bayer", None)
        if bayer is not None and not (given.ndim == 2 and looks_like_mosaic(given)):
            bayer = None  # a frame that has been made grey already
        deep = given.dtype != np.uint8
        value_range = getattr(self.source, "value_range", None) if deep else None
        return grey_image(given, value_range=value_range, bayer=bayer)

    def _write(
        self, files: list[CacheFile], name: str, key: dict[str, Any], made: FeatureMap
    ) -> None:
        for position, file in enumerate(files):
            problem = file.add(name, key, made)
            if problem is None:
                return
            rest = files[position + 1 :]
            place = "they are kept in the user's cache folder" if rest else "nothing is kept"
            self._tell(f"{problem}; {place}")

    def _recording(self) -> str:
        return str(self.source.content_hash()) if self._file() is not None else ""

    def _file(self) -> Path | None:
        path = getattr(self.source, "path", None)
        return None if path is None else Path(path).absolute()

    def _paths(self) -> list[Path]:
        """Return where the maps of this recording may lie, best first."""
        file = self._file()
        if file is None:
            return []
        # A folder may be given as "."; the pattern of an image sequence is no file name
        # everywhere.
        file = file.resolve() if file.exists() else file
        name = file.name.replace("%", "_").replace("*", "_").replace("?", "_") + SUFFIX
        if self.cache_dir is not None:
            return [Path(self.cache_dir) / name]
        place = hashlib.sha256(str(file).encode("utf-8", "surrogateescape")).hexdigest()[:12]
        shared = user_cache_folder()
        beside = [file.with_name(name)]
        return beside if shared is None else [*beside, shared / f"{place}-{name}"]

    def _tell(self, *texts: str) -> None:
        self.notes.extend(text for text in texts if text not in self.notes)


def user_cache_folder() -> Path | None:
    """Return where this user's maps lie that cannot lie beside their recording, or None."""
    root = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    if root:
        return Path(root) / "openprc" / "features"
    try:
        home = Path.home()
    except RuntimeError:
        # A service without a home.
        return None
    caches = home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache"
    return caches / "openprc" / "features"


def _said(detector: Any, settings: dict[str, Any]) -> str | None:
    """Return all settings in words, defaults included where known; None where words fail."""
    if isinstance(detector, OpenCVDetector):
        return repr(detector)
    try:
        return json.dumps(settings, sort_keys=True)
    except TypeError:
        return None
