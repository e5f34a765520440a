"""Small bodies, and the engine run on them in memory."""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest

from openprc.cli.main import main
from openprc.demlat import BarHingeModel
from openprc.schema.experiment import Actuator, Experiment, Signal, save_experiment
from openprc.schema.geometry import Bars, Geometry, Hinges


@dataclass
class Run:
    """All frames of a run, concatenated."""

    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    length: np.ndarray
    tension: np.ndarray
    angle: np.ndarray
    moment: np.ndarray
    energy: np.ndarray
    ledger: np.ndarray
    bend_angle: np.ndarray
    bend_moment: np.ndarray

    @property
    def kinetic(self):
        return self.energy[:, 0]

    @property
    def potential(self):
        return self.energy[:, 1:].sum(axis=1)

    @property
    def work_in(self):
        return self.ledger[:, 0]

    @property
    def dissipated(self):
        return self.ledger[:, 1:].sum(axis=1)

    @property
    def balance(self):
        """Energy that is not accounted for, relative to t = 0 [J]."""
        energy = self.kinetic + self.potential - self.work_in + self.dissipated
        return energy - energy[0]


@pytest.fixture(scope="session")
def simulate():
    def run(experiment):
        assert BarHingeModel.supports(experiment) == []
        blocks = [
            [np.array(column) for column in block]
            for _, block in BarHingeModel(experiment).blocks()
        ]
        columns = [np.concatenate(column) for column in zip(*blocks, strict=True)]
        return Run(experiment.frame_times, *columns)

    return run


@pytest.fixture(scope="session")
def body():
    """Make an experiment from plain lists; bars are (i, j, k, l0, c)."""

    def make(positions, masses, *, bars=(), hinges=(), signals=(), actuators=(), **settings):
        nodal = {
            key: settings.pop(key) for key in ("fixed", "velocities", "labels") if key in settings
        }
        prestress = settings.pop("prestress", None)
        table = np.array(bars, dtype=float).reshape(-1, 5)
        folds = np.array(hinges, dtype=float).reshape(-1, 7)
        geometry = Geometry(
            positions=positions,
            masses=masses,
            bars=Bars(
                indices=table[:, :2].astype(int),
                stiffness=table[:, 2],
                rest_length=table[:, 3],
                damping=table[:, 4],
                prestress=prestress,
            ),
            hinges=Hinges(
                indices=folds[:, :4].astype(int),
                stiffness=folds[:, 4],
                rest_angle=folds[:, 5],
                damping=folds[:, 6],
            ),
            **nodal,
        )
        times = {"duration": 1.0, "dt": 1e-3, "save_interval": 1e-2} | settings
        return Experiment(
            geometry=geometry,
            signals={signal.name: signal for signal in signals},
            actuators=tuple(actuators),
            **times,
        )

    return make


@pytest.fixture(scope="session")
def lattice(body):
    """Make a free or pinned 3-D lattice with diagonals, masses and stiffnesses spread."""

    def make(n=3, *, damping=0.0, pinned=True, **settings):
        rng = np.random.default_rng(7)
        grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1)
        positions = np.zeros((n * n, 3))
        positions[:, :2] = 0.1 * grid.reshape(-1, 2)
        number = np.arange(n * n).reshape(n, n)
        pairs = [
            *zip(number[:-1].flat, number[1:].flat, strict=True),
            *zip(number[:, :-1].flat, number[:, 1:].flat, strict=True),
            *zip(number[:-1, :-1].flat, number[1:, 1:].flat, strict=True),
            *zip(number[1:, :-1].flat, number[:-1, 1:].flat, strict=True),
        ]
        bars = [
            (
                i,
                j,
                200 * rng.uniform(0.8, 1.2),
                np.linalg.norm(positions[i] - positions[j]),
                damping,
            )
            for i, j in pairs
        ]
        shifted = positions + 0.02 * rng.uniform(-1, 1, positions.shape)
        fixed = np.zeros(n * n, dtype=bool)
        if pinned:
            fixed[:n] = True
            shifted[:n] = positions[:n]
        masses = 0.01 * rng.uniform(0.5, 1.5, n * n)
        settings = {"velocities": rng.uniform(-1, 1, positions.shape)} | settings
        settings["velocities"] = np.where(fixed[:, None], 0.0, settings["velocities"])
        return body(shifted, masses, bars=bars, fixed=fixed, **settings)

    return make


@pytest.fixture(scope="session")
def drive():
    """Make (signal, actuator) for one node."""

    def make(values, *, dt, node=0, type="force", interpolation="linear", axes=(1, 1, 1), name="u"):
        signal = Signal(name=name, values=values, dt=dt, interpolation=interpolation)
        actuator = Actuator(
            node=node, signal=name, type=type, axes=tuple(bool(axis) for axis in axes)
        )
        return signal, actuator

    return make


@pytest.fixture
def command(capsys, monkeypatch):
    """Call the command line with words; returns (exit code, output, errors)."""
    # It replaces this for good, as a program may.
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)

    def call(*words):
        with pytest.raises(SystemExit) as stopped:
            main([str(word) for word in words])
        printed = capsys.readouterr()
        return stopped.value.code or 0, printed.out, printed.err

    return call


@pytest.fixture
def folder(tmp_path, lattice, drive):
    scene = lattice(3, damping=0.05, gravity=(0.0, 0.0, -9.81), labels=tuple("abcdefghi"))
    pushed, pusher = drive([[0.1, 0, 0], [0, 0.2, 0]], dt=0.5, node=8, interpolation="hold")
    moved, mover = drive(
        scene.geometry.positions[7] + [[0, 0, 0], [0, 0, 0.01]],
        dt=1.0,
        node=7,
        type="position",
        axes=(0, 1, 1),
        name="move",
    )
    scene = replace(
        scene, signals={"u": pushed, "move": moved}, actuators=(pusher, mover), damping=0.01
    )
    save_experiment(scene, tmp_path)
    return tmp_path
