"""Fixtures of this plugin's tests: one import, closed-form rods, a pickle writer."""

from __future__ import annotations

import pickle
from collections import defaultdict
from pathlib import Path

import h5py
import numpy as np
import pytest
from openprc_pyelastica import openprc_producers
from openprc_pyelastica.importer import Importer

from openprc.schema import Provenance, Trajectory, TrajectoryWriter


def default_options(**given):
    spec = openprc_producers()[0]
    options = {o.name: () if o.multiple else o.default for o in spec.options}
    unknown = set(given) - set(options) - {"trust"}
    assert not unknown, unknown
    return {**options, "trust": True, **given}


@pytest.fixture
def run_import(tmp_path):
    """Import a path and return the open Trajectory; the source must come out untouched."""
    opened = []

    def run(path, **given):
        path = Path(path)
        before = path.read_bytes() if path.is_file() else None
        out = tmp_path / f"out{len(opened)}.h5"
        with TrajectoryWriter(
            out, provenance=Provenance("pyelastica"), on_failure="discard"
        ) as writer:
            Importer().import_run(path, writer, options=default_options(**given))
        assert before is None or path.read_bytes() == before
        opened.append(Trajectory(out))
        return opened[-1]

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def refuses(tmp_path):
    """Import a path that must be refused, and check that nothing was written."""

    def run(path, kind, match, **given):
        folder = tmp_path / "refused"
        out = folder / "out.h5"
        with (
            pytest.raises(kind, match=match) as caught,
            TrajectoryWriter(
                out, provenance=Provenance("pyelastica"), on_failure="discard"
            ) as writer,
        ):
            Importer().import_run(Path(path), writer, options=default_options(**given))
        assert list(folder.iterdir()) == []
        assert caught.value.file is not None
        return caught.value

    return run


@pytest.fixture
def wave():
    """Return a closed-form rod: node i at x = 0.1 i, z = 0.01 i sin t (+ shifts to tell axes)."""

    def make(n_nodes=6, n_frames=40, dt=0.05, offset=0.0):
        time = dt * np.arange(n_frames)
        node = np.arange(n_nodes)
        position = np.zeros((n_frames, 3, n_nodes))
        position[:, 0] = 0.1 * node + offset
        position[:, 1] = 2.0 + offset
        position[:, 2] = 0.01 * node * np.sin(time)[:, np.newaxis]
        velocity = np.zeros_like(position)
        velocity[:, 2] = 0.01 * node * np.cos(time)[:, np.newaxis]
        return {"time": time, "position": position, "velocity": velocity}

    return make


@pytest.fixture
def dump(tmp_path):
    """Pickle an object as callbacks leave it: a defaultdict of lists of samples."""

    def write(content, name="run.dat", *, as_lists=True):
        if as_lists:
            lists = defaultdict(list)
            for key, values in content.items():
                lists[key] = list(values)
            content = lists
        path = tmp_path / name
        with path.open("wb") as stream:
            pickle.dump(content, stream)
        return path

    return write


@pytest.fixture
def notes():
    """Return the notes of a trajectory as one text."""
    return lambda trajectory: "\n".join(trajectory.provenance["notes"])


@pytest.fixture
def extension():
    """Read an array below the plugin's subtree: values, unit, comment."""

    def read(trajectory, name):
        with h5py.File(trajectory.path) as file:
            item = file[f"extensions/openprc-pyelastica/{name}"]
            return item[()], item.attrs["unit"], item.attrs.get("comment", "")

    return read


@pytest.fixture
def check(wave):
    """Assert that a trajectory is the closed-form rod."""

    def same(run, *, nodes=slice(None), velocities=True, **given):
        expected = wave(**given)
        np.testing.assert_array_equal(run.time, expected["time"])
        np.testing.assert_array_equal(
            run.positions()[:, nodes], expected["position"].transpose(0, 2, 1)
        )
        if velocities:
            np.testing.assert_array_equal(
                run.velocities()[:, nodes], expected["velocity"].transpose(0, 2, 1)
            )

    return same
