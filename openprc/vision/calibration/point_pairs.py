"""Pairs of pixels and points of a plane, from a text file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from openprc.errors import CalibrationError, UnreadableFile
from openprc.vision.calibration.mapping import Array
from openprc.vision.calibration.opencv_file import read_text


def read_pairs(path: str | Path) -> tuple[Array, Array]:
    """Read a CSV of four columns: pixel x, pixel y, plane x, plane y.

    A first line of names and lines that begin with # are skipped; commas, semicolons, tabs or
    blanks separate.

    Returns
    -------
    pixels : (n, 2) [px]
    plane : (n, 2)

    Raises
    ------
    UnreadableFile, CalibrationError
    """
    try:
        text = read_text(path)
    except UnreadableFile as error:
        raise UnreadableFile(
            error.found,
            expected="a CSV of four columns: pixel x, pixel y, plane x, plane y",
            fix="check the path",
            file=path,
        ) from error
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or line.lstrip().startswith("#"):
            continue
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            if not rows:  # the names of the columns
                continue
            raise _bad(path, number, line) from error
        if len(values) != 4 or not np.isfinite(values).all():
            raise _bad(path, number, line)
        rows.append(values)
    if not rows:
        raise CalibrationError(
            "the file has no line of four numbers",
            expected="pixel x, pixel y, plane x, plane y on each line",
            fix="write at least four such lines",
            file=path,
        )
    table = np.array(rows)
    return table[:, :2], table[:, 2:]


def _bad(path: str | Path, number: int, line: str) -> CalibrationError:
    return CalibrationError(
        f"line {number} is {line.strip()[:60]!r}",
        expected="four finite numbers: pixel x, pixel y, plane x, plane y",
        fix="correct the line; decimals take a point",
        file=path,
        key=f"line {number}",
    )
