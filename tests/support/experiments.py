"""Small experiments, right in every respect, that tests put mistakes into."""

from pathlib import Path

import numpy as np

from openprc.schema.experiment import (
    Actuator,
    Collision,
    Experiment,
    Signal,
    save_experiment,
)
from openprc.schema.geometry import Bars, Geometry, Hinges

UPSTREAM = Path(__file__).resolve().parents[2] / "../shared/data/upstream"


def geometry(**changes):
    columns = {
        "positions": [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0]],
        "masses": [0.1, 0.2, 0.3, 0.4],
        "fixed": [True, False, False, False],
        "bars": Bars(
            indices=[[0, 1], [1, 2]],
            stiffness=[10, 20],
            rest_length=[1, 1.1],
            damping=[0.1, 0.2],
            prestress=[0, -0.01],
            rigid=[False, True],
        ),
        "hinges": Hinges(indices=[[0, 1, 2, 3]], stiffness=[0.5], rest_angle=[3.0], damping=[0.01]),
        "faces": [[0, 1, 2], [0, 3, 1]],
        "velocities": [[0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]],
        "labels": ("a", "b", "c", "d"),
    }
    return Geometry(**(columns | changes))


def experiment(**changes):
    settings = {
        "geometry": geometry(),
        "signals": {
            "push": Signal(name="push", values=[0.0, 1.0, 0.5], dt=0.1, interpolation="hold"),
            "move": Signal(name="move", values=np.ones((4, 3)), dt=0.2, interpolation="cubic"),
        },
        "actuators": (
            Actuator(node=1, signal="push", type="force", axes=(False, True, False)),
            Actuator(node=2, signal="move"),
        ),
        "duration": 1.0,
        "dt": 1e-3,
        "save_interval": 1e-2,
        "gravity": (0.0, 0.1, -9.81),
        "damping": 0.3,
        "collision": Collision(enabled=True, radius=0.01),
    }
    return Experiment(**(settings | changes))


def assert_same(one, two):
    for name in ("positions", "masses", "fixed", "velocities", "collidable", "faces"):
        np.testing.assert_array_equal(getattr(one.geometry, name), getattr(two.geometry, name))
    assert one.geometry.labels == two.geometry.labels
    for name in ("indices", "stiffness", "rest_length", "damping", "prestress", "rigid"):
        np.testing.assert_array_equal(
            getattr(one.geometry.bars, name), getattr(two.geometry.bars, name)
        )
    for name in ("indices", "stiffness", "rest_angle", "damping", "rigid"):
        np.testing.assert_array_equal(
            getattr(one.geometry.hinges, name), getattr(two.geometry.hinges, name)
        )
    assert set(one.signals) == set(two.signals)
    for name, signal in one.signals.items():
        other = two.signals[name]
        np.testing.assert_array_equal(signal.values, other.values)
        assert (signal.dt, signal.interpolation) == (other.dt, other.interpolation)
    for name in ("actuators", "duration", "dt", "save_interval", "integrator", "gravity"):
        assert getattr(one, name) == getattr(two, name)
    for name in ("damping", "collision", "overwrite"):
        assert getattr(one, name) == getattr(two, name)


def write_spring(folder: Path) -> Path:
    """Write an experiment of two nodes on a spring, one of them driven: 11 frames."""
    scene = Experiment(
        geometry=Geometry(
            positions=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            masses=[1.0, 1.0],
            bars=Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0]),
        ),
        duration=0.1,
        dt=0.001,
        save_interval=0.01,
        signals={"u": Signal(name="u", values=np.linspace(0.0, 0.1, 11), dt=0.01, unit="m")},
        actuators=(Actuator(node=0, signal="u", axes=(True, False, False)),),
    )
    save_experiment(scene, folder)
    return folder
