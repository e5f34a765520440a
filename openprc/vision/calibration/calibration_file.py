"""Calibrations as JSON files, with their units and how well they are known."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

from openprc.errors import CalibrationError, OpenPRCError, SchemaTooNew, UnreadableFile
from openprc.schema.atomic import atomic_file

FORMAT = "openprc-calibration"
VERSION = 1

#: Kind to the class that has `from_dict`; imported when such a file is read.
_KINDS = {
    "normalized": ("openprc.vision.calibration.normalized", "NormalizedCalibration"),
    "scale-bar": ("openprc.vision.calibration.scale_bar", "ScaleBar"),
    "camera": ("openprc.vision.calibration.camera", "CameraCalibration"),
    "plane": ("openprc.vision.calibration.planar", "PlanarTarget"),
    "stereo": ("openprc.vision.calibration.stereo", "StereoRig"),
}
_OPENCV_ENDINGS = (".yml", ".yaml", ".xml")


def save_calibration(path: str | Path, calibration: Any, *, overwrite: bool = False) -> Path:
    """Write a calibration of any kind, in one step.

    Raises
    ------
    ResultExists
        When the file is there and `overwrite` is not set.
    """
    path = Path(path)
    values = {"format": FORMAT, "version": VERSION, **calibration.as_dict()}
    text = json.dumps(values, indent=2, allow_nan=False) + "\n"
    with atomic_file(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def load_calibration(path: str | Path) -> Any:
    """Read a calibration: ours, or OpenCV's YAML and XML (then in units of the distance).

    Raises
    ------
    UnreadableFile
        When the file is missing or holds something else.
    CalibrationError
        When an entry is missing or makes no sense.
    """
    # Reading text is all that this takes from the module of OpenCV's files.
    from openprc.vision.calibration.opencv_file import read_text  # noqa: PLC0415

    path = Path(path)
    text = read_text(path)
    if path.suffix.lower() in _OPENCV_ENDINGS or "opencv-matrix" in text:
        from openprc.vision.calibration.camera import CameraCalibration  # noqa: PLC0415 - rare

        return CameraCalibration.from_opencv_yaml(path)
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableFile(
            f"the file is not JSON ({error})",
            expected="a file that openprc calibrate or save_calibration wrote",
            fix="calibrate again, or read OpenCV's file with CameraCalibration.from_opencv_yaml",
            file=path,
        ) from error
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise UnreadableFile(
            "this JSON file is no calibration",
            expected=f'an object with "format": "{FORMAT}"',
            fix="calibrate again with openprc calibrate",
            file=path,
            key="format",
        )
    version = values.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise SchemaTooNew(
            f"the file has the version {version!r}",
            expected=f"a whole number up to {VERSION}",
            fix="install a newer openprc",
            file=path,
            key="version",
        )
    del values["format"], values["version"]
    return calibration_from_dict(values, file=path)


def calibration_from_dict(values: dict[str, Any], *, file: str | Path | None = None) -> Any:
    """Make a calibration from what its `as_dict` returned.

    Raises
    ------
    CalibrationError
        When the kind is unknown, or an entry is missing, unknown or makes no sense.
    """
    kind = values.get("kind")
    if kind not in _KINDS:
        raise CalibrationError(
            f"the kind of calibration is {kind!r}",
            expected="one of " + " ".join(_KINDS),
            fix="calibrate again with openprc calibrate",
            file=file,
            key="kind",
        )
    module, name = _KINDS[kind]
    maker = getattr(import_module(module), name)
    try:
        return maker.from_dict(dict(values))
    except OpenPRCError as error:
        if error.file is None and file is not None:
            raise type(error)(
                error.found, expected=error.expected, fix=error.fix, file=file, key=error.key
            ) from error
        raise
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise CalibrationError(
            f"the entries do not make a calibration of the kind {kind!r} "
            f"({type(error).__name__}: {error})",
            expected="the entries that save_calibration writes",
            fix="calibrate again with openprc calibrate",
            file=file,
        ) from error
