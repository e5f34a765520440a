"""One way to open whatever a caller passes as a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from openprc.vision.source.arrays import ArraySource
from openprc.vision.source.video_source import VideoSource


def open_source(source_or_path: Any, **options: Any) -> VideoSource:
    """Return a source for a path, for images in memory, or the source itself.

    Parameters
    ----------
    source_or_path : VideoSource, path-like, (T, H, W[, 3]) array, or list of images
    **options
        Those of `VideoSource` or `ArraySource`; refused for a source that is open already.
    """
    if isinstance(source_or_path, str | Path):
        return VideoSource(source_or_path, **options)
    if isinstance(source_or_path, np.ndarray | list | tuple):
        return ArraySource(source_or_path, **options)
    return source_or_path
