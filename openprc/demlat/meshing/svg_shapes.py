"""The straight lines of an SVG drawing: shapes, paths and transforms."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.meshing.mesh_text import finite
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]
    Point = tuple[float, float]

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_PATH_PART = re.compile(rf"([a-zA-Z])|({NUMBER.pattern})")
_TRANSFORM = re.compile(r"(\w+)\s*\(([^)]*)\)")
#: Numbers that follow each letter of a path made of straight lines.
_TAKES = {"m": 2, "l": 2, "h": 1, "v": 1, "z": 0}
SHAPES = ("line", "polyline", "polygon", "rect", "path")
#: Shapes that have no straight lines.
CURVED = ("circle", "ellipse")


def shape_lines(tag: str, attributes: Mapping[str, str], file: Path) -> list[tuple[Point, Point]]:
    """Return the segments of one shape, in its own coordinates.

    Raises
    ------
    ConfigError
        For curves, and numbers that are none.
    """
    if tag in CURVED:
        raise _curve(f"<{tag}>", file)
    if tag == "line":
        x1, y1, x2, y2 = (_length(attributes, name, file) for name in ("x1", "y1", "x2", "y2"))
        return [((x1, y1), (x2, y2))]
    if tag == "rect":
        x, y, w, h = (_length(attributes, name, file) for name in ("x", "y", "width", "height"))
        if _length(attributes, "rx", file) or _length(attributes, "ry", file):
            raise _curve("a rectangle with round corners", file)
        return _joined([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], closed=True)
    if tag in ("polyline", "polygon"):
        text = attributes.get("points", "")
        rest = NUMBER.sub("", text).replace(",", " ").strip()
        values = [float(number) for number in NUMBER.findall(text)]
        if rest or len(values) % 2:
            raise ConfigError(
                f"points {text[:40]!r}", expected="pairs of numbers", file=file, key=tag
            )
        points = list(zip(values[::2], values[1::2], strict=True))
        return _joined(points, closed=tag == "polygon")
    return path_lines(attributes.get("d", ""), file)


def _joined(points: list[Point], *, closed: bool) -> list[tuple[Point, Point]]:
    ends = [*points[1:], points[0]] if closed and points else points[1:]
    return list(zip(points, ends, strict=False))


def path_lines(data: str, file: Path) -> list[tuple[Point, Point]]:
    """Return the segments of a path of the commands M, L, H, V and Z, in either case."""
    parts = _PATH_PART.findall(data)
    left = _PATH_PART.sub("", data).replace(",", " ").strip()
    if left:
        raise ConfigError(f"{left[:20]!r} in a path", expected="letters and numbers", file=file,
                          key="path/d")  # fmt: skip
    lines: list[tuple[Point, Point]] = []
    here = start = (0.0, 0.0)
    command, place = "", 0
    while place < len(parts):
        letter = parts[place][0]
        if letter:
            if letter.lower() not in _TAKES:
                raise _curve(f"the path command {letter}", file)
            command, place = letter, place + 1
        elif command in ("", "z", "Z"):
            raise ConfigError(
                f"the number {parts[place][1]} without a command in a path",
                expected="a path that begins with M",
                file=file,
                key="path/d",
            )
        kind = command.lower()
        taken = [float(number) for _, number in parts[place : place + _TAKES[kind]] if number]
        if len(taken) < _TAKES[kind]:
            raise ConfigError(
                f"too few numbers after {command} in a path",
                expected=f"{_TAKES[kind]}",
                file=file,
                key="path/d",
            )
        place += len(taken)
        end = start if kind == "z" else _next(kind, taken, here, relative=command.islower())
        if kind == "m":
            start = end
            # More pairs after the first are lines.
            command = "l" if command == "m" else "L"
        elif end != here:
            lines.append((here, end))
        here = end
    return lines


def _next(kind: str, taken: list[float], here: Point, *, relative: bool) -> Point:
    x, y = here if relative else (0.0, 0.0)
    if kind == "h":
        return x + taken[0], here[1]
    if kind == "v":
        return here[0], y + taken[0]
    return x + taken[0], y + taken[1]


def _curve(what: str, file: Path) -> ConfigError:
    return ConfigError(
        f"{what} is a curve",
        expected="straight lines: a fold between plane panels is straight",
        fix="draw it as short lines",
        file=file,
    )


def _length(attributes: Mapping[str, str], name: str, file: Path) -> float:
    text = attributes.get(name, "0").strip()
    return finite(text.removesuffix("px"), file=file, key=name)


def transform_matrix(text: str, file: Path) -> Reals:
    """Return the matrix of a transform attribute: (3, 3).

    Raises
    ------
    ConfigError
        When it cannot be understood.
    """
    total = np.eye(3)
    if _TRANSFORM.sub("", text).replace(",", " ").strip():
        raise _bad_transform(text, file)
    for name, numbers in _TRANSFORM.findall(text):
        values = [float(number) for number in NUMBER.findall(numbers)]
        total = total @ _one_transform(name, values, text, file)
    return total


def _one_transform(name: str, v: list[float], text: str, file: Path) -> Reals:
    if name == "matrix" and len(v) == 6:
        return np.array([[v[0], v[2], v[4]], [v[1], v[3], v[5]], [0, 0, 1]])
    if name == "translate" and len(v) in (1, 2):
        return np.array([[1, 0, v[0]], [0, 1, v[1] if len(v) == 2 else 0.0], [0, 0, 1]])
    if name == "scale" and len(v) in (1, 2):
        return np.diag([v[0], v[-1], 1.0])
    if name == "rotate" and len(v) in (1, 3):
        c, s = math.cos(math.radians(v[0])), math.sin(math.radians(v[0]))
        x, y = v[1:] if len(v) == 3 else (0.0, 0.0)
        return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y], [0, 0, 1]])
    if name in ("skewX", "skewY") and len(v) == 1:
        slope = math.tan(math.radians(v[0]))
        skew = np.eye(3)
        skew[(0, 1) if name == "skewX" else (1, 0)] = slope
        return skew
    raise _bad_transform(text, file)


def _bad_transform(text: str, file: Path) -> ConfigError:
    return ConfigError(
        f"the transform {text[:60]!r}",
        expected="matrix, translate, scale, rotate, skewX or skewY with their numbers",
        file=file,
        key="transform",
    )
