"""Calibrations in OpenCV's own files (YAML, XML, JSON) and in ROS's camera_info."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from openprc.errors import CalibrationError, UnreadableFile
from openprc.vision.calibration.mapping import Array
from openprc.vision.opencv import load_cv2

#: Names that programs use for the same thing, in order of preference.
MATRIX = (
    "camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "intrinsic_matrix", "intrinsics", "mtx",
)  # fmt: skip
DISTORTION = (
    "distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "dist", "D",
    "distortion",
)  # fmt: skip
WIDTH = ("image_width", "image_Width", "imageWidth", "width")
HEIGHT = ("image_height", "image_Height", "imageHeight", "height")
RMS = ("avg_reprojection_error", "Avg_Reprojection_Error", "rms", "reprojection_error")
#: A calibration is some kilobytes, with all its board corners some hundreds.
LARGEST = 16 << 20


def read_text(path: str | Path) -> str:
    """Return the text of a calibration file.

    Raises
    ------
    UnreadableFile
        When it is missing, a folder, empty, too large or not text.
    """
    path = Path(path)
    expected = "a calibration file of OpenCV (YAML, XML, JSON), ROS or openprc calibrate"
    if not path.is_file():
        raise UnreadableFile(
            "this is a folder" if path.is_dir() else "there is no such file",
            expected=expected,
            fix="check the path",
            file=path,
        )
    size = path.stat().st_size
    if size == 0 or size > LARGEST:
        raise UnreadableFile(
            "the file is empty" if size == 0 else f"the file has {size} bytes",
            expected=expected,
            fix="write the calibration again" if size == 0 else "this is something else",
            file=path,
        )
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise UnreadableFile(
            "the file is not text",
            expected=expected,
            fix="a pickle or .npz is not read: load it yourself and use "
            "CameraCalibration.from_matrix",
            file=path,
        )
    return text


def read_opencv_file(path: str | Path) -> dict[str, Any]:
    """Return K, dist, and where the file says so frame_shape and rms.

    Raises
    ------
    UnreadableFile
        When the file cannot be parsed.
    CalibrationError
        When there is no intrinsic matrix in it.
    """
    text = read_text(path)
    start = text.lstrip()[:5]
    if not start.startswith(("%YAML", "<?xml", "<open", "{")):
        # ROS writes YAML without the heading that OpenCV 4 asks for.
        text = "%YAML:1.0\n---\n" + text
    cv2 = load_cv2()
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        nodes = {name: storage.getNode(name) for name in storage.root().keys()}  # noqa: SIM118 - no dict
    except (cv2.error, SystemError) as error:
        # The constructor of the binding raises SystemError with the real one as its cause.
        reason = error.__cause__ or error
        raise UnreadableFile(
            f"OpenCV cannot parse the file ({_first_line(reason)})",
            expected="a file that cv2.FileStorage wrote, or a ROS camera_info",
            fix="write the calibration again, or use CameraCalibration.from_matrix",
            file=path,
        ) from error
    # Everything is taken out while `storage` lives; the nodes point into it.
    model = _text(nodes.get("distortion_model"))
    if model not in ("", "plumb_bob", "rational_polynomial"):
        raise CalibrationError(
            f"the distortion model is {model!r}",
            expected="plumb_bob or rational_polynomial: OpenCV's pinhole camera",
            fix="calibrate with a pinhole model; a fisheye lens is not supported",
            file=path,
            key="distortion_model",
        )
    matrix = _first(nodes, MATRIX)
    if matrix is None:
        raise CalibrationError(
            "there is no intrinsic matrix; the file has " + (", ".join(nodes) or "no entries"),
            expected="one of " + " ".join(MATRIX),
            fix="rename the entry, or use CameraCalibration.from_matrix",
            file=path,
        )
    name, values = matrix
    if values.size != 9:
        raise CalibrationError(
            f"the intrinsic matrix has {values.size} numbers",
            expected="9 numbers, row after row",
            fix="write the 3 x 3 matrix of the calibration",
            file=path,
            key=name,
        )
    found: dict[str, Any] = {"K": values.reshape(3, 3), "dist": None}
    dist = _first(nodes, DISTORTION)
    if dist is not None:
        found["dist"] = dist[1]
    else:
        found["notes"] = (f"{Path(path).name} has no distortion coefficients: none are applied",)
    width, height = _first(nodes, WIDTH), _first(nodes, HEIGHT)
    if width is not None and height is not None:
        found["frame_shape"] = (int(height[1][0]), int(width[1][0]))
    rms = _first(nodes, RMS)
    if rms is not None and rms[1].size == 1:
        found["rms"] = float(rms[1][0])
    return found


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__


def _text(node: Any) -> str:
    return str(node.string()) if node is not None and node.isString() else ""


def _first(nodes: dict[str, Any], names: tuple[str, ...]) -> tuple[str, Array] | None:
    for name in names:
        values = None if name not in nodes else _numbers(nodes[name])
        if values is not None:
            return name, values
    return None


def _numbers(node: Any) -> Array | None:
    """The numbers of a matrix of any number of axes, of a list, or of a scalar."""
    if node.isMap():
        node = node.getNode("data")
    if node.isSeq():
        rows = [node.at(i) for i in range(node.size())]
        if any(row.isSeq() for row in rows):
            rows = [row.at(i) for row in rows if row.isSeq() for i in range(row.size())]
        if not all(row.isInt() or row.isReal() for row in rows):
            return None
        return np.array([row.real() for row in rows])
    if node.isInt() or node.isReal():
        return np.array([node.real()])
    return None
