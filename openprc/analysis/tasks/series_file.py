"""A series of numbers from a text or .npy file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError, UnreadableFile, UnsafeFile


def load_series(path: str | Path, *, column: int | None = None) -> NDArray[np.float64]:
    """Return the numbers of a file, (K, C).

    Text has one row per line; commas, semicolons, tabs and spaces separate columns; empty lines
    and lines from ``#`` on are left out, and so is one line of column names at the top. A .npy
    file holds an array of one or two dimensions. Nothing is unpickled.

    Parameters
    ----------
    path : path-like
        ``.npy``, or anything else as text.
    column : int, optional
        Read only this one, (K, 1).

    Raises
    ------
    UnreadableFile
        When the file is missing, empty, or holds something that is no number.
    UnsafeFile
        When a .npy file holds pickled objects.
    TaskError
        When a value is not finite, or there is no such column.
    """
    path = Path(path)
    if not path.is_file():
        raise UnreadableFile(
            "no such file", expected="a text or .npy file", fix="check the path", file=path
        )
    values = _read_npy(path) if path.suffix.lower() == ".npy" else _read_text(path)
    if column is not None:
        if not -values.shape[1] <= column < values.shape[1]:
            raise TaskError(
                f"column {column} of {values.shape[1]}",
                expected=f"0 to {values.shape[1] - 1}",
                fix="choose one of these",
                file=path,
                key="column",
            )
        values = values[:, [column]]
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise TaskError(
            f"{bad.size} of {len(values)} rows are NaN or infinite, the first is row {bad[0]}",
            expected="finite numbers",
            fix="mend the series or cut it there",
            file=path,
        )
    return values


def _read_npy(path: Path) -> NDArray[np.float64]:
    try:
        array = np.load(path, allow_pickle=False)
    except ValueError as error:
        if "pickle" in str(error) or "Object arrays" in str(error):
            raise UnsafeFile(
                "the file holds pickled objects, which could run code",
                expected="an array of numbers",
                fix="save it again as float64",
                file=path,
            ) from error
        raise _no_array(path, str(error)) from error
    except (OSError, EOFError) as error:
        raise _no_array(path, str(error)) from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iufb":
        raise _no_array(path, f"it holds {getattr(array, 'dtype', type(array).__name__)}")
    values = array.astype(np.float64)
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or not values.size:
        raise _no_array(path, f"the array has shape {array.shape}")
    return values


def _no_array(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected="an array of numbers of one or two dimensions",
        fix="save the series with numpy.save",
        file=path,
    )


def _read_text(path: Path) -> NDArray[np.float64]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise UnreadableFile(
            f"the file is not text: {error.reason}",
            expected="numbers in UTF-8 text, or a .npy file",
            fix="save it as text",
            file=path,
        ) from error
    rows: list[list[float]] = []
    seen_names = False
    for number, line in enumerate(lines, start=1):
        cells = _cells(line)
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError as error:
            if rows or seen_names:
                raise UnreadableFile(
                    f"line {number} is {line.strip()[:60]!r}",
                    expected="numbers",
                    fix="put '#' before comments, and a point into decimals",
                    file=path,
                ) from error
            seen_names = True
            continue
        if rows and len(row) != len(rows[0]):
            raise UnreadableFile(
                f"line {number} has {len(row)} columns",
                expected=f"{len(rows[0])}, as the lines before it",
                fix="check the separators",
                file=path,
            )
        rows.append(row)
    if not rows:
        raise UnreadableFile(
            "there are no numbers in it", expected="one row per line", fix="check it", file=path
        )
    return np.array(rows)


def _cells(line: str) -> list[str]:
    text = line.split("#", 1)[0]
    for mark in ",;\t":
        if mark in text:
            # An empty cell between two marks is a missing value, not nothing.
            return [cell.strip() or "nan" for cell in text.strip().split(mark)]
    return text.split()
