"""Fixtures of the MERLIN tests: one way to import, one small workspace to damage."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from openprc_merlin import openprc_producers, samples
from openprc_merlin.importer import Importer
from scipy.io import savemat

from openprc.schema import Provenance, Trajectory, TrajectoryWriter

DATA = Path(__file__).resolve().parents[3] / "../shared/data/merlin"


@pytest.fixture(scope="session")
def data():
    if not DATA.exists():
        pytest.skip("the recorded MERLIN runs are not beside this checkout")
    return DATA


@pytest.fixture
def load(tmp_path):
    """Import a file and return everything a test asks about the result."""
    opened = []

    def run(path, **options):
        defaults = {option.name: option.default for option in openprc_producers()[0].options}
        unknown = {key.replace("_", "-") for key in options} - set(defaults)
        assert not unknown
        given = {**defaults, **{key.replace("_", "-"): value for key, value in options.items()}}
        target = tmp_path / f"out{len(opened)}.h5"
        with TrajectoryWriter(
            target, provenance=Provenance("merlin"), on_failure="discard"
        ) as writer:
            Importer().import_run(Path(path), writer, options=given)
            notes = writer.notes
        trajectory = Trajectory(target)
        opened.append(trajectory)
        return SimpleNamespace(
            path=target, trajectory=trajectory, notes=notes, text="\n".join(notes)
        )

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def space():
    """Return a fresh copy of the sample's variables."""
    return samples.workspace()


@pytest.fixture
def mat(tmp_path):
    """Write variables to a MAT-file of level 5."""

    def write(variables, name="run.mat", **options):
        path = tmp_path / name
        savemat(path, variables, **options)
        return path

    return write


def element(kind: int, payload: bytes) -> bytes:
    """Return a tagged element of a level 5 file, padded to eight bytes."""
    return struct.pack("<II", kind, len(payload)) + payload + b"\0" * (-len(payload) % 8)


def matrix(array_class: int, name: str, body: bytes, *, shape=(1, 1)) -> bytes:
    """Return a matrix element; opaque objects (class 17) carry no dimensions."""
    parts = element(6, struct.pack("<II", array_class, 0))
    if array_class != 17:
        parts += element(5, np.array(shape, "<i4").tobytes())
    parts += element(1, name.encode())
    return element(14, parts + body)


@pytest.fixture
def raw_matrix():
    return matrix


@pytest.fixture
def raw_element():
    return element


def put_v73(group, name, value, refs):
    """Store one value as MATLAB v7.3 does."""
    if isinstance(value, dict):
        child = group.create_group(name)
        child.attrs["MATLAB_class"] = np.bytes_(b"struct")
        for key, item in value.items():
            put_v73(child, key, item, refs)
        return
    if isinstance(value, str):
        codes = np.array([[ord(c)] for c in value], "u2")
        item = group.create_dataset(name, data=codes)
        item.attrs["MATLAB_class"] = np.bytes_(b"char")
        item.attrs["MATLAB_int_decode"] = np.int32(2)
        return
    value = np.asarray(value)
    if value.dtype == object:
        cells = group.create_dataset(name, (1, value.size), dtype=h5py.ref_dtype)
        for index, cell in enumerate(value.ravel()):
            put_v73(refs, f"c{len(refs)}", cell, refs)
            cells[0, index] = refs[f"c{len(refs) - 1}"].ref
        cells.attrs["MATLAB_class"] = np.bytes_(b"cell")
        return
    if value.size == 0:
        item = group.create_dataset(name, data=np.array(value.shape, "u8"))
        item.attrs["MATLAB_empty"] = np.uint8(1)
    elif value.dtype.kind == "c":
        pairs = np.empty(value.T.shape, [("real", "f8"), ("imag", "f8")])
        pairs["real"], pairs["imag"] = value.T.real, value.T.imag
        item = group.create_dataset(name, data=pairs)
    else:
        item = group.create_dataset(name, data=np.atleast_2d(value).T)
    item.attrs["MATLAB_class"] = np.bytes_(b"double")


def v73_file(path, variables):
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")
        for name, value in variables.items():
            put_v73(file, name, value, refs)
        handle = file["truss"].create_group("CM") if "truss" in file else None
        if handle is not None:
            handle.attrs["MATLAB_class"] = np.bytes_(b"function_handle")
            put_v73(handle, "function_handle", {"function": "@(Ex)Ogden(Ex,1e4)"}, refs)
            sparse = file["truss"].create_group("B")
            sparse.attrs["MATLAB_class"] = np.bytes_(b"double")
            sparse.attrs["MATLAB_sparse"] = np.uint64(5)
            sparse["ir"] = np.zeros(3, "u8")
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as stream:
        stream.write(header)


@pytest.fixture
def write_v73():
    """Write variables to a file in the layout of MATLAB v7.3."""
    return v73_file
