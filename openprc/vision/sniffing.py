"""How sure one may be that a path is a recording, without a decoder."""

from __future__ import annotations

import re
from pathlib import Path

from openprc.errors import OpenPRCError

SUFFIXES = (".avi", ".mp4", ".mkv", ".webm", ".mov", ".mpg", ".mpeg", ".m4v", ".y4m", ".wmv")
_IMAGES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".pgm")
_NUMBERED = re.compile(r"\d")
#: Files of a folder that are looked at.
_ENOUGH = 200


def sniff_video(path: Path) -> float:
    """Return how sure it is that `path` is a recording.

    0.7 for a file that begins like a video container, for a header of a high-speed camera, and
    for a folder that holds little but numbered images; 0.3 where only the name says so; else 0.
    """
    from openprc.vision.source.containers import container  # noqa: PLC0415 - kept light

    suffix = path.suffix.lower()
    try:
        if path.is_dir():
            return _folder(path)
        if path.is_file():
            if container(path) is not None:
                return 0.7
            if suffix in (".cih", ".cihx", ".mraw"):
                return _high_speed(path)
    except OSError:
        return 0.0
    return 0.3 if suffix in SUFFIXES else 0.0


def _folder(path: Path) -> float:
    found = []
    for count, item in enumerate(path.iterdir()):
        if count == _ENOUGH:
            break
        if not item.name.startswith("."):
            found.append(item)
    images = [
        item for item in found if item.suffix.lower() in _IMAGES and _NUMBERED.search(item.stem)
    ]
    return 0.7 if len(images) >= 2 and len(images) > len(found) / 2 else 0.0


def _high_speed(path: Path) -> float:
    from openprc.vision.source.raw_recording import RawRecording  # noqa: PLC0415 - kept light

    try:
        # Raw frames have nothing to be known by; their header says how large they are.
        RawRecording(path)
    except OpenPRCError:
        return 0.3
    return 0.7
