"""Damaged and hostile copies of a sample."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from openprc.schema.safety import is_hdf5

#: Shares of a file that are left of it.
CUTS = (0.03, 0.35, 0.7, 0.95)
#: Bytes missing at the end: what a process that was killed leaves.
TAILS = (1, 7)
_HEADER = 4096


def members(path: Path) -> list[Path]:
    """Return the files of a sample: itself, or all below it."""
    if path.is_file():
        return [path]
    return sorted(member for member in path.rglob("*") if member.is_file())


def truncate(path: Path, size: int) -> None:
    """Keep the first bytes of a file."""
    os.truncate(path, size)


def sizes_to_cut(size: int) -> list[int]:
    """Return sizes to truncate a file to, each once."""
    wanted = [int(size * share) for share in CUTS] + [size - tail for tail in TAILS]
    return sorted({value for value in wanted if 0 < value < size})


@contextlib.contextmanager
def restored(file: Path) -> Iterator[bytes]:
    """Yield the content of a file, and put it back afterwards."""
    content = file.read_bytes()
    try:
        yield content
    finally:
        file.write_bytes(content)


def chosen(path: Path, rng: np.random.Generator) -> Path:
    """Return one of the files of a sample that hold something."""
    files = [member for member in members(path) if member.stat().st_size]
    return files[int(rng.integers(len(files)))]


def flip(file: Path, rng: np.random.Generator) -> str:
    """Flip some bits of a file; return what was done."""
    content = bytearray(file.read_bytes())
    # Half of the damage goes where formats keep their structure.
    end = len(content) if rng.random() < 0.5 else min(len(content), _HEADER)
    places = sorted(int(place) for place in rng.integers(0, end, int(rng.integers(1, 9))))
    for place in places:
        content[place] ^= 1 << int(rng.integers(8))
    file.write_bytes(content)
    return f"bits flipped in {file.name} at bytes {places}"


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, ...]:
        return (os.mkdir, (str(self.marker),))


def _pickle_with_bomb(path: Path, bomb: Bomb) -> bytes:
    """Return the sample's own pickle with a bomb in it, or a pickle that is one."""
    try:
        # The sample was written by the author's own code a moment ago.
        held = pickle.loads(path.read_bytes())  # noqa: S301
    except Exception:  # noqa: BLE001 - it is no pickle, and unpickling noise raises anything
        return pickle.dumps({"time": [0.0, 1.0], "positions": bomb})
    if isinstance(held, dict):
        return pickle.dumps({**held, "bomb": bomb})
    return pickle.dumps([held, bomb])


def _npz_with_bomb(path: Path, bomb: Bomb) -> bytes:
    """Return the sample's own arrays, each of type object with a bomb, or such an array."""
    arrays: dict[str, Any] = {"time": None, "positions": None}
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            arrays = {n.removesuffix(".npy"): None for n in archive.namelist()} or arrays
    hostile = np.empty(2, dtype=object)
    hostile[0] = hostile[1] = bomb
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=True, **dict.fromkeys(arrays, hostile))
    return buffer.getvalue()


def bombs(path: Path, marker: Path) -> Iterator[tuple[str, bytes]]:
    """Yield contents that run code when they are unpickled, with what they are."""
    bomb = Bomb(marker)
    yield "a pickle that runs code", _pickle_with_bomb(path, bomb)
    yield "an array of objects that run code (npz)", _npz_with_bomb(path, bomb)
    buffer = io.BytesIO()
    hostile = np.empty(1, dtype=object)
    hostile[0] = bomb
    np.save(buffer, hostile, allow_pickle=True)
    yield "an array of objects that run code (npy)", buffer.getvalue()


def redirected(path: Path, outside: Path, *, virtual: bool) -> bool:
    """Move every dataset of an HDF5 file to `outside` and lead there from where it was.

    Returns whether there was anything to move; a file of another format is replaced with an
    HDF5 file of which all data are elsewhere.
    """
    if not is_hdf5(path):
        with h5py.File(outside, "w") as file:
            file["time"] = np.arange(5.0)
            file["positions"] = np.zeros((5, 2, 3))
        path.unlink()
        with h5py.File(path, "w") as file:
            for name in ("time", "positions"):
                file[name] = h5py.ExternalLink(str(outside), name)
        return True
    shutil.copyfile(path, outside)
    names: list[str] = []
    with h5py.File(path, "r+") as file:
        file.visititems(lambda name, item: names.append(name) if _plain(item) else None)
        for name in names:
            dataset = file[name]
            attributes = dict(dataset.attrs)
            layout = h5py.VirtualLayout(dataset.shape, dataset.dtype) if virtual else None
            del file[name]
            if layout is None:
                file[name] = h5py.ExternalLink(str(outside), name)
                continue
            layout[...] = h5py.VirtualSource(str(outside), name, shape=layout.shape)
            file.create_virtual_dataset(name, layout).attrs.update(attributes)
    return bool(names)


def _plain(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and item.ndim > 0 and item.dtype.kind in "iuf"


def traversing_archive() -> bytes:
    """Return a zip archive whose members want to be written outside the folder."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("../escaped.txt", "out")
        archive.writestr("positions.npy", b"\x93NUMPY")
    return buffer.getvalue()


def entity_document(outside: Path) -> bytes:
    """Return an XML document that wants another file to be read into it."""
    return (
        f'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY e SYSTEM "{outside.as_uri()}">]>'
        "<a><b>&e;</b></a>"
    ).encode()


__all__ = [
    "Bomb",
    "bombs",
    "chosen",
    "entity_document",
    "flip",
    "members",
    "redirected",
    "restored",
    "sizes_to_cut",
    "traversing_archive",
    "truncate",
]
