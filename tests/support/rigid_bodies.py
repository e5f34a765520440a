"""Bodies with rigid bars and hinges, and their constraints."""

from dataclasses import dataclass

import numpy as np
from from_python import Compiled

from openprc.demlat import observables
from openprc.demlat.linear import PIVOT_TOLERANCE
from openprc.demlat.models.barhinge import constraints, gauss_seidel
from openprc.demlat.models.barhinge.constraint_table import (
    ConstraintSystem,
    constraint_system,
    flat_state,
    inverse_masses,
)
from openprc.schema.geometry import Bars, Geometry, Hinges

constraints, gauss_seidel = Compiled(constraints), Compiled(gauss_seidel)
TETRAHEDRON = [(i, j) for i in range(4) for j in range(i)]


@dataclass
class Body:
    """A scene with its constraints, and the compiled functions without their long tails."""

    geometry: Geometry
    held: np.ndarray
    stride: int
    system: ConstraintSystem
    inverse_mass: np.ndarray

    @property
    def tail(self):
        return self.system.table, self.system.work

    def flat(self, columns):
        return flat_state(columns, stride=self.stride)

    def columns(self, flat):
        return flat.reshape(3, self.stride)[:, : self.geometry.n_nodes].T

    @property
    def x(self):
        return self.flat(self.geometry.positions)

    def jacobian(self, x):
        """Return G as a dense matrix (R, 3 stride), one row from each unit multiplier."""
        constraints.gradients(x, self.inverse_mass, *self.tail)
        rows = np.zeros((self.system.n_rows, 3 * self.stride))
        for row, unit in zip(rows, np.eye(self.system.n_rows), strict=True):
            constraints.add_forces(row, unit, 1.0, *self.tail)
        return rows

    def values(self, x):
        constraints.values(x, *self.tail)
        return self.system.work.value.copy()

    def prepare(self, x):
        return constraints.prepare(
            x, self.inverse_mass, *self.tail, self.system.factor, PIVOT_TOLERANCE
        )

    def project(self, x, *, reference=None, tolerance=1e-14, max_iterations=60):
        self.prepare(x if reference is None else reference)
        return constraints.project_positions(
            x, *self.tail, self.system.factor, tolerance, max_iterations
        )

    def project_velocities(self, x, v):
        self.prepare(x)
        return constraints.project_velocities(v, *self.tail, self.system.factor, 1e-15, 3)

    def accelerate(self, x, v, acceleration):
        """Return accelerations with the constraints' forces in them."""
        self.prepare(x)
        acceleration = acceleration.copy()
        constraints.multipliers(x, v, acceleration, *self.tail, self.system.factor)
        constraints.push(acceleration, self.system.work.multiplier, 1.0, *self.tail)
        return acceleration

    def sweep(self, x, *, tolerance=1e-13, max_sweeps=20_000):
        return gauss_seidel.gauss_seidel(x, self.inverse_mass, *self.tail, tolerance, max_sweeps)


def make(
    positions, *, bars=(), hinges=(), masses=None, fixed=(), held=None, rest=None, limits=None
):
    """Return a body; lengths and angles are those at the start unless `rest` says otherwise."""
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
    low, high = limits or (0.0, 2 * np.pi)
    flags = np.isin(np.arange(n), fixed)
    geometry = Geometry(
        positions=positions,
        masses=np.ones(n) if masses is None else masses,
        fixed=flags,
        bars=Bars(
            indices=pairs,
            stiffness=np.ones(len(pairs)),
            rest_length=length,
            rigid=np.ones(len(pairs), dtype=bool),
        ),
        hinges=Hinges(
            indices=folds,
            stiffness=np.ones(len(folds)),
            rest_angle=angle,
            rigid=np.full(len(folds), limits is None),
            limit_low=np.full(len(folds), low),
            limit_high=np.full(len(folds), high),
        ),
    )
    held = flags[:, np.newaxis] | (np.zeros((n, 3), dtype=bool) if held is None else held)
    stride = n + 3  # not the number of nodes, so that a mix-up of the two shows
    system = constraint_system(geometry, held=held, stride=stride)
    inverse_mass = inverse_masses(geometry, held=held, stride=stride)
    return Body(geometry, held, stride, system, inverse_mass)


def cloud(seed=0, n=9, n_bars=12, n_hinges=4):
    """A free body with bars and hinges between random nodes."""
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i in range(n) for j in range(i)]
    bars = rng.permutation(pairs)[:n_bars]
    hinges = [rng.choice(n, 4, replace=False) for _ in range(n_hinges)]
    return make(rng.normal(size=(n, 3)), bars=bars, hinges=hinges, masses=rng.uniform(0.5, 2, n))


def miura(n=3, m=4, *, tilt=0.7, sector=1.0, edge=0.05):
    """A Miura sheet of n x m panels with diagonals, one corner panel fixed."""
    height = edge * np.sin(tilt) * np.sin(sector)
    pitch = edge * np.cos(tilt) * np.tan(sector) / np.hypot(1, np.cos(tilt) * np.tan(sector))
    reach = edge * np.sqrt(1 - (np.sin(tilt) * np.sin(sector)) ** 2)
    shift = edge / np.hypot(1, np.cos(tilt) * np.tan(sector))
    rows, columns = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    positions = np.stack(
        [reach * rows + shift * (columns % 2), pitch * columns, height * (rows % 2)], axis=-1
    ).reshape(-1, 3)
    number = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    bars = [
        *zip(number[:-1].flat, number[1:].flat, strict=True),
        *zip(number[:, :-1].flat, number[:, 1:].flat, strict=True),
        *zip(number[:-1, :-1].flat, number[1:, 1:].flat, strict=True),
    ]
    corner = [number[0, 0], number[0, 1], number[1, 0], number[1, 1]]
    return make(positions, bars=bars, masses=np.full(len(positions), 0.01), fixed=corner)


def chain(n=3, *, length=0.1, fixed=(0,)):
    positions = np.zeros((n + 1, 3))
    positions[:, 0] = length * np.arange(n + 1)
    bars = [(i, i + 1) for i in range(n)]
    return make(positions, bars=bars, masses=np.full(n + 1, 0.01), fixed=fixed)


def dihedral(angle, **options):
    """Two triangles with a crease along x; wing nodes 2 and 3."""
    positions = [
        [0, 0, 0],
        [1, 0, 0],
        [0.3, 0.8, 0],
        [0.6, 0.7 * np.cos(angle), 0.7 * np.sin(angle)],
    ]
    return make(positions, **options)


def braced(n=4):
    """A flat lattice with both diagonals in every cell."""
    positions = np.zeros((n * n, 3))
    positions[:, :2] = np.indices((n, n)).reshape(2, -1).T
    number = np.arange(n * n).reshape(n, n)
    bars = [
        *zip(number[:-1].flat, number[1:].flat, strict=True),
        *zip(number[:, :-1].flat, number[:, 1:].flat, strict=True),
        *zip(number[:-1, :-1].flat, number[1:, 1:].flat, strict=True),
        *zip(number[1:, :-1].flat, number[:-1, 1:].flat, strict=True),
    ]
    return positions, bars


BODIES = {
    "pendulum": lambda: chain(1),
    "chain": lambda: chain(12),
    "tetrahedron": lambda: make(np.random.default_rng(0).normal(size=(4, 3)), bars=TETRAHEDRON),
    "bars and hinges": cloud,
    "miura": miura,
}


def moved(body, amount, seed=0):
    """Positions off the constraints by some `amount` of the body's finest length."""
    rng = np.random.default_rng(seed)
    size = amount * body.system.table.length.min()
    shift = np.where(body.held, 0.0, size * rng.uniform(-1, 1, body.geometry.positions.shape))
    return body.x + body.flat(shift)
