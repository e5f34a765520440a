"""A file appears under its final name whole, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from openprc.errors import ResultExists

PARTIAL = ".partial"


def partial_path(path: Path) -> Path:
    """Return the name that a file has until it is finished."""
    return path.with_name(path.name + PARTIAL)


def refuse_existing(path: Path) -> None:
    """Raise `ResultExists` when there is something under the final name."""
    if path.exists():
        raise ResultExists(
            "there is a finished file of this name",
            expected="a new name; finished files are not changed",
            fix="choose another output, or say --force (overwrite=True) to replace it",
            file=path,
        )


def publish(partial: Path, path: Path) -> None:
    """Move a closed, complete file to its final name so that a crash leaves one or the other."""
    _sync(partial)
    partial.replace(path)
    # The rename itself lives in the folder; some file systems refuse to sync a folder.
    with suppress(OSError):
        _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def atomic_file(path: str | Path, *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary name to write to; publish it on success, remove it on failure."""
    path = Path(path)
    if not overwrite:
        refuse_existing(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}{PARTIAL}")
    try:
        yield temporary
        publish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
