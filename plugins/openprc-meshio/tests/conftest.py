"""Fixtures of the mesh tests: one way to import, small XDMF texts, a reader of exports."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from openprc_meshio import openprc_producers

from openprc.hooks import import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
STEPS = 5


@pytest.fixture
def load(tmp_path):
    """Import a path and return everything a test asks about the result."""
    opened = []

    def run(path, *, unit="mm", **options):
        known = {option.name for option in openprc_producers()[0].options}
        assert set(options) <= known
        target = tmp_path / "imported" / f"{len(opened)}.h5"
        given = {**options, **({"unit": unit} if unit else {})}
        done = import_file(path, target, as_name="meshio", options=given)
        trajectory = Trajectory(target)
        opened.append(trajectory)
        return SimpleNamespace(path=target, run=trajectory, notes="\n".join(done.notes), done=done)

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def motion():
    """Return places of four nodes in five frames, in closed form: (T, N, 3)."""
    turns = 0.3 * np.arange(STEPS)
    lift = np.sin(turns)[:, None] * np.array([0.0, 1.0, 2.0, -1.0])
    moved = np.repeat(POINTS[None], STEPS, axis=0)
    moved[:, :, 2] = lift
    moved[:, :, 0] += 0.1 * turns[:, None]
    return moved


def item(values, *, number=None):
    """Return a data item with its numbers in the text."""
    values = np.asarray(values)
    number = number or ("Int" if values.dtype.kind in "iu" else "Float")
    size = " ".join(map(str, values.shape))
    text = " ".join(map(repr, values.reshape(-1).tolist()))
    return (
        f'<DataItem Format="XML" NumberType="{number}" Precision="8" Dimensions="{size}">'
        f"{text}</DataItem>"
    )


def attribute(name, values, centre="Node"):
    return f'<Attribute Name="{name}" Center="{centre}">{item(values)}</Attribute>'


def mesh(points=POINTS, cells=TRIANGLES, kind="Triangle"):
    places = "XYZ" if np.shape(points)[1] == 3 else "XY"
    return (
        f'<Topology TopologyType="{kind}" NumberOfElements="{len(cells)}">{item(cells)}</Topology>'
        f'<Geometry GeometryType="{places}">{item(points)}</Geometry>'
    )


def temporal(steps, *, name="steps"):
    inner = "".join(f'<Grid Name="step" GridType="Uniform">{step}</Grid>' for step in steps)
    return f'<Grid Name="{name}" GridType="Collection" CollectionType="Temporal">{inner}</Grid>'


@pytest.fixture
def xml():
    """Return the pieces of an XDMF text."""
    return SimpleNamespace(item=item, attribute=attribute, mesh=mesh, temporal=temporal)


@pytest.fixture
def xdmf(tmp_path):
    """Write the inside of a Domain into an XDMF file."""

    def write(inside, *, name="run.xdmf", head='<?xml version="1.0"?>'):
        path = tmp_path / name
        path.write_text(f'{head}<Xdmf Version="3.0"><Domain>{inside}</Domain></Xdmf>')
        return path

    return write


@pytest.fixture
def trajectory(tmp_path):
    """Write a trajectory with bars, faces, velocities and strains; return its path."""

    def write(
        *, name="run.h5", dims=3, frames=7, bars=True, faces=True, times=None, dtype="f8",
        missing=False, unit="mm",
    ):  # fmt: skip
        rng = np.random.default_rng(7)
        path = tmp_path / name
        places = rng.normal(size=(frames, 4, dims))
        speeds = rng.normal(size=(frames, 4, dims))
        given = {}
        if missing:
            marks = np.ones((frames, 4), "u1")
            marks[2, 1] = 0
            marks[3, 1] = 2
            places[2, 1] = np.nan
            given["observed"] = marks
        with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
            writer.declare_nodes(4, dims, unit=unit, velocities=True, dtype=dtype, observed=missing)
            elements = {}
            if bars:
                writer.declare_elements(
                    "bars", [[0, 1], [1, 2], [2, 3]], series={"strain": "1", "force": "N"},
                    dtype=dtype,
                )  # fmt: skip
                elements["bars", "strain"] = rng.normal(size=(frames, 3))
                elements["bars", "force"] = rng.normal(size=(frames, 3))
            if faces:
                writer.declare_elements("faces", TRIANGLES, series={"area": "m2"})
                elements["faces", "area"] = rng.random((frames, 2))
            writer.declare_channel("gauge", ["gauge"], unit="V")
            clock = 0.1 * np.arange(frames) if times is None else np.asarray(times)
            writer.append(
                clock, positions=places, velocities=speeds, elements=elements,
                channels={"gauge": np.zeros((frames, 1))}, **given,
            )  # fmt: skip
        return path

    return write
