"""Reading a signal from CSV, text, .npy or .npz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, UnreadableFile
from openprc.schema.safety import check_readable, load_npz


def read_signal(
    path: str | Path, *, columns: tuple[str, ...] = ()
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return the signal, (K, C), and its column names; names are empty when there are none.

    Raises
    ------
    UnreadableFile
        When the file is not a table of numbers.
    ConfigError
        When a column is not there, or the file has several arrays and none was named.
    """
    path = check_readable(path)
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _npz(path, columns)
    if suffix == ".npy":
        return _npy(path, columns)
    return _text(path, columns)


def _npy(path: Path, columns: tuple[str, ...]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    if columns:
        raise ConfigError(
            f"asked for column {columns[0]!r} of an array without names",
            expected="no column: every column of the array is taken",
            fix="leave --column out",
            file=path,
            key="column",
        )
    try:
        # Mapped, so that a header that claims terabytes is found out before memory is asked for.
        return _matrix(np.lib.format.open_memmap(path, mode="r"), path), ()
    except (ValueError, EOFError, OSError) as error:
        raise _not_numbers(path, f"not a readable .npy array: {error}") from error


def _npz(path: Path, columns: tuple[str, ...]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    arrays = load_npz(path)
    if not columns and len(arrays) == 1:
        columns = tuple(arrays)
    if len(columns) != 1 or columns[0] not in arrays:
        raise ConfigError(
            f"arrays {', '.join(arrays)}; asked for {', '.join(columns) or 'none'}",
            expected="the name of one array",
            fix="name it with --column",
            file=path,
            key="column",
        )
    return _matrix(arrays[columns[0]], path), ()


def _text(path: Path, columns: tuple[str, ...]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise _not_numbers(path, "it is not text") from error
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise _not_numbers(path, "it holds no line of data")
    delimiter = next((mark for mark in (",", ";", "\t") if mark in lines[0]), None)
    header = [word.strip().strip('"') for word in lines[0].split(delimiter)]
    named = not all(_is_number(word) for word in header)
    rows = []
    for number, line in enumerate(lines[1:] if named else lines, start=2 if named else 1):
        words = [word.strip() for word in line.split(delimiter)]
        if len(words) != len(header) or not all(_is_number(word) for word in words):
            raise _not_numbers(path, f"data line {number} is {line.strip()!r}")
        rows.append([float(word) for word in words])
    data = np.array(rows, dtype="f8").reshape(len(rows), len(header))
    if not columns:
        return _matrix(data, path), tuple(header) if named and len(set(header)) == len(
            header
        ) else ()
    wrong = [name for name in columns if not named or header.count(name) != 1]
    wrong += [name for name in columns if columns.count(name) > 1]
    if wrong:
        count = header.count(wrong[0]) if named else 0
        raise ConfigError(
            f"{count or 'no'} column{'s' * (count > 1)} {wrong[0]!r}"
            + (" asked for twice" if count == 1 else ""),
            expected="one of " + ", ".join(header) if named else "no --column: there is no header",
            fix="correct --column",
            file=path,
            key="column",
        )
    return _matrix(data[:, [header.index(name) for name in columns]], path), columns


def _matrix(array: NDArray[np.generic], path: Path) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or array.size == 0:
        raise _not_numbers(path, f"an array of {array.dtype} with shape {array.shape}")
    data = array.astype("f8")
    data = data[:, np.newaxis] if data.ndim == 1 else data
    if not np.isfinite(data).all():
        row = int(np.argwhere(~np.isfinite(data))[0][0])
        raise _not_numbers(path, f"value {row} is not finite")
    return data


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _not_numbers(path: Path, found: str) -> UnreadableFile:
    return UnreadableFile(
        found,
        expected="a table of finite numbers: CSV, text, .npy or .npz",
        fix="export the signal again",
        file=path,
    )
