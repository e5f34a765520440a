"""One error for everything that HDF5 raises when it reads a damaged file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from openprc.errors import UnreadableFile

#: What comes out of h5py depends on which byte was hit: a failed checksum, a type that is none,
#: a name that is no text, a size beyond the memory.
DAMAGE = (OSError, RuntimeError, ValueError, TypeError, LookupError, MemoryError)


@contextmanager
def damage_named(path: str | Path, key: str | None = None) -> Iterator[None]:
    """Turn errors of reading a damaged file into `UnreadableFile`.

    Raises
    ------
    UnreadableFile
        In place of any of `DAMAGE`; errors of this package pass.
    """
    try:
        yield
    except DAMAGE as error:
        raise UnreadableFile(
            f"the data cannot be read: {' '.join(str(error).split()) or type(error).__name__}",
            expected="data as they were written",
            fix="copy or export the file again",
            file=path,
            key=key,
        ) from error
