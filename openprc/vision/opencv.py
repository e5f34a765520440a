"""OpenCV: imported on first use, and what differs between its versions 4 and 5."""

from __future__ import annotations

from functools import cache
from importlib.metadata import distributions
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
            f"reading video needs OpenCV, and the module cv2 cannot be imported: {error}",
            expected="the wheel opencv-python-headless, below version 5, which needs no display",
            fix="pip install 'opencv-python-headless<5'",
        ) from error
    return cv2


def major_version() -> int:
    """Return 4 or 5, the version of OpenCV that is installed."""
    return int(load_cv2().__version__.split(".")[0])


def make_akaze(**settings: Any) -> Any:
    """Return OpenCV's AKAZE, which version 5 has among its contributed modules only.

    Raises
    ------
    MissingDependency
        When this build has no AKAZE.
    """
    cv2 = load_cv2()
    make = getattr(cv2, "AKAZE_create", None)
    if make is None:
        make = getattr(getattr(cv2, "xfeatures2d", None), "AKAZE_create", None)
    if make is None:
        raise MissingDependency(
            f"OpenCV {cv2.__version__} as it is installed has no AKAZE",
            expected="OpenCV 4, or version 5 with the contributed modules",
            fix="pip install 'opencv-python-headless<5', or opencv-contrib-python-headless, or "
            "choose another detector",
            key="detector",
        )
    return make(**settings)


@cache
def wheels() -> tuple[str, ...]:
    """Return the names of the wheels that bring OpenCV.

    More than one is a defect of the environment: they write the same files, and what is
    imported is a mixture of them.
    """
    found = {(d.metadata["Name"] or "").lower().replace("_", "-") for d in distributions()}
    return tuple(sorted(name for name in found if name.startswith("opencv-")))


def conflict_note() -> str | None:
    """Return what to tell when several wheels of OpenCV overwrite each other, or None."""
    if len(wheels()) < 2:
        return None
    return (
        f"several wheels of OpenCV are installed over each other: {', '.join(wheels())}; "
        "uninstall all of them and install one"
    )
