"""What the importer of videos was asked for: options, checked before the first frame is read."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from openprc.errors import CalibrationError, ConfigError
from openprc.vision.drive import Drive, read_drive

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LENGTH = re.compile(rf"\s*({_NUMBER})\s*([A-Za-z]+)\s*\Z")


@dataclass(frozen=True, kw_only=True)
class ImportSettings:
    """Options of the producer ``vision``, each in the form in which it is used.

    The names are those of the options; see ``openprc plugins vision`` and docs/vision.md.
    """

    detector: str = "shi-tomasi"
    max_points: int = 100
    spacing: float | None = None
    points: Path | None = None
    mask: Path | None = None
    reference_frame: int = 0
    refine: str = "icgn"
    subset: int = 21
    model: str = "auto"
    win_size: int = 21
    levels: int | str = "auto"
    fb_threshold: float = 0.2
    fps: float | None = None
    value_range: tuple[float, float] | None = None
    strict: bool = False
    calibration: Path | None = None
    scale_bar: tuple[tuple[float, float], tuple[float, float], float, str] | None = None
    y_up: bool = False
    stabilise: bool = False
    min_ratio: float = 0.0
    moving: float = 0.0
    max_gap: int = 0
    smooth: int = 0
    rate: float | None = None
    bars: Path | None = None
    drive: Drive | None = None
    drive_marker: int | tuple[float, float] | None = None
    keep_marker: bool = False

    @classmethod
    def from_options(cls, options: Mapping[str, Any]) -> ImportSettings:
        """Read the options of an importer; what is left out or None takes its default.

        Raises
        ------
        ConfigError
            An option is out of range, or two of them contradict each other.
        OpenPRCError
            As `openprc.vision.drive.read_drive`.
        """
        given = {key: value for key, value in options.items() if value is not None}
        drive_words = {
            name: given.pop(f"drive_{name}", None) for name in ("hold", "start", "unit", "quantity")
        }
        known = {field.name for field in dataclasses.fields(cls)}
        values = {key: value for key, value in given.items() if key in known}
        for key, read in _READERS.items():
            if key in values:
                values[key] = read(values[key])
        for key, (least, most, words) in _RANGES.items():
            if key in values and not least <= values[key] <= most:
                raise ConfigError(
                    f"{key} is {values[key]:g}", expected=words, fix="correct it", key=key
                )
        words = {key: value for key, value in drive_words.items() if value is not None}
        if "drive" in values:
            values["drive"] = read_drive(values["drive"], **words)
        elif words:
            raise ConfigError(
                f"drive_{next(iter(words))} is given and there is no drive",
                expected="drive=FILE.csv beside it",
                fix="name the file, or leave the option out",
                key=f"drive_{next(iter(words))}",
            )
        for one, other in (("drive", "drive_marker"), ("calibration", "scale_bar")):
            if one in values and other in values:
                raise ConfigError(
                    f"both {one} and {other} are given",
                    expected="one of them",
                    fix="leave one out",
                    key=other,
                )
        settings = cls(**values)
        if settings.y_up and settings.calibration is None and settings.scale_bar is None:
            raise ConfigError(
                "y_up is set, and positions stay in px of the image, whose y points down",
                expected="a calibration, whose y axis is turned",
                fix="give scale_bar or calibration, or leave y_up out",
                key="y_up",
            )
        return settings

    @property
    def processed(self) -> bool:
        """Whether tracks are changed over time before they are written."""
        return bool(self.stabilise or self.max_gap or self.smooth or self.rate)

    def tracker_config(self) -> Any:
        """Return the settings of the tracker."""
        from openprc.vision.tracking.config import KLTConfig  # noqa: PLC0415 - kept light
        from openprc.vision.tracking.refinement import RefineSettings  # noqa: PLC0415

        return KLTConfig(
            win_size=(self.win_size, self.win_size),
            max_level=self.levels,  # type: ignore[arg-type]
            fb_threshold=self.fb_threshold,
            refine=self.refine,  # type: ignore[arg-type]
            refinement=RefineSettings(subset=self.subset, model=self.model),  # type: ignore[arg-type]
        )

    def mapping(self, shape: tuple[int, int]) -> tuple[Any, tuple[str, ...]]:
        """Return the calibration for images of (height, width) [px], or None, and notes.

        Raises
        ------
        CalibrationError
            When it belongs to images of another shape, or to two cameras.
        """
        if self.scale_bar is not None:
            from openprc.vision.calibration.scale_bar import ScaleBar  # noqa: PLC0415 - kept light

            p0, p1, length, symbol = self.scale_bar
            origin = (0.0, shape[0] - 1.0) if self.y_up else (0.0, 0.0)
            bar = ScaleBar(p0, p1, length, symbol, origin=origin, y_up=self.y_up, frame_shape=shape)
            for x, y in (p0, p1):
                if not (-0.5 <= x <= shape[1] - 0.5 and -0.5 <= y <= shape[0] - 0.5):
                    raise ConfigError(
                        f"an end of the scale bar lies at ({x:g}, {y:g})",
                        expected=f"px inside the image of {shape[1]} x {shape[0]}",
                        fix="read both ends off a frame of this video",
                        key="scale_bar",
                    )
            share = float(bar.relative_sigma)
            note = (
                f"one scale for the whole image, {bar.scale:.6g} {symbol} a px, known to "
                f"{100 * share:.2g} % (ends of the bar to {bar.sigma_px:g} px)"
            )
            return bar, (note,)
        if self.calibration is None:
            return None, ()
        return self._from_file(shape)

    def _from_file(self, shape: tuple[int, int]) -> tuple[Any, tuple[str, ...]]:
        # Kept light: nothing is imported for a run without a calibration.
        from openprc.vision.calibration.calibration_file import load_calibration  # noqa: PLC0415

        found = load_calibration(self.calibration)  # type: ignore[arg-type]
        if not hasattr(found, "to_physical"):
            raise CalibrationError(
                f"this is the calibration of a {getattr(found, 'kind', 'stereo')} rig",
                expected="that of one camera: one video is tracked",
                fix="track both videos, and triangulate with StereoRig in Python",
                file=self.calibration,
                key="calibration",
            )
        if self.y_up and not found.y_up:
            found = found.turned_up()
        check = found.check_frame(shape)
        if check.warning:
            raise CalibrationError(
                check.warning,
                expected="a calibration of this camera at this size",
                fix="calibrate with images of the recording's size",
                file=self.calibration,
                key="calibration",
            )
        return check.calibration, (*check.notes, *check.calibration.notes)


def _scale_bar(text: str) -> tuple[tuple[float, float], tuple[float, float], float, str]:
    parts = str(text).split(",")
    length = _LENGTH.match(parts[-1]) if len(parts) == 5 else None
    try:
        x1, y1, x2, y2 = (float(part) for part in parts[:4])
    except ValueError:
        length = None
    if length is None or not np.isfinite([x1, y1, x2, y2]).all():
        raise ConfigError(
            f"the scale bar is {text!r}",
            expected="x1,y1,x2,y2,LENGTH UNIT: both ends in px and their distance, as in "
            "'12,40,312,40,50 mm'",
            fix="write it like this, in quotes",
            key="scale_bar",
        )
    return (x1, y1), (x2, y2), float(length[1]), length[2]


def _marker(text: str) -> int | tuple[float, float]:
    parts = str(text).split(",")
    try:
        if len(parts) == 1 and int(parts[0]) >= 0:
            return int(parts[0])
        x, y = (float(part) for part in parts)
    except ValueError:
        x = y = np.nan
    if not np.isfinite([x, y]).all():
        raise ConfigError(
            f"the marker is {text!r}",
            expected="the number of a point, from 0, or its place x,y in px",
            fix="as in drive_marker=0 or drive_marker=120.5,88",
            key="drive_marker",
        )
    return x, y


def _levels(text: int | str) -> int | str:
    if str(text) == "auto":
        return "auto"
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number <= 10:
        raise ConfigError(
            f"levels is {text!r}",
            expected="a whole number from 0 to 10, or auto",
            fix="leave it out for auto",
            key="levels",
        )
    return number


def _range(text: Any) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in str(text).split(","))
    except ValueError:
        low = high = np.nan
    if not low < high:
        raise ConfigError(
            f"value_range is {text!r}",
            expected="LOW,HIGH: the values that are shown black and white",
            fix="as in value_range=0,4095",
            key="value_range",
        )
    return low, high


_READERS: dict[str, Any] = {
    "scale_bar": _scale_bar,
    "drive_marker": _marker,
    "levels": _levels,
    "value_range": _range,
}
_RANGES = {
    "max_points": (1, np.inf, "at least 1"),
    "spacing": (1.0, np.inf, "at least 1 px"),
    "reference_frame": (0, np.inf, "the number of a frame, from 0"),
    "min_ratio": (0.0, 1.0, "a fraction from 0 to 1"),
    "moving": (0.0, np.inf, "0, which takes all points, or a ratio above it, such as 3"),
    "max_gap": (0, np.inf, "a number of frames, 0 or more"),
    "smooth": (0, np.inf, "0, or an odd number of frames"),
    "fps": (1e-9, np.finfo(float).max, "a positive number [Hz]"),
    "rate": (1e-9, np.finfo(float).max, "a positive number [Hz]"),
}
