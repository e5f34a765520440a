"""OpenCV: imported on first use, and what differs between its versions 4 and 5."""

from __future__ import annotations

from typing import Any

from openprc.errors import MissingDependency


def load_cv2() -> Any:
    """Import OpenCV on first use.

    Raises
    ------
    MissingDependency
        When it is not installed.
    """
    try:
        # Half a second, and an optional dependency: never at module level.
        import cv2
    except ImportError as error:
        raise MissingDependency(
            "reading video needs OpenCV, and the module cv2 is not installed",
            expected="the wheel opencv-python-headless, below version 5",
            fix="pip install 'opencv-python-headless<5'",
        ) from error
    return cv2
