"""Fixtures of the MERLIN tests: one way to import, one small workspace to damage."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace

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
