"""One way to open whatever a caller passes as a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from openprc.errors import ConfigError
from openprc.vision.source.arrays import ArraySource
from openprc.vision.source.video_source import VideoSource


def open_source(source_or_path: Any, **options: Any) -> VideoSource:
    """Return a source for a path, for images in memory, or the source itself.

    Parameters
    ----------
    source_or_path : VideoSource, path-like, list of paths, (T, H, W[, 3]) array, or images
    **options
        Those of `VideoSource` or `ArraySource`.

    Raises
    ------
    ConfigError
        Options for a source that is open already.
    """
    if isinstance(source_or_path, str | Path):
        return VideoSource(source_or_path, **options)
    if isinstance(source_or_path, VideoSource) or hasattr(source_or_path, "frames"):
        if options:
            raise ConfigError(
                f"the source is open and the options {', '.join(sorted(options))} come too late",
                expected="options on opening",
                fix="pass them where the source is made",
            )
        opened: VideoSource = source_or_path
        return opened
    if isinstance(source_or_path, list | tuple) and all(
        isinstance(item, str | Path) for item in source_or_path
    ):
        return VideoSource(source_or_path, **options)
    return ArraySource(source_or_path, **options)
