"""Which frames of a damaged AVI file are lost: its index and the chunks that it points to.

An AVI file gives a frame no time: the decoder counts what it finds, so that frames whose
chunks are destroyed vanish and all later ones seem earlier. The index at the end of the file
(``idx1``) names place and size of every chunk; a chunk that does not begin there as it should
is lost. Format: Microsoft, "AVI RIFF File Reference".
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

_ENTRY = np.dtype([("id", "S4"), ("flags", "<u4"), ("offset", "<u4"), ("size", "<u4")])
#: More entries than a file of this kind holds (4 GiB of chunks of 16 bytes).
_MOST = 1 << 28


@dataclass(frozen=True)
class AviIndex:
    """The video chunks of an AVI file.

    Attributes
    ----------
    present : (n,) int
        The numbers of the frames whose chunks are there, in order.
    total : int
        How many the index lists.
    """

    present: NDArray[np.int64]
    total: int

    @property
    def lost(self) -> tuple[int, ...]:
        """The numbers of the frames whose chunks are destroyed."""
        return tuple(sorted(set(range(self.total)) - set(self.present.tolist())))


def read_index(path: Path) -> AviIndex | None:
    """Look at every chunk that the index names; None where there is no index to go by."""
    with path.open("rb") as stream:
        found = _index(stream, path.stat().st_size)
        if found is None:
            return None
        movi, entries = found
        entries = entries[[_is_video(name) for name in entries["id"].tolist()]]
        if not len(entries):
            return None
        # Offsets count from the letters "movi" or, with some writers, from the file's start.
        base = movi if int(entries["offset"][0]) < movi else 0
        there = [_is_there(stream, entry, base) for entry in entries]
        return AviIndex(np.flatnonzero(there), len(entries))


def _is_video(name: bytes) -> bool:
    return len(name) == 4 and name[:2].isdigit() and name[2:] in (b"dc", b"db")


def _is_there(stream: BinaryIO, entry: np.void, base: int) -> bool:
    # Its letters are what the decoder looks for; a wrong size spoils the picture only.
    stream.seek(base + int(entry["offset"]))
    return stream.read(4) == bytes(entry["id"])


def _index(stream: BinaryIO, size: int) -> tuple[int, NDArray[np.void]] | None:
    """Return where "movi" stands and the entries of the index of a file of one RIFF chunk."""
    movi = None
    at = 12
    while at + 8 <= size:
        stream.seek(at)
        head = stream.read(12)
        name, length = head[:4], int.from_bytes(head[4:8], "little")
        if name == b"LIST" and head[8:12] == b"movi":
            movi = at + 8
        elif name == b"idx1" and movi is not None:
            stream.seek(at + 8)
            data = stream.read(min(length, _MOST))
            return movi, np.frombuffer(data[: len(data) // 16 * 16], dtype=_ENTRY)
        elif name == b"RIFF":
            return None  # Beyond 1 GiB the file goes on in another way.
        at += 8 + length + (length & 1)
    return None
