"""The intrinsic matrix of a pinhole camera: what is one, and what looks wrong about it."""

from __future__ import annotations

from typing import Any

import numpy as np

from openprc.errors import CalibrationError
from openprc.vision.calibration.mapping import Array


def intrinsic_matrix(found: Any, *, key: str = "K") -> Array:
    """Return an intrinsic matrix as a new array (3, 3).

    Raises
    ------
    CalibrationError
    """
    expected = "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0, in pixels"
    try:
        matrix = np.array(found, np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise CalibrationError(
            f"the intrinsic matrix has the shape {matrix.shape}"
            + ("" if np.isfinite(matrix).all() else " and values that are not finite"),
            expected=expected,
            fix="pass the matrix as the calibration of the camera wrote it",
            key=key,
        )
    if (
        matrix[0, 0] <= 0.0
        or matrix[1, 1] <= 0.0
        or matrix[1, 0] != 0.0
        or any(matrix[2] != (0.0, 0.0, 1.0))
    ):
        transposed = bool(matrix[2, 0] and not matrix[0, 2])
        raise CalibrationError(
            f"{matrix.tolist()} is no intrinsic matrix",
            expected=expected,
            fix="transpose it" if transposed else "check the order of the numbers",
            key=key,
        )
    return matrix


def doubts(matrix: Array, shape: tuple[int, int]) -> list[str]:
    """Return what looks wrong about a matrix without being impossible."""
    height, width = shape
    cx, cy = matrix[:2, 2]
    found = []
    if abs(cx - 0.5 * (width - 1)) > 0.25 * width or abs(cy - 0.5 * (height - 1)) > 0.25 * height:
        found.append(
            f"the principal point ({cx:.1f}, {cy:.1f}) px is far from the middle of a "
            f"{width}x{height} image: does the matrix belong to images of this size, and is "
            "frame_shape (height, width)?"
        )
    if abs(matrix[0, 0] / matrix[1, 1] - 1.0) > 0.05:
        found.append(
            f"the focal lengths {matrix[0, 0]:.1f} and {matrix[1, 1]:.1f} px differ by more than "
            "5 %: pixels are rarely that far from square"
        )
    return found
