"""Fixtures of this plugin's tests: one import, closed-form rods, a pickle writer, stubs, chains."""

from __future__ import annotations

import pickle
import sys
import types
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
from openprc_pyelastica import openprc_producers
from openprc_pyelastica.importer import Importer
from openprc_pyelastica.producer import Producer

from openprc.hooks.running import simulate
from openprc.schema import Experiment, Provenance, Trajectory, TrajectoryWriter
from openprc.schema.geometry import Bars, Bends, Geometry


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


# --- simulators that are not there: what the recorder sees of one, without compiling it ----------


class StubBody:
    """A rod or rigid body whose arrays are strided views into a block, as PyElastica's are."""

    def __init__(self, n_nodes, *, offset=0.0, ring=False):
        block = np.zeros((3, n_nodes + 2))
        self.position_collection = block[:, 1:-1]
        self.velocity_collection = np.zeros((3, n_nodes + 2))[:, 1:-1]
        self.position_collection[0] = offset + 0.1 * np.arange(n_nodes)
        self.mass = np.full(n_nodes, 0.5)


class StubRod(StubBody):
    def __init__(self, n_nodes, *, offset=0.0, ring=False):
        super().__init__(n_nodes, offset=offset)
        n = n_nodes if ring else n_nodes - 1
        self.rest_lengths = np.full(n, 0.1)
        self.radius = np.full(n, 0.01)
        self.director_collection = np.arange(9.0 * n).reshape(3, 3, n)
        self.sigma = np.arange(3.0 * n).reshape(3, n)
        self.kappa = np.arange(3.0 * (n if ring else n - 1)).reshape(3, -1)
        self.shear_matrix = np.zeros((3, 3, n))
        self.shear_matrix[0, 0] = self.shear_matrix[1, 1] = 100.0
        self.shear_matrix[2, 2] = 300.0
        self.external_forces = np.zeros((3, n_nodes))

    def move(self, time):
        """Put the nodes where `expected` says."""
        index = np.arange(self.position_collection.shape[1])
        self.position_collection[1] = 0.01 * index * np.sin(time)
        self.velocity_collection[1] = 0.01 * index * np.cos(time)


class Sphere(StubBody):
    def __init__(self, offset=0.0):
        super().__init__(1, offset=offset)
        self.director_collection = np.eye(3)[:, :, np.newaxis]

    def move(self, time):
        self.position_collection[2] = time


class Plane:
    """Has no nodes."""


class StubConnection:
    _connect_cls = type("FreeJoint", (), {})

    def __init__(self, *entries):
        self.id = lambda: entries


class StubSimulator(list):
    """What PyElastica's collections offer a recorder, step by step."""

    def __init__(self, *systems):
        super().__init__(systems)
        self._finalize_flag = False
        self._callback_list = []
        self._connections = []
        self._feature_group_finalize = []
        self.calls = []
        self.step_number = 0

    def collect_diagnostics(self, system):
        assert any(system is other for other in self)
        simulator = self

        class Register:
            def using(self, kind, *args, **kwargs):
                simulator._callback_list.append((system, kind, args, kwargs))

        return Register()

    def finalize(self):
        self._finalize_flag = True
        for finalize in self._feature_group_finalize:
            finalize()
        for system, kind, args, kwargs in self._callback_list:
            self.calls.append((kind(*args, **kwargs), system))
        del self._callback_list, self._connections
        self.fire(0.0)

    def fire(self, time):
        for callback, system in self.calls:
            callback.make_callback(system=system, time=time, current_step=self.step_number)

    def run(self, steps, dt=0.01):
        for _ in range(steps):
            self.step_number += 1
            time = self.step_number * dt
            for system in self:
                if hasattr(system, "move"):
                    system.move(time)
            self.fire(time)

    def close(self):
        for callback, _ in self.calls:
            callback.on_close()


@pytest.fixture
def stub(monkeypatch):
    """Return the stub classes, with a stub of the simulator's package in place."""
    functions = types.ModuleType("elastica.callback_functions")
    functions.CallBackBaseClass = type("CallBackBaseClass", (), {})
    package = types.ModuleType("elastica")
    package.callback_functions = functions
    monkeypatch.setitem(sys.modules, "elastica", package)
    monkeypatch.setitem(sys.modules, "elastica.callback_functions", functions)
    return types.SimpleNamespace(
        Simulator=StubSimulator,
        Rod=StubRod,
        Sphere=Sphere,
        Plane=Plane,
        Connection=StubConnection,
    )


@pytest.fixture
def recording(stub, tmp_path):
    """Attach the recorder to a simulator and give its path, writer and session."""

    @contextmanager
    def begin(simulator, **options):
        path = tmp_path / "recorded.h5"
        with TrajectoryWriter(path, provenance=Provenance("pyelastica")) as writer:
            attached = Producer().attach(simulator, writer, **options)
            with attached as session:
                yield types.SimpleNamespace(path=path, writer=writer, session=session)

    return begin


# --- chains of bars and bends, for the runner -----------------------------------------------------


def chain(n, *, length=1.0, radius=0.02, density=1000.0, modulus=1e6, fixed=(), along="x", **given):
    """Return the geometry of the chain that is a uniform round rod of n elements.

    `given` replaces masses, positions or velocities; `bend` scales the bends, None leaves them
    out.
    """
    area = np.pi * radius**2
    bend = given.pop("bend", 1.0)
    element = length / n
    positions = np.zeros((n + 1, 3))
    positions[:, "xyz".index(along.strip("-"))] = np.linspace(0.0, length, n + 1)
    masses = np.full(n + 1, density * area * element)
    masses[[0, -1]] /= 2
    node = np.arange(n)
    bars = Bars(
        indices=np.stack([node, node + 1], axis=1),
        stiffness=np.full(n, modulus * area / element),
        rest_length=np.full(n, element),
    )
    inner = np.arange(n - 1)
    bends = Bends()
    if bend is not None:
        bends = Bends(
            indices=np.stack([inner, inner + 1, inner + 2], axis=1),
            stiffness=np.full(n - 1, bend * modulus * area * radius**2 / 4 / element),
        )
    held = np.zeros(n + 1, dtype=bool)
    held[list(fixed)] = True
    columns = {"positions": -positions if "-" in along else positions, "masses": masses} | given
    return Geometry(fixed=held, bars=bars, bends=bends, **columns)


@pytest.fixture
def make_chain():
    """Return `chain`."""
    return chain


@pytest.fixture
def make_experiment():
    """Return an experiment of a geometry, by default one of 0.1 s."""

    def make(geometry, **given):
        settings = {"duration": 0.1, "dt": 5e-4, "save_interval": 0.01, "integrator": "verlet"}
        return Experiment(geometry=geometry, **settings | given)

    return make


@pytest.fixture
def run_rods(tmp_path):
    """Run an experiment with PyElastica and return the open Trajectory."""
    opened = []

    def run(experiment, **options):
        path = tmp_path / f"rods{len(opened)}.h5"
        simulate(
            experiment,
            Producer(),
            target=path,
            provenance=Provenance("pyelastica"),
            owner="openprc-pyelastica/pyelastica",
            options=options,
        )
        opened.append(Trajectory(path))
        return opened[-1]

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def rod_modes():
    """Return frequencies [Hz] and deflections of a straight rod, from dense matrices.

    Shear strains ``(w[i+1] - w[i]) / l - e q[i]`` of element i, stretched by e, differences of
    the rotations q at inner nodes, and tension T that resists deflection: the linear theory of
    what PyElastica computes, written without looking at the banded matrices of the runner.
    """

    def modes(*, shear, bend, mass, inertia, length, held, turned=(), tension=0.0, stretch=1.0):
        n = len(mass) - 1
        columns = [np.broadcast_to(np.asarray(value, float), (n,)) for value in
                   (shear, length, tension, stretch, inertia)]  # fmt: skip
        shear, length, tension, stretch, inertia = columns
        bend = np.broadcast_to(np.asarray(bend, float), (n - 1,))
        stiffness = np.zeros((2 * n + 1, 2 * n + 1))
        for i in range(n):
            strain, slope = np.zeros((2, 2 * n + 1))
            strain[[2 * i, 2 * i + 1, 2 * i + 2]] = -1 / length[i], -stretch[i], 1 / length[i]
            slope[[2 * i, 2 * i + 2]] = -1.0, 1.0
            stiffness += shear[i] * length[i] * np.outer(strain, strain)
            stiffness += tension[i] / (stretch[i] * length[i]) * np.outer(slope, slope)
        for i in range(n - 1):
            turn = np.zeros(2 * n + 1)
            turn[[2 * i + 1, 2 * i + 3]] = -1.0, 1.0
            stiffness += bend[i] / (0.5 * (length[i] + length[i + 1])) * np.outer(turn, turn)
        weight = np.empty(2 * n + 1)
        weight[::2], weight[1::2] = mass, inertia
        kept = np.ones(2 * n + 1, dtype=bool)
        kept[[2 * node for node in held]] = False
        kept[[2 * element + 1 for element in turned]] = False
        scale = 1.0 / np.sqrt(weight[kept])
        values, vectors = np.linalg.eigh(stiffness[np.ix_(kept, kept)] * np.outer(scale, scale))
        shapes = np.zeros((2 * n + 1, kept.sum()))
        shapes[kept] = vectors * scale[:, np.newaxis]
        return np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi), shapes[::2]

    return modes
