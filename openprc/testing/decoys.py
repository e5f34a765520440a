"""Files that an importer must not claim, and other samples."""

from __future__ import annotations

import io
import json
import pickle
import shutil
import zipfile
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from openprc.hooks.protocols import Sample
from openprc.hooks.registry import Registered, Registry, missing_packages, resolve
from openprc.schema.provenance import Provenance
from openprc.schema.writer import TrajectoryWriter
from openprc.testing.workbench import as_sample, kit_folder

#: Bytes that are left of a truncated file: at most a signature. (Who claims a container by a
#: whole signature may have reasons: its error is more helpful than that nobody claims it.)
HEAD = 8

_TEXT = """Dear reader,

this is a letter, and a letter is no recording: it has commas, numbers such as 1, 2, 3, and
several lines; but nothing in it was ever measured.
"""


def _npz() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, weights=np.ones((3, 4)), bias=np.zeros(4))
    return buffer.getvalue()


def _hdf5() -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["network/kernel"] = np.ones((3, 4))
        file.attrs["keras_version"] = "3.0"
    return buffer.getvalue()


def _zip() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("mimetype", "application/epub+zip")
        archive.writestr("chapter1.xhtml", _TEXT)
    return buffer.getvalue()


def _trajectory() -> bytes:
    """Return a finished file of this package, which nobody has to import."""
    path = kit_folder() / "own-decoy.h5"
    if not path.exists():
        with TrajectoryWriter(path, provenance=Provenance("decoy")) as writer:
            writer.declare_nodes(2, 3, unit="m")
            for i in range(3):
                writer.append(0.1 * i, positions=np.full((2, 3), 0.1 * i))
    return path.read_bytes()


@cache
def contents() -> dict[str, bytes]:
    """Return contents that are no run of any simulator, by what they are."""
    return {
        "noise": np.random.default_rng(4).bytes(5000),
        "zeros": bytes(5000),
        "a letter": _TEXT.encode(),
        "a JSON object": json.dumps({"name": "x", "values": [1, 2, 3]}).encode(),
        "a table of words": b"name,colour\nbox,red\nball,blue\n",
        "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(200)),
        "unrelated arrays (npz)": _npz(),
        "unrelated data (HDF5)": _hdf5(),
        "an archive of text (zip)": _zip(),
        "a pickled dictionary": pickle.dumps({"weights": [1.0, 2.0], "epoch": 3}),
        "a finished trajectory of OpenPRC": _trajectory(),
    }


def truncated(path: Path, folder: Path) -> Path:
    """Copy a file or folder with nothing but the first bytes of every file."""
    if path.is_dir():
        target = folder / path.name
        shutil.copytree(path, target)
        for member in target.rglob("*"):
            if member.is_file():
                member.write_bytes(member.read_bytes()[:HEAD])
        return target
    target = folder / path.name
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(path.read_bytes()[:HEAD])
    return target


def other_samples(registry: Registry, own: Registered) -> list[tuple[str, Sample]]:
    """Return the samples of every other importer, each made once a process."""
    found = []
    for item in registry.producers:
        if item.qualified_name == own.qualified_name or "import" not in item.spec.capabilities:
            continue
        if item.spec.sample and not missing_packages(item.spec, "import"):
            found.append((item.name, _sample_of(item)))
    return found


_OTHERS: dict[str, Sample] = {}


def _sample_of(item: Registered) -> Sample:
    if item.qualified_name not in _OTHERS:
        folder = kit_folder() / "others" / item.qualified_name
        folder.mkdir(parents=True)
        made = resolve(item, item.spec.sample)(folder)
        _OTHERS[item.qualified_name] = as_sample(made, item.name)
    return _OTHERS[item.qualified_name]


__all__ = ["HEAD", "contents", "other_samples", "truncated"]
