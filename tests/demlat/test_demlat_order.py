"""Order of convergence, measured."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

X, Y, Z = np.eye(3)


def slope(errors):
    """Mean order over successive halvings of the step."""
    return np.mean(np.log2(np.array(errors[:-1]) / np.array(errors[1:])))


def test_fourth_order_on_an_oscillator_with_closed_form(body, simulate):
    k, m, a = 100.0, 1.0, 0.1
    scene = body(
        [0 * X, (1 + a) * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 0)],
        fixed=[True, False],
        save_interval=0.5,
        duration=2.0,
        dt=0.05,
    )
    errors = []
    for dt in 0.05 / 2 ** np.arange(5):
        run = simulate(replace(scene, dt=dt))
        errors.append(np.abs(run.x[:, 1, 0] - 1 - a * np.cos(10 * run.t)).max())
    assert errors[-1] < 1e-6 * a
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def richardson(simulate, scene, steps):
    runs = [simulate(replace(scene, dt=dt)).x for dt in steps]
    return [np.abs(a - b).max() for a, b in pairwise(runs)]


def test_fourth_order_on_a_nonlinear_damped_lattice(lattice, simulate):
    scene = lattice(3, damping=0.02)
    scene = replace(scene, save_interval=0.1, duration=0.3, damping=0.01, gravity=(0, 0, -9.81))
    errors = richardson(simulate, scene, 0.1 / (64 * 2 ** np.arange(5)))
    assert errors[-1] < errors[0] / 2000
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("kind", ["force", "position"])
def test_driven_lattices_keep_the_order(lattice, simulate, drive, kind, interpolation):
    # Jumps and kinks of the signals fall on edges of steps and must not cost the order.
    scene = lattice(3, damping=0.02, velocities=np.zeros((9, 3)))
    rng = np.random.default_rng(1)
    values = rng.uniform(-1, 1, (13, 3))
    if kind == "position":
        values = scene.geometry.positions[8] + 0.01 * values
    signal, actuator = drive(values, dt=0.025, node=8, type=kind, interpolation=interpolation)
    scene = replace(
        scene, signals={"u": signal}, actuators=(actuator,), save_interval=0.1, duration=0.3
    )
    errors = richardson(simulate, scene, 0.1 / (256 * 2 ** np.arange(4)))
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def test_fourth_order_with_hinges(body, simulate):
    h = 0.8
    positions = [0 * X, X, [0.5, -h, 0.2], [0.5, h, 0.3]]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    lengths = [np.linalg.norm(np.subtract(positions[i], positions[j])) for i, j in pairs]
    scene = body(
        positions,
        [0.1] * 4,
        bars=[(i, j, 50, 1.02 * n, 0.01) for (i, j), n in zip(pairs, lengths, strict=True)],
        hinges=[(0, 1, 2, 3, 0.5, np.pi + 0.5, 0.01)],
        save_interval=0.25,
        duration=1.0,
        dt=0.25 / 16,
    )
    errors = richardson(simulate, scene, 0.25 / (16 * 2 ** np.arange(5)))
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def test_the_energy_balance_closes_with_the_same_order(lattice, simulate, drive):
    scene = lattice(3, damping=0.02)
    target = scene.geometry.positions[8] + 0.02 * np.random.default_rng(3).uniform(-1, 1, (13, 3))
    moved, mover = drive(target, dt=0.025, node=8, type="position", interpolation="cubic")
    pushed, pusher = drive([1.0, -2.0, 3.0], dt=0.1, node=7, interpolation="hold", name="push")
    scene = replace(
        scene,
        signals={"u": moved, "push": pushed},
        actuators=(mover, pusher),
        save_interval=0.1,
        duration=0.3,
        damping=0.01,
        gravity=(0.0, 0.0, -9.81),
    )
    errors = []
    for dt in 0.1 / (128 * 2 ** np.arange(4)):
        run = simulate(replace(scene, dt=dt))
        errors.append(np.abs(run.balance).max() / np.ptp(run.work_in))
    assert errors[-1] < 1e-8
    assert slope(errors) > 3.7
