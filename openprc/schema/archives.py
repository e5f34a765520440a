"""Reading NumPy .npz archives of unknown origin: no pickles, no bombs."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile, UnsafeFile

#: Refuse archives that would unpack to more than this.
MAX_BYTES = 32 << 30
#: What damaged archives raise, depending on which byte was hit.
_DAMAGE = (zipfile.BadZipFile, zlib.error, tokenize.TokenError, EOFError, OSError)


def npz_headers(path: str | Path) -> dict[str, tuple[tuple[int, ...], np.dtype[np.generic]]]:
    """Return shape and dtype of every array in an archive, reading headers only.

    Raises
    ------
    UnreadableFile
        When it is not a readable archive of .npy members.
    UnsafeFile
        When it would unpack to more than `MAX_BYTES` or a member lies about its size.
    """
    path = Path(path)
    headers: dict[str, tuple[tuple[int, ...], np.dtype[np.generic]]] = {}
    total = 0
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                if not entry.filename.endswith(".npy"):
                    continue
                total += entry.file_size
                if total > MAX_BYTES:
                    raise UnsafeFile(
                        f"it unpacks to more than {MAX_BYTES >> 30} GiB",
                        expected="an archive that fits in memory",
                        fix="split it into parts",
                        file=path,
                        key=entry.filename,
                    )
                with archive.open(entry) as stream:
                    headers[entry.filename[:-4]] = _header(stream, entry.file_size, path, entry)
    except (*_DAMAGE, ValueError, NotImplementedError, RuntimeError) as error:
        raise UnreadableFile(
            f"not a readable .npz archive: {error}",
            expected="a complete file written by numpy.savez",
            fix="save or copy it again",
            file=path,
        ) from error
    return headers


def _header(
    stream: object, size: int, path: Path, entry: zipfile.ZipInfo
) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    try:
        version = np.lib.format.read_magic(stream)  # type: ignore[arg-type]
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(stream)  # type: ignore[arg-type]
    except (ValueError, tokenize.TokenError) as error:
        raise UnreadableFile(
            f"the member is not a NumPy array: {error}",
            expected="members written by numpy.savez",
            fix="save the file again",
            file=path,
            key=entry.filename,
        ) from error
    if not dtype.hasobject:
        declared = int(np.prod(shape, dtype=object)) * dtype.itemsize
        if declared > size:
            raise UnsafeFile(
                f"the member claims {declared:,} bytes and holds {size:,}",
                expected="a header that agrees with the data",
                fix="save the file again, or do not open it",
                file=path,
                key=entry.filename,
            )
    return tuple(shape), dtype


def load_npz(path: str | Path) -> dict[str, NDArray[np.generic]]:
    """Read every array of an archive.

    Raises
    ------
    UnreadableFile
        When the archive or one of its members is damaged.
    UnsafeFile
        When a member holds Python objects, which are pickles and can run code.
    """
    path = Path(path)
    arrays: dict[str, NDArray[np.generic]] = {}
    headers = npz_headers(path)
    for name, (_, dtype) in headers.items():
        if dtype.hasobject:
            raise UnsafeFile(
                "the array holds Python objects, which NumPy stores as a pickle",
                expected="numeric arrays",
                fix="save it with numeric arrays only (numpy.savez of plain arrays)",
                file=path,
                key=name,
            )
    try:
        with np.load(path, allow_pickle=False) as archive:
            for name in headers:
                arrays[name] = archive[name]
    except (*_DAMAGE, ValueError) as error:
        raise UnreadableFile(
            f"the archive is damaged: {error}",
            expected="a complete file written by numpy.savez",
            fix="save or copy it again",
            file=path,
        ) from error
    return arrays
