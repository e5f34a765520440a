"""Small scenes that together use everything a back end has to know."""

import numpy as np

from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import BAR_LAWS, Bars, Geometry, Hinges


def scene_of_every_law(seed=0, **settings):
    """Random nodes with bars of every law, hinges within and beyond limits, and every drive."""
    rng = np.random.default_rng(seed)
    n, n_bars, n_hinges = 9, 20, 8
    x = rng.normal(size=(n, 3))
    every = np.array([(i, j) for i in range(n) for j in range(i)])
    pairs = rng.permuted(every[rng.permutation(len(every))[:n_bars]], axis=1)
    # Each law twice stretched, twice pressed.
    relaxed = np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1)
    relaxed *= np.where(np.arange(n_bars) % 2, 0.9, 1.1)
    law = np.repeat(BAR_LAWS, n_bars // len(BAR_LAWS))
    cubic = law == "cubic"
    quads = np.array([rng.choice(n, 4, replace=False) for _ in range(n_hinges)])
    fixed = np.zeros(n, dtype=bool)
    fixed[0] = True
    velocities = rng.normal(size=(n, 3))
    velocities[fixed] = 0.0
    geometry = Geometry(
        positions=x,
        masses=rng.uniform(1, 3, n),
        fixed=fixed,
        velocities=velocities,
        bars=Bars(
            indices=pairs,
            stiffness=rng.uniform(5, 20, n_bars),
            rest_length=relaxed / 1.05,
            prestress=np.full(n_bars, 0.05),
            damping=rng.uniform(0.1, 1, n_bars),
            law=law,
            stiffness_cubic=np.where(cubic, rng.uniform(5, 20, n_bars), 0),
            damping_cubic=np.where(cubic, rng.uniform(0.1, 1, n_bars), 0),
        ),
        hinges=Hinges(
            indices=quads,
            stiffness=rng.uniform(0.5, 1, n_hinges),
            rest_angle=rng.uniform(2.5, 3.5, n_hinges),
            damping=rng.uniform(0.01, 0.1, n_hinges),
            law=np.where(np.arange(n_hinges) < 6, "enhanced-linear", "linear"),
            limit_low=np.where(np.arange(n_hinges) < 6, 2.0, 0.0),
            limit_high=np.where(np.arange(n_hinges) < 6, 4.0, 2 * np.pi),
        ),
    )
    signals = [
        Signal(name="line", values=x[1, 0] + [0, 0.02, -0.01, 0.03], dt=0.004),
        Signal(name="steps", values=x[2, 1] + [0, 0.02, 0.02, -0.01], dt=0.003,
               interpolation="hold"),
        Signal(name="speed", values=rng.normal(size=(6, 3)), dt=0.003, interpolation="cubic"),
        Signal(name="push", values=10 * rng.normal(size=(3, 3)), dt=0.005, interpolation="hold"),
        Signal(name="pull", values=5 * rng.normal(size=7), dt=0.002, interpolation="cubic"),
    ]  # fmt: skip
    actuators = (
        Actuator(node=1, signal="line", axes=(True, False, False)),
        Actuator(node=2, signal="steps", axes=(False, True, False)),
        Actuator(node=3, signal="speed", type="velocity", axes=(True, False, True)),
        Actuator(node=4, signal="push", type="force"),
        Actuator(node=4, signal="pull", type="force", axes=(False, True, True)),
        Actuator(node=2, signal="pull", type="force", axes=(True, False, False)),
    )
    settings = {"duration": 0.012, "dt": 0.001, "save_interval": 0.004} | settings
    return Experiment(
        geometry=geometry,
        signals={signal.name: signal for signal in signals},
        actuators=actuators,
        gravity=(0.3, -1.0, 2.0),
        damping=0.7,
        **settings,
    )


def scene_with_printed_damping(**settings):
    """A chain of unequal masses whose dampers act on the whole relative velocity."""
    rng = np.random.default_rng(3)
    n = 6
    x = np.column_stack([np.arange(n), 0.1 * rng.normal(size=(n, 2))])
    bars = Bars(
        indices=np.column_stack([np.arange(n - 1), np.arange(1, n)]),
        stiffness=rng.uniform(5, 20, n - 1),
        rest_length=np.ones(n - 1),
        damping=np.array([0.1, 0.0, 0.2, 0.05, 0.3]),
    )
    geometry = Geometry(
        positions=x, masses=rng.uniform(1, 3, n), velocities=rng.normal(size=(n, 3)), bars=bars
    )
    settings = {"duration": 0.02, "dt": 0.002, "save_interval": 0.01} | settings
    return Experiment(geometry=geometry, bar_damping="printed", **settings)


def scene_of_linear_laws(**settings):
    """A hinge, bars and every kind of drive, with the laws that all small scenes are made of."""
    rng = np.random.default_rng(5)
    x = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0.2], [0.4, -1, 0.3], [1.5, 1, 0.5]], float)
    pairs = np.array([[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 4], [1, 4]])
    lengths = np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1)
    geometry = Geometry(
        positions=x,
        masses=rng.uniform(1, 3, 5),
        fixed=[True, False, False, False, False],
        bars=Bars(
            indices=pairs,
            stiffness=rng.uniform(20, 40, 7),
            rest_length=lengths * rng.uniform(0.95, 1.05, 7),
            damping=rng.uniform(0.1, 1, 7),
        ),
        hinges=Hinges(indices=[[0, 1, 2, 3]], stiffness=[2.0], rest_angle=[2.5], damping=[0.1]),
    )
    signals = [
        Signal(name="move", values=[0.0, 0.1, 0.1, -0.1], dt=0.02, interpolation="hold"),
        Signal(name="speed", values=rng.normal(size=(6, 3)), dt=0.02, interpolation="cubic"),
        Signal(name="push", values=10 * rng.normal(size=(6, 3)), dt=0.025, interpolation="cubic"),
    ]
    actuators = (
        Actuator(node=1, signal="move", axes=(False, True, False)),
        Actuator(node=2, signal="speed", type="velocity", axes=(True, False, False)),
        Actuator(node=4, signal="push", type="force"),
    )
    settings = {"duration": 0.1, "dt": 0.005, "save_interval": 0.02} | settings
    return Experiment(
        geometry=geometry,
        signals={signal.name: signal for signal in signals},
        actuators=actuators,
        gravity=(0.0, 0.0, -9.81),
        damping=0.3,
        **settings,
    )
