"""Scenes whose motion is known in closed form, for every producer that simulates.

Each is a function of the time step that returns a `Scene`. Steps are chosen so that a scheme of
first order with the usual prefactor stays well within the tolerance, while a wrong mass, a
missing factor or a default damping of some per cent does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.scenes.closed_forms import GRAVITY, pendulum_angle, released
from openprc.schema.dihedral import dihedral_angles
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Geometry
from openprc.testing import bodies

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Scene:
    """An experiment and its exact solution.

    Parameters
    ----------
    experiment : Experiment
    exact : callable
        Times (T,) [s] to positions (T, N, 3) [m].
    scale : float [m]
        What deviations are measured in: an amplitude, a distance.
    tolerance : float
        Largest deviation over `scale` that passes.
    centre_only : bool
        Only the centre of mass is compared.
    """

    experiment: Experiment
    exact: Callable[[Array], Array]
    scale: float
    tolerance: float = field(default=1e-2, kw_only=True)
    centre_only: bool = field(default=False, kw_only=True)


def _still(places: Array, moving: Callable[[Array], Array], *, node: int) -> Callable[..., Array]:
    """Return the motion in which one node moves and the others stay."""

    def exact(times: Array) -> Array:
        x = np.repeat(places[np.newaxis], len(times), axis=0)
        x[:, node] = moving(times)
        return x

    return exact


def chain(
    places: Array, *, mass: float, stiffness: float, bend: float, fixed: int = 0,
    velocities: Array | None = None,
) -> Geometry:  # fmt: skip
    """Return a straight chain of equal bars, half the mass at both ends, relaxed at 1 m/segment.

    `bend` above 0 adds a bending spring at every inner node [N*m/rad].
    """
    count = len(places)
    masses = np.full(count, mass)
    masses[[0, -1]] = mass / 2.0
    ends = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    inner = np.column_stack([np.arange(count - 2), np.arange(1, count - 1), np.arange(2, count)])
    return bodies.body(
        positions=places,
        masses=masses,
        fixed=np.arange(count) < fixed,
        velocities=velocities,
        bars=bodies.bars(
            indices=ends, stiffness=np.full(count - 1, stiffness), rest_length=np.ones(count - 1)
        ),
        bends=bodies.bends(indices=inner, stiffness=np.full(len(inner), bend))
        if bend
        else bodies.bends(),
    )


def free_fall(dt: float, *, as_chain: bool = False) -> Scene:
    """One node, or a straight chain, thrown upwards: ``x0 + v0 t + g t^2 / 2``."""
    start = np.array([0.1, -0.2, 1.0]) + (np.arange(4.0)[:, np.newaxis] * X if as_chain else 0.0)
    start = np.atleast_2d(start)
    velocity = np.array([0.5, 0.0, 2.0])
    velocities = np.repeat(velocity[np.newaxis], len(start), axis=0)
    geometry = (
        chain(start, mass=0.3, stiffness=300.0, bend=2.0, velocities=velocities)
        if as_chain
        else bodies.body(positions=start, masses=[0.3], velocities=velocities)
    )

    def exact(times: Array) -> Array:
        t = times[:, np.newaxis, np.newaxis]
        fallen: Array = start + velocity * t - 0.5 * GRAVITY * Z * t**2
        return fallen

    experiment = Experiment(
        geometry=geometry, duration=0.5, dt=1e-3 * dt, save_interval=0.02,
        gravity=(0.0, 0.0, -GRAVITY),
    )  # fmt: skip
    return Scene(experiment, exact, 1.0)


_MASS, _STIFFNESS, _LENGTH, _AMPLITUDE = 0.5, 50.0, 1.0, 0.1


def oscillator(dt: float, *, damping: float = 0.0, drag: float = 0.0) -> Scene:
    """A mass on a bar: ``L + a exp(-d t) (cos w t + d / w sin w t)``, d = c / 2m.

    `damping` [N*s/m] is a dashpot in the bar, `drag` [kg/s] acts on the node.
    """
    places = np.array([0.0 * X, (_LENGTH + _AMPLITUDE) * X])
    decay = (damping + drag) / (2.0 * _MASS)
    omega = math.sqrt(_STIFFNESS / _MASS)

    def moving(t: Array) -> Array:
        length = _LENGTH + _AMPLITUDE * released(t, omega=omega, decay=decay)
        tip: Array = length[:, np.newaxis] * X
        return tip

    experiment = Experiment(
        geometry=bodies.body(
            positions=places,
            masses=[_MASS, _MASS],
            fixed=[True, False],
            bars=bodies.bars(indices=[[0, 1]], stiffness=[_STIFFNESS], rest_length=[_LENGTH],
                      damping=[damping]),
        ),
        duration=3.0, dt=5e-4 * dt, save_interval=0.02, damping=drag,
    )  # fmt: skip
    return Scene(experiment, _still(places, moving, node=1), _AMPLITUDE)


def drag(dt: float) -> Scene:
    """A free node in a medium: ``x0 + v0 m / c (1 - exp(-c t / m))``."""
    places = np.array([[0.0, 0.1, 0.2]])
    velocity, mass, coefficient = np.array([1.0, -0.5, 0.0]), 0.2, 0.6

    def moving(t: Array) -> Array:
        way = mass / coefficient * (1.0 - np.exp(-coefficient * t / mass))
        there: Array = places[0] + way[:, np.newaxis] * velocity
        return there

    experiment = Experiment(
        geometry=bodies.body(positions=places, masses=[mass], velocities=[velocity]),
        duration=1.0, dt=1e-3 * dt, save_interval=0.02, damping=coefficient,
    )  # fmt: skip
    return Scene(experiment, _still(places, moving, node=0), mass / coefficient)


def pendulum(dt: float, *, rigid: bool = False) -> Scene:
    """A large swing from 1.5 rad: ``sin(theta / 2) = k cd(sqrt(g / L) t, k)``, k = sin(0.75).

    A stiff bar stretches by some 1e-4 of its length, which lengthens the period by as much.
    """
    start, length = 1.5, 1.0
    places = np.array([0.0 * X, length * (np.sin(start) * X - np.cos(start) * Z)])

    def moving(t: Array) -> Array:
        theta = pendulum_angle(t, start=start, rate=math.sqrt(GRAVITY / length))
        swung: Array = length * (
            np.sin(theta)[:, np.newaxis] * X - np.cos(theta)[:, np.newaxis] * Z
        )
        return swung

    experiment = Experiment(
        geometry=bodies.body(
            positions=places,
            masses=[1.0, 1.0],
            fixed=[True, False],
            bars=bodies.bars(
                indices=[[0, 1]], stiffness=[5e4], rest_length=[length], rigid=[rigid]
            ),
        ),
        duration=3.0, dt=5e-4 * dt, save_interval=0.02, gravity=(0.0, 0.0, -GRAVITY),
        integrator="rattle" if rigid else "rk4",
    )  # fmt: skip
    return Scene(experiment, _still(places, moving, node=1), length)


def momentum(dt: float) -> Scene:
    """Two free masses that vibrate and tumble: their centre moves at constant velocity."""
    places = np.array([[0.0, 0.0, 0.0], [1.1, 0.0, 0.2]])
    masses = np.array([0.1, 0.3])
    velocities = np.array([[0.3, 1.0, 0.0], [0.0, -0.4, 0.5]])

    def exact(times: Array) -> Array:
        # Only the centre is compared; both nodes are put there.
        centre = masses @ places / masses.sum()
        velocity = masses @ velocities / masses.sum()
        path: Array = centre + times[:, np.newaxis] * velocity
        return path[:, np.newaxis].repeat(2, axis=1)

    experiment = Experiment(
        geometry=bodies.body(
            positions=places, masses=masses, velocities=velocities,
            bars=bodies.bars(indices=[[0, 1]], stiffness=[40.0], rest_length=[1.0], damping=[0.05]),
        ),
        duration=1.0, dt=1e-3 * dt, save_interval=0.02,
    )  # fmt: skip
    return Scene(experiment, exact, 1.0, tolerance=1e-8, centre_only=True)


def rest(dt: float, *, elements: str = "hinges") -> Scene:
    """A body without stress or load: it stays where it is."""
    places = np.array([[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0.1], [0.5, -0.8, 0.3]], dtype=np.float64)
    pairs = np.array([(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)])
    crease = np.array([[0, 1, 2, 3]])
    if elements == "chain":
        geometry = chain(np.arange(4.0)[:, np.newaxis] * X, mass=0.2, stiffness=300.0, bend=2.0)
    else:
        lengths = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
        geometry = bodies.body(
            positions=places,
            masses=np.full(4, 0.2),
            bars=bodies.bars(indices=pairs, stiffness=np.full(5, 80.0), rest_length=lengths),
            hinges=bodies.hinges(indices=crease, stiffness=[0.5],
                          rest_angle=dihedral_angles(places[np.newaxis], crease)[0])
            if elements == "hinges" else bodies.hinges(),
        )  # fmt: skip
    experiment = Experiment(geometry=geometry, duration=0.5, dt=1e-3 * dt, save_interval=0.02)
    body = geometry.positions
    return Scene(
        experiment, lambda times: np.repeat(body[np.newaxis], len(times), axis=0), 1.0,
        tolerance=1e-9,
    )  # fmt: skip


__all__ = [
    "Scene", "chain", "drag", "free_fall", "momentum", "oscillator", "pendulum", "rest",
]  # fmt: skip
