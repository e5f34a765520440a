"""Scenes in closed form that single out one kind of element: bars in turning, hinges, bends."""

from __future__ import annotations

import numpy as np

from openprc.schema.experiment import Experiment
from openprc.testing import bodies
from openprc.testing.closed_form_scenes import Array, Scene, X, Y, Z, chain

_RATE = 5.0  # rad/s


def spinning_pair(dt: float, *, rigid: bool) -> Scene:
    """Two equal masses that turn about their centre at a constant rate w.

    With an inextensible bar the radius is L / 2. With a spring it is the one at which the
    tension holds the masses on their circle, ``k (2 r - L) = m w^2 r``.
    """
    mass, stiffness, length = 0.2, 60.0, 1.0
    radius = length / 2.0 if rigid else stiffness * length / (2.0 * stiffness - mass * _RATE**2)
    places = np.array([-radius * X, radius * X])
    speed = radius * _RATE
    experiment = Experiment(
        geometry=bodies.body(
            positions=places,
            masses=[mass, mass],
            velocities=np.array([-speed * Y, speed * Y]),
            bars=bodies.bars(indices=[[0, 1]], stiffness=[stiffness], rest_length=[length],
                      rigid=[rigid]),
        ),
        duration=2.0, dt=5e-4 * dt, save_interval=0.02,
        integrator="rattle" if rigid else "rk4",
    )  # fmt: skip

    def exact(times: Array) -> Array:
        phase = (_RATE * times)[:, np.newaxis]
        arm = radius * (np.cos(phase) * X + np.sin(phase) * Y)
        return np.stack([-arm, arm], axis=1)

    return Scene(experiment, exact, radius)


def longitudinal_chain(dt: float, *, bend: float = 0.0, clamped: int = 1) -> Scene:
    """The first longitudinal mode of a straight chain of n bars, clamped at one end.

    ``u_i = a sin(pi i / 2n) cos(w t)`` with ``w = 2 sqrt(k / m) sin(pi / 4n)``; exact at any
    amplitude, as bars on a line stay linear. With the first bar clamped as a whole, which is
    how a rod is held, n counts the others.
    """
    count, mass, stiffness, amplitude = 6, 0.2, 400.0, 1e-3
    rest = np.arange(count + 1.0)[:, np.newaxis] * X
    free = count - clamped + 1
    number = np.maximum(np.arange(count + 1.0) - (clamped - 1), 0.0)
    shape = amplitude * np.sin(np.pi * number / (2.0 * free))
    omega = 2.0 * np.sqrt(stiffness / mass) * np.sin(np.pi / (4.0 * free))
    body = chain(rest, mass=mass, stiffness=stiffness, bend=bend, fixed=clamped)
    geometry = bodies.body(
        positions=rest + shape[:, np.newaxis] * X,
        masses=body.masses, fixed=body.fixed, bars=body.bars, bends=body.bends,
    )  # fmt: skip

    def exact(times: Array) -> Array:
        swing = np.cos(omega * times)[:, np.newaxis] * shape
        moved: Array = rest + swing[..., np.newaxis] * X
        return moved

    experiment = Experiment(geometry=geometry, duration=2.0, dt=2.5e-4 * dt, save_interval=0.02)
    return Scene(experiment, exact, amplitude)


_INERTIA_ARM, _SWING = 0.5, 0.6  # m, rad


def hinge(dt: float) -> Scene:
    """A wing that swings about a fixed crease: ``theta = rest + a cos(w t)``, w^2 = k / m h^2.

    The wing hangs on two stiff bars, so that its node stays at the distance h from the crease.
    """
    torsion, mass, rest = 0.2, 0.1, np.pi
    omega = np.sqrt(torsion / mass) / _INERTIA_ARM
    start = rest + _SWING

    def wing(angle: Array) -> Array:
        # The other wing lies along -y; pi is flat, and the angle opens towards -z.
        away = angle - np.pi
        side: Array = _INERTIA_ARM * (
            np.cos(away)[..., np.newaxis] * Y - np.sin(away)[..., np.newaxis] * Z
        )
        return 0.5 * X + side

    places = np.array([0.0 * X, X, wing(np.array(start)), 0.5 * X - _INERTIA_ARM * Y])
    arm = float(np.hypot(0.5, _INERTIA_ARM))
    experiment = Experiment(
        geometry=bodies.body(
            positions=places,
            masses=np.full(4, mass),
            fixed=[True, True, False, True],
            bars=bodies.bars(
                indices=[[0, 2], [1, 2]], stiffness=[2e4, 2e4], rest_length=[arm, arm]
            ),
            hinges=bodies.hinges(indices=[[0, 1, 2, 3]], stiffness=[torsion], rest_angle=[rest]),
        ),
        duration=1.6, dt=2.5e-4 * dt, save_interval=0.02,
    )  # fmt: skip

    def exact(times: Array) -> Array:
        x = np.repeat(places[np.newaxis], len(times), axis=0)
        x[:, 2] = wing(rest + _SWING * np.cos(omega * times))
        return x

    return Scene(experiment, exact, _INERTIA_ARM * _SWING)


def bend(dt: float) -> Scene:
    """An arm that swings about a straight rest: ``phi = a cos(w t)``, w^2 = k / m l^2."""
    torsion, mass = 0.2, 0.1
    omega = np.sqrt(torsion / mass) / _INERTIA_ARM

    def tip(angle: Array) -> Array:
        swung: Array = _INERTIA_ARM * (
            np.cos(angle)[..., np.newaxis] * X + np.sin(angle)[..., np.newaxis] * Y
        )
        return swung

    places = np.array([-_INERTIA_ARM * X, 0.0 * X, tip(np.array(_SWING))])
    experiment = Experiment(
        geometry=bodies.body(
            positions=places,
            masses=np.full(3, mass),
            fixed=[True, True, False],
            bars=bodies.bars(indices=[[0, 1], [1, 2]], stiffness=[2e4, 2e4],
                      rest_length=[_INERTIA_ARM, _INERTIA_ARM]),
            bends=bodies.bends(indices=[[0, 1, 2]], stiffness=[torsion]),
        ),
        duration=1.6, dt=2.5e-4 * dt, save_interval=0.02,
    )  # fmt: skip

    def exact(times: Array) -> Array:
        x = np.repeat(places[np.newaxis], len(times), axis=0)
        x[:, 2] = tip(_SWING * np.cos(omega * times))
        return x

    return Scene(experiment, exact, _INERTIA_ARM * _SWING)


__all__ = ["bend", "hinge", "longitudinal_chain", "spinning_pair"]
