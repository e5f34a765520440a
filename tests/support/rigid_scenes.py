"""Experiments with rigid elements."""

import numpy as np

from openprc.demlat import observables
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

G = 9.81


def scene(
    positions,
    *,
    bars=(),
    hinges=(),
    masses=None,
    fixed=(),
    velocities=None,
    rigid_bars=True,
    rigid_hinges=True,
    stiffness=1.0,
    damping=0.0,
    hinge_stiffness=0.0,
    hinge_damping=0.0,
    rest=None,
    limits=(0.0, 2 * np.pi),
    signals=(),
    actuators=(),
    **settings,
):
    """Return an experiment whose elements rest as they are at the start, unless `rest` says."""
    positions = np.array(positions, dtype=float)
    n = len(positions)
    pairs = np.array(bars, dtype=int).reshape(-1, 2)
    folds = np.array(hinges, dtype=int).reshape(-1, 4)
    length = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    angle = np.zeros(len(folds))
    if len(folds):
        angle = observables.hinge_angles(positions[None], Hinges(indices=folds))[0]
    for (kind, element), value in (rest or {}).items():
        (length if kind == "bar" else angle)[element] = value
    geometry = Geometry(
        positions=positions,
        masses=np.ones(n) if masses is None else masses,
        fixed=np.isin(np.arange(n), fixed),
        velocities=velocities,
        bars=Bars(
            indices=pairs,
            stiffness=np.full(len(pairs), stiffness),
            rest_length=length,
            damping=np.full(len(pairs), damping),
            rigid=np.broadcast_to(rigid_bars, len(pairs)),
        ),
        hinges=Hinges(
            indices=folds,
            stiffness=np.full(len(folds), hinge_stiffness),
            rest_angle=angle,
            damping=np.full(len(folds), hinge_damping),
            rigid=np.broadcast_to(rigid_hinges, len(folds)),
            limit_low=np.full(len(folds), limits[0]),
            limit_high=np.full(len(folds), limits[1]),
        ),
    )
    return Experiment(
        geometry=geometry,
        signals={signal.name: signal for signal in signals},
        actuators=tuple(actuators),
        **{"duration": 1.0, "dt": 1e-2, "save_interval": 0.1, "integrator": "rattle"} | settings,
    )


def pendulum(angle, *, length=0.7, **settings):
    """Return a pendulum that is let go at `angle` [rad] from hanging straight down."""
    bob = [length * np.sin(angle), 0.0, -length * np.cos(angle)]
    return scene(
        [[0, 0, 0], bob],
        bars=[(0, 1)],
        masses=[1.0, 0.3],
        fixed=[0],
        gravity=(0, 0, -G),
        **settings,
    )


def links(n=3, *, length=0.1, **settings):
    """Return a chain that starts horizontal, held at one end."""
    positions = np.zeros((n + 1, 3))
    positions[:, 0] = length * np.arange(n + 1)
    settings = {"gravity": (0, 0, -G), "fixed": [0]} | settings
    bars = [(i, i + 1) for i in range(n)]
    return scene(positions, bars=bars, masses=np.full(n + 1, 0.01), **settings)


#: Two triangles with a crease along x.
TRIANGLES = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]


def panels(angle, **settings):
    """Return a plate of two triangles, folded by `angle` (pi is flat) about the x axis."""
    positions = [
        [0, 0, 0],
        [1, 0, 0],
        [0.3, 0.8, 0],
        [0.6, 0.7 * np.cos(angle), 0.7 * np.sin(angle)],
    ]
    return scene(positions, bars=TRIANGLES, hinges=[(0, 1, 2, 3)], **settings)


def sheet(*, driven, **settings):
    """Return a Miura sheet of 1 x 2 cells, bars rigid and folds soft, shaken at its base.

    `driven` is (signals, actuators) as a function of the base's nodes and positions.
    """
    edge, tilt, sector = 0.1, 0.6, np.pi / 3
    reach = np.hypot(1.0, np.cos(tilt) * np.tan(sector))
    r, c = np.divmod(np.arange(15), 5)
    positions = np.stack(
        [
            c * edge * np.cos(tilt) * np.tan(sector) / reach,
            r * edge * np.sqrt(1 - (np.sin(tilt) * np.sin(sector)) ** 2) + (c % 2) * edge / reach,
            (r % 2) * edge * np.sin(tilt) * np.sin(sector),
        ],
        axis=1,
    )
    node = np.arange(15).reshape(3, 5)
    bars = [
        *zip(node[:, :-1].flat, node[:, 1:].flat, strict=True),
        *zip(node[:-1].flat, node[1:].flat, strict=True),
        *zip(node[:-1, :-1].flat, node[1:, 1:].flat, strict=True),
    ]
    creases = [
        *zip(
            node[:-1, 1:-1].flat,
            node[1:, 1:-1].flat,
            node[:-1, :-2].flat,
            node[1:, 2:].flat,
            strict=True,
        ),
        *zip(
            node[1:-1, :-1].flat,
            node[1:-1, 1:].flat,
            node[2:, 1:].flat,
            node[:-2, :-1].flat,
            strict=True,
        ),
    ]
    signals, actuators = driven(node[:, 0], positions)
    return scene(
        positions,
        bars=bars,
        hinges=creases,
        masses=np.full(15, 0.01),
        rigid_hinges=False,
        hinge_stiffness=0.05,
        hinge_damping=1e-4,
        signals=signals,
        actuators=actuators,
        **settings,
    )
