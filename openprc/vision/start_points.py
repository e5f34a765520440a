"""Where tracking begins: points that are listed, or found in the reference frame."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, NoFeaturesError, UnreadableFile
from openprc.schema import safety
from openprc.vision.import_settings import ImportSettings
from openprc.vision.opencv import load_cv2

if TYPE_CHECKING:
    from openprc.vision.detection.feature_map import FeatureMap

#: At least so many features are tried at once.
_AT_ONCE = 256
#: One-sigma [px] for noise of one grey level up to which a detected point is followed.
_COARSEST = 0.3


@dataclass(frozen=True)
class StartPoints:
    """Points of the reference frame.

    Attributes
    ----------
    places : (N, 2) [px]
    marker : int or None
        The point whose motion is the input.
    notes : tuple of str
    """

    places: NDArray[np.float64]
    marker: int | None = None
    notes: tuple[str, ...] = ()


def start_points(image: NDArray[np.uint8], settings: ImportSettings, *, file: Path) -> StartPoints:
    """Return the points to follow.

    Parameters
    ----------
    image : (H, W) uint8
        The reference frame.
    settings : ImportSettings
    file : path
        The video, for messages.

    Raises
    ------
    NoFeaturesError
        The detector finds nothing.
    ConfigError
        A list, a mask or a marker does not fit the image.
    """
    shape = image.shape
    notes: list[str] = []
    if settings.points is not None:
        if settings.mask is not None:
            raise ConfigError(
                "both points and mask are given",
                expected="listed points, or a mask for the detector",
                fix="leave one out",
                key="mask",
            )
        places = read_points(settings.points, shape)
    else:
        mask = None if settings.mask is None else read_mask(settings.mask, shape)
        places = _detected(image, settings, mask, file)
        if len(places) < settings.max_points:
            notes.append(
                f"{settings.max_points} points were asked for, and {settings.detector} found "
                f"{len(places)} that can be tracked"
            )
    marker = settings.drive_marker
    if isinstance(marker, int) and marker >= len(places):
        raise ConfigError(
            f"the marker is point {marker}, and there are {len(places)} points",
            expected=f"a number from 0 to {len(places) - 1}, or the marker's place x,y in px",
            fix="list the points in a CSV (points), or give the place",
            key="drive_marker",
        )
    if isinstance(marker, tuple):
        x, y = marker
        if not (0 <= x <= shape[1] - 1 and 0 <= y <= shape[0] - 1):
            raise ConfigError(
                f"the marker lies at ({x:g}, {y:g})",
                expected=f"px inside the image of {shape[1]} x {shape[0]}",
                fix="read it off the reference frame",
                key="drive_marker",
            )
        # A detected point in the same window would be the input once more.
        far = np.hypot(*(places - marker).T) > settings.win_size / 2
        places = np.vstack([places[far | (settings.points is not None)], [marker]])
        marker = len(places) - 1
    return StartPoints(places, marker, tuple(notes))


def _detected(
    image: NDArray[np.uint8], settings: ImportSettings, mask: Any, file: Path
) -> NDArray[np.float64]:
    # Kept light: not before there is an image.
    from openprc.vision.detection.registry import detect  # noqa: PLC0415

    found = detect(image, settings.detector, mask=mask, ref_frame_index=settings.reference_frame)
    # A window that leaves the image cannot be refined.
    margin = max(settings.win_size, settings.subset if settings.refine == "icgn" else 0) // 2 + 1
    places = np.asarray(found.keypoints, dtype=np.float64)
    height, width = image.shape
    # A feature that light grain moves by more than this is none to follow.
    sharp = found.track_sigma <= _COARSEST if len(found) else np.zeros(0, dtype=bool)
    inside = (
        sharp
        & (places[:, 0] >= margin)
        & (places[:, 1] >= margin)
        & (places[:, 0] <= width - 1 - margin)
        & (places[:, 1] <= height - 1 - margin)
    )
    spacing = settings.win_size / 2 if settings.spacing is None else settings.spacing
    best = _best(found.select(inside), image, settings, spacing=spacing)
    if not len(best):
        raise NoFeaturesError(
            f"the detector {settings.detector!r} finds no point in frame "
            f"{settings.reference_frame} that can be tracked",
            expected="texture or marks that can be followed, away from the edges of the image",
            fix="choose another detector or reference_frame, widen the mask, or list the points "
            "in a CSV (points)",
            file=file,
            key="detector",
        )
    return np.asarray(best.keypoints, dtype=np.float64)


def _best(
    found: FeatureMap, image: NDArray[np.uint8], settings: ImportSettings, *, spacing: float
) -> FeatureMap:
    """Return the features that promise the best tracks, and around which a template can be cut."""
    if settings.refine != "icgn":
        rank = settings.max_points
        return found.top_n(rank, by="trackability", min_distance=spacing) if len(found) else found
    # Templates are cut for the best only: a large image has 100,000 features and more.
    tried = max(settings.max_points, _AT_ONCE)
    while len(found):
        best = found.top_n(tried, by="trackability", min_distance=spacing)
        usable = _can_be_matched(image, best.keypoints, settings)
        if usable[: settings.max_points].all():
            return best.select(np.arange(min(settings.max_points, len(best))))
        # What cannot be matched makes room for what stands near it.
        refused = best.keypoints[~usable] @ [1.0, 1j]
        found = found.select(~np.isin(found.keypoints @ [1.0, 1j], refused))
    return found


def _can_be_matched(
    image: NDArray[np.uint8], places: NDArray[np.float64], settings: ImportSettings
) -> NDArray[np.bool_]:
    """Tell around which points a template can be cut, (n,)."""
    # Compiled numerics: not before they are needed.
    from openprc.vision.tracking.correlation import Correlator  # noqa: PLC0415

    correlator = Correlator(settings.tracker_config().refinement)
    numbers = correlator.add_templates(correlator.prepare(image), places)
    usable: NDArray[np.bool_] = numbers >= 0
    return usable


def read_points(path: Path, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Read x,y [px] from CSV, (N, 2).

    Raises
    ------
    ConfigError
        A line is no point of the image.
    """
    points: list[tuple[float, float]] = []
    for number, row in _lines(path, header=["x", "y"]):
        try:
            x, y = (float(cell) for cell in row)
        except ValueError:
            x = y = np.nan
        if not (0 <= x <= shape[1] - 1 and 0 <= y <= shape[0] - 1):
            raise ConfigError(
                f"line {number} is {','.join(row)!r}",
                expected=f"x,y in px inside the image of {shape[1]} x {shape[0]}",
                fix="one point a line; the first line may be the header x,y",
                file=path,
                key="points",
            )
        points.append((x, y))
    if not points:
        raise ConfigError(
            "no point is listed", expected="lines x,y", fix="list some", file=path, key="points"
        )
    return np.array(points)


def read_bars(path: Path, n_points: int) -> NDArray[np.int64]:
    """Read pairs of point numbers from CSV, (M, 2).

    Raises
    ------
    ConfigError
        A line is no pair of different points.
    """
    bars: list[tuple[int, int]] = []
    for number, row in _lines(path, header=["a", "b"]):
        try:
            a, b = (int(cell) for cell in row)
        except ValueError:
            a = b = -1
        if not (0 <= a < n_points and 0 <= b < n_points and a != b):
            raise ConfigError(
                f"line {number} is {','.join(row)!r}",
                expected=f"a,b: two different points, counted from 0 to {n_points - 1}",
                fix="one bar a line; the numbers are those of the lines of the points' CSV",
                file=path,
                key="bars",
            )
        bars.append((a, b))
    if not bars:
        raise ConfigError(
            "no bar is listed", expected="lines a,b", fix="list some", file=path, key="bars"
        )
    return np.array(bars)


def _lines(path: Path, *, header: list[str]) -> list[tuple[int, list[str]]]:
    path = safety.check_readable(path)
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        rows = list(enumerate(csv.reader(stream), start=1))
    if rows and [cell.strip().lower() for cell in rows[0][1]] == header:
        rows = rows[1:]
    return [(n, row) for n, row in rows if row and not row[0].lstrip().startswith("#")]


def read_mask(path: Path, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Read an image whose pixels above zero are where points may be, (H, W).

    Raises
    ------
    UnreadableFile
        It is no image.
    ConfigError
        It has another size than the video, or is black all over.
    """
    path = safety.check_readable(path)
    cv2 = load_cv2()
    data = np.frombuffer(path.read_bytes(), np.uint8)
    mask = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise UnreadableFile(
            "this is not an image",
            expected="a PNG, white where points may be and black elsewhere",
            fix="export the mask again",
            file=path,
            key="mask",
        )
    if mask.shape != shape[:2]:
        raise ConfigError(
            f"the mask has {mask.shape[1]} x {mask.shape[0]} px",
            expected=f"{shape[1]} x {shape[0]} px, as the video has",
            fix="draw it over a frame of this video",
            file=path,
            key="mask",
        )
    if not mask.any():
        raise ConfigError(
            "the mask is black all over",
            expected="white where points may be",
            fix="invert it",
            file=path,
            key="mask",
        )
    found: NDArray[np.uint8] = np.where(mask > 0, 255, 0).astype(np.uint8)
    return found
