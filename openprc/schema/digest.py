"""A digest of what a file says, apart from when and where it was made."""

from __future__ import annotations

import hashlib
from typing import Any
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

#: Left out: they differ between two equal runs.
_APART = ("provenance",)


def checksum(rows: NDArray[Any], before: int = 0) -> int:
    """Return the CRC-32 of values as little-endian bytes in C order, continuing `before`."""
    if not rows.size:
        return before
    values = np.ascontiguousarray(rows, dtype=rows.dtype.newbyteorder("<"))
    return crc32(values.reshape(-1).view("u1").data, before)


def content_digest(file: h5py.File) -> str:
    """Return a SHA-256 over path, attributes, type, shape and bytes of every dataset.

    Root attributes (run id, instant of creation) and the provenance are left out, and so is
    how the data are stored: a packed file has the digest of its original.
    """
    digest = hashlib.sha256()

    def visit(name: str, item: Any) -> None:
        if name.split("/")[0] in _APART:
            return
        digest.update(name.encode())
        for key in sorted(item.attrs):
            digest.update(f"|{key}={_canonical(item.attrs[key])}".encode())
        if isinstance(item, h5py.Dataset):
            digest.update(f"|{item.dtype}|{item.shape}".encode())
            string = h5py.check_string_dtype(item.dtype) is not None
            data = np.asarray(item.asstr()[()] if string else item[()])
            digest.update(repr(data.tolist()).encode() if data.dtype == object else data.tobytes())

    file.visititems(visit)
    return digest.hexdigest()


def _canonical(value: Any) -> str:
    array = np.asarray(value)
    return f"{array.dtype.kind}{array.tolist()!r}"
