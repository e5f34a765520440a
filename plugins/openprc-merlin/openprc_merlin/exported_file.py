"""The file that an exporter makes: new, and gone when it could not be finished."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from openprc.errors import ResultExists


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Open `path` for writing; an error on the way leaves nothing under its name.

    Raises
    ------
    ResultExists
        When there is a file of this name.
    """
    try:
        # "x": nothing is ever written over.
        stream = path.open("xb")
    except FileExistsError:
        raise ResultExists(
            "a file of this name exists",
            expected="a new name",
            fix="choose another name, or delete it",
            file=path,
        ) from None
    try:
        with stream:
            yield stream
    except BaseException:
        path.unlink(missing_ok=True)
        raise
