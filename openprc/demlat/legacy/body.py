"""A scene in the units and with the roundings of openprc up to 0.1.1.

That program divided everything by scales that it took from single-precision data, and stored
data are compared to more digits than single precision has. So the types of the operands below
are part of the scheme: an operation on single precision rounds to single precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment, Signal

Reals = NDArray[np.float64]
Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class LegacyScales:
    """Units of the older program; a float32 or float64 scalar each.

    Attributes
    ----------
    mass : [kg]
        Mean of the positive masses.
    length : [m]
        Twice the mean distance of the nodes from their centre.
    stiffness : [N/m]
        Mean of all positive stiffnesses, those of hinges [N*m/rad] included. In float64 where
        there are no hinges: the array that stood for them was empty and float64.
    """

    mass: Any
    length: Any
    stiffness: Any

    @classmethod
    def for_experiment(cls, experiment: Experiment) -> LegacyScales:
        """Return the scales of a scene."""
        geometry = experiment.geometry
        masses = geometry.masses[geometry.masses > 0].astype("f4")
        positions = geometry.positions.astype("f4")
        distances = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
        length = distances.mean() * 2.0
        stiffness = geometry.bars.stiffness.astype("f4")
        hinges = geometry.hinges.stiffness.astype("f4" if len(geometry.hinges) else "f8")
        stiffness = np.concatenate([stiffness, hinges])
        stiffness = stiffness[stiffness > 0]
        return cls(
            mass=masses.mean() if len(masses) else 1.0,
            length=length if length >= 1e-6 else 1.0,
            stiffness=stiffness.mean() if len(stiffness) else 1000.0,
        )

    @property
    def time(self) -> Any:
        """Unit of time [s]."""
        return np.sqrt(self.mass / self.stiffness)

    @property
    def velocity(self) -> Any:
        """Unit of velocity [m/s]."""
        return self.length / self.time

    @property
    def force(self) -> Any:
        """Unit of force [N]."""
        return self.stiffness * self.length

    @property
    def moment(self) -> Any:
        """Unit of rotational stiffness and of energy [N*m]."""
        return self.force * self.length

    @property
    def acceleration(self) -> Any:
        """Unit of acceleration [m/s2]."""
        return self.length / self.time**2

    @property
    def damping(self) -> Any:
        """Unit of axial damping, by which the drag is divided as well [kg/s]."""
        return self.mass / self.time


class LegacyBody(NamedTuple):
    """A scene in scaled units, as compiled code takes it.

    Attributes
    ----------
    mass : (N,)
    free : (N,) bool
        Neither fixed nor driven.
    drag : float
        Deceleration divided by velocity.
    gravity : float
        Along z.
    ends : (M, 2) i4
    stiffness, relaxed, damping : (M,)
    folds : (K, 4) i4
        Nodes j, k, i, l.
    fold_stiffness, rest_angle : (K,)
    moved, moved_by : (P,) i4
        Nodes whose position is driven, and columns of the table of samples in force.
    pushed, pushed_by : (Q,) i4
        Nodes to which a force is added, and columns likewise.
    samples : (R, 3)
        Samples of all signals, one after the other.
    """

    mass: Reals
    free: NDArray[np.bool_]
    drag: float
    gravity: float
    ends: Numbers
    stiffness: Reals
    relaxed: Reals
    damping: Reals
    folds: Numbers
    fold_stiffness: Reals
    rest_angle: Reals
    moved: Numbers
    moved_by: Numbers
    pushed: Numbers
    pushed_by: Numbers
    samples: Reals


class LegacyState(NamedTuple):
    """What is advanced, and room to work in; (N, 3) each but for the ledger.

    Attributes
    ----------
    x, v : scaled units
    ledger : (5,)
        Rows as in `openprc.demlat.models.barhinge.tables.LEDGER`, by the rectangle rule.
    jump : displacement of driven nodes at the beginning of the step
    force, x_stage, v_stage, total : work arrays
    """

    x: Reals
    v: Reals
    ledger: Reals
    jump: Reals
    force: Reals
    x_stage: Reals
    v_stage: Reals
    total: Reals


class Sampling(NamedTuple):
    """Which samples are in force: those of signal c begin at row ``first[c]``.

    Attributes
    ----------
    first, length : (C,) i8
    dt : (C,) [s]
    """

    first: NDArray[np.int64]
    length: NDArray[np.int64]
    dt: Reals

    def rows(self, times: Reals) -> NDArray[np.int64]:
        """Return the nearest samples: (S, C) rows at the times (S,) [s].

        Halfway between two samples the even one is nearest.
        """
        nearest = np.rint(times[:, np.newaxis] / self.dt).astype("i8")
        rows: NDArray[np.int64] = self.first + np.clip(nearest, 0, self.length - 1)
        return rows


def legacy_body(experiment: Experiment, scales: LegacyScales) -> tuple[LegacyBody, Sampling]:
    """Return the scene in scaled units, and the sampling of its signals."""
    geometry = experiment.geometry
    bars, hinges = geometry.bars, geometry.hinges
    used: dict[tuple[str, str], int] = {}
    drives: dict[str, list[tuple[int, int]]] = {"position": [], "force": []}
    for actuator in experiment.actuators:
        column = used.setdefault((actuator.signal, actuator.type), len(used))
        drives[actuator.type].append((actuator.node, column))
    units = {"position": scales.length, "force": scales.force}
    signals = [experiment.signals[name] for name, _ in used]
    tables = [_scaled(signal, units[kind]) for signal, (_, kind) in zip(signals, used, strict=True)]
    lengths = np.array([len(table) for table in tables], dtype="i8")
    moved, pushed = (np.array(drives[kind], dtype="i4").reshape(-1, 2) for kind in drives)
    free = ~geometry.fixed
    free[moved[:, 0]] = False
    body = LegacyBody(
        mass=_single(geometry.masses, scales.mass),
        free=free,
        drag=float(experiment.damping / scales.damping),
        gravity=float(experiment.gravity[2] / scales.acceleration),
        ends=np.ascontiguousarray(bars.indices, dtype="i4"),
        stiffness=_single(bars.stiffness, scales.stiffness),
        relaxed=_single(bars.rest_length, scales.length) * (1.0 + _single(bars.prestress)),
        damping=_single(bars.damping, scales.damping),
        folds=np.ascontiguousarray(hinges.indices, dtype="i4"),
        fold_stiffness=_single(hinges.stiffness, scales.moment),
        rest_angle=_single(hinges.rest_angle),
        moved=np.ascontiguousarray(moved[:, 0]),
        moved_by=np.ascontiguousarray(moved[:, 1]),
        pushed=np.ascontiguousarray(pushed[:, 0]),
        pushed_by=np.ascontiguousarray(pushed[:, 1]),
        samples=np.concatenate([np.zeros((0, 3)), *tables]),
    )
    first = np.concatenate([np.zeros(1, "i8"), np.cumsum(lengths)])[:-1]
    return body, Sampling(first, lengths, np.array([signal.dt for signal in signals]))


def legacy_state(experiment: Experiment, scales: LegacyScales) -> LegacyState:
    """Return the state at the start, before driven nodes are moved to their signals."""
    geometry = experiment.geometry
    x = _single(geometry.positions, scales.length)
    v = _single(geometry.velocities, scales.velocity)
    return LegacyState(x, v, np.zeros(5), *(np.zeros_like(x) for _ in range(5)))


def _single(values: Reals, unit: Any = 1.0) -> Reals:
    """Divide values that were stored in single precision by a unit."""
    return np.ascontiguousarray(values.astype("f4") / unit, dtype="f8")


def _scaled(signal: Signal, unit: Any) -> Reals:
    # Signals kept the precision in which they were made, which the values tell.
    values = signal.values
    single = values.astype("f4")
    values = single if np.array_equal(single, values) else values
    return np.broadcast_to(values / unit, (len(values), 3)).astype("f8")
