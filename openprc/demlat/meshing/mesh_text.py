"""Reading mesh files: text of bounded size, numbers that are numbers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from openprc.errors import ConfigError, OpenPRCError, UnreadableFile, UnsafeFile
from openprc.schema.safety import check_readable

#: Bytes; a mesh of a million nodes needs less.
MAX_BYTES = 64 << 20


def read_text(path: str | Path) -> tuple[Path, str]:
    """Return the file and what it holds.

    Raises
    ------
    UnreadableFile
        When it is missing, empty, a directory, or not UTF-8.
    UnsafeFile
        When it is larger than `MAX_BYTES`.
    """
    file = check_readable(path)
    size = file.stat().st_size
    if size > MAX_BYTES:
        raise UnsafeFile(
            f"{size} bytes of text",
            expected=f"at most {MAX_BYTES} bytes",
            fix="take a coarser mesh",
            file=file,
        )
    try:
        return file, file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFile(
            f"byte {error.start} is not UTF-8",
            expected="text in UTF-8",
            fix="save the file as UTF-8",
            file=file,
        ) from None


def finite(value: Any, *, file: Path, key: str) -> float:
    """Return a number of the file as a finite float.

    Raises
    ------
    ConfigError
        When it is none.
    """
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"found {value!r}", expected="a finite number", file=file, key=key)
    return number


def metres_per_unit(scale: Any, *, file: Path | None = None) -> float:
    """Return `scale` [m per unit of the file] when it is a positive number.

    Raises
    ------
    ConfigError
        When it is none.
    """
    number = scale if isinstance(scale, int | float) and not isinstance(scale, bool) else math.nan
    if not (math.isfinite(number) and number > 0):
        raise ConfigError(
            f"scale {scale!r}",
            expected="the length of one unit of the file in metres, such as 1e-3",
            file=file,
            key="scale",
        )
    return float(number)


def named(error: OpenPRCError, file: Path) -> OpenPRCError:
    """Return `error` with the file that it is about."""
    return type(error)(
        error.found, expected=error.expected, fix=error.fix, file=file, key=error.key
    )
