"""Growing datasets: the part of the writer that touches HDF5 row by row.

Blocks are gathered in memory and written in three steps, so that a killed process leaves a
readable file: append the rows, flush, raise ``/committed``, flush.

A chunk that is half full is written again with the next block. A kill in the middle of that
leaves the old rows as they were, because their bytes do not change; but a checksum of the whole
chunk would be wrong, and HDF5 would then refuse the committed rows too. So there is no checksum
per chunk here. `StreamSet.checksums` gives one per dataset, which is stored when the file closes.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.schema.digest import checksum

#: Target size of a chunk along time. A chunk of one frame reads a node's history many times
#: slower, and compression while streaming costs more than it saves.
CHUNK_BYTES = 512 << 10
#: Rows are written out when this much has gathered ...
BLOCK_BYTES = 4 << 20
#: ... or when this many seconds have passed, so that slow runs lose little.
BLOCK_SECONDS = 2.0


@dataclass
class Stream:
    """One dataset with time along axis 0: path, shape of a row, dtype, and attributes."""

    path: str
    row: tuple[int, ...]
    dtype: np.dtype[Any]
    attrs: Mapping[str, Any] = field(default_factory=dict)

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return int(np.prod(self.row, dtype=np.int64)) * self.dtype.itemsize


class StreamSet:
    """All growing datasets of a file, kept at the same length."""

    def __init__(self, file: h5py.File, streams: Mapping[str, Stream]) -> None:
        self._file = file
        self._streams = dict(streams)
        self._pending: list[tuple[int, dict[str, NDArray[Any]]]] = []
        self._pending_bytes = 0
        self._row_bytes = max(1, sum(item.row_bytes for item in self._streams.values()))
        self._last_commit = time.monotonic()
        self._created = False
        self.committed = 0
        #: CRC-32 of the committed rows of every stream.
        self.checksums = dict.fromkeys(self._streams, 0)

    @property
    def rows(self) -> int:
        """Rows appended so far, committed or not."""
        return self.committed + sum(rows for rows, _ in self._pending)

    def append(self, block: Mapping[str, NDArray[Any]], rows: int) -> None:
        """Take one block; every stream is in it."""
        # The caller may reuse its buffer, so keep a copy. Copies are taken before any of them is
        # kept: Ctrl-C between two streams must not leave them of different length.
        copies = {
            name: np.array(block[name], dtype=stream.dtype, order="C")
            for name, stream in self._streams.items()
        }
        self._pending.append((rows, copies))
        self._pending_bytes += rows * self._row_bytes
        late = time.monotonic() - self._last_commit > BLOCK_SECONDS
        if self._pending_bytes >= BLOCK_BYTES or late:
            self.commit()

    def commit(self, *, final: bool = False) -> None:
        """Make every appended row safe to read.

        What is pending is forgotten only at the end, so that a commit that was broken off can
        be made again: it writes the same rows to the same places.
        """
        if not self._created:
            self._create(single_block=final)
        if self._pending:
            start, stop = self.committed, self.rows
            checksums: dict[str, int] = {}
            for name, stream in self._streams.items():
                blocks = [block[name] for _, block in self._pending]
                dataset = self._file[stream.path]
                dataset.resize(stop, axis=0)
                rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
                dataset[start:stop] = rows
                checksums[name] = checksum(rows, self.checksums[name])
            self._file.flush()
            self._file["committed"][()] = stop
            # One step for the interpreter: nothing can come between these.
            self.committed, self._pending, self.checksums = stop, [], checksums
            self._pending_bytes = 0
        self._file.flush()
        self._last_commit = time.monotonic()

    def _create(self, *, single_block: bool) -> None:
        for stream in self._streams.values():
            if stream.path in self._file:
                del self._file[stream.path]  # of a creation that was broken off
            rows = max(1, min(CHUNK_BYTES // max(1, stream.row_bytes), CHUNK_BYTES // 64))
            if single_block:
                # The whole run fits in one block: no room is wasted on chunks never filled.
                rows = max(1, min(rows, self.rows))
            dataset = self._file.create_dataset(
                stream.path,
                shape=(0, *stream.row),
                # HDF5 has no chunks along a fixed axis of length 0: no element of a kind.
                maxshape=(None, *(size or None for size in stream.row)),
                chunks=(rows, *(max(1, size) for size in stream.row)),
                dtype=stream.dtype,
            )
            for key, value in stream.attrs.items():
                write_attribute(dataset, key, value)
        self._created = True


def write_attribute(owner: h5py.HLObject, key: str, value: Any) -> None:
    """Write an attribute; sequences of text become arrays of variable-length UTF-8."""
    if isinstance(value, list | tuple):
        owner.attrs.create(key, np.array(value, dtype=object), dtype=h5py.string_dtype())
    else:
        owner.attrs[key] = value
