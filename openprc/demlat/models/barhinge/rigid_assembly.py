"""From rigid elements of an experiment to the tables of compiled code."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.models.barhinge.tables import ledger_size
from openprc.demlat.signal_table import columns_of, sample_signal

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.constraint_table import ConstraintSystem
    from openprc.demlat.models.barhinge.rigid_elements import RigidElements
    from openprc.demlat.scaling import SimulationScaler
    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Geometry

    Reals = NDArray[np.float64]


def knows_constraints(experiment: Experiment) -> bool:
    """Say whether the experiment's integrator keeps rigid elements."""
    scheme = INTEGRATORS.get(experiment.integrator)
    return scheme is not None and scheme.rigid != "no"


@dataclass(frozen=True, eq=False)
class RigidScene:
    """The rigid elements of an experiment, checked, in SI units.

    Parameters
    ----------
    system : ConstraintSystem
    positions : (N, 3) [m]
        At t = 0, driven nodes where their signals say, on the constraints.
    remarks : tuple of str
        Sentences for the user.
    """

    system: ConstraintSystem
    positions: Reals
    remarks: tuple[str, ...]


@lru_cache(maxsize=1)
def rigid_scene(experiment: Experiment) -> RigidScene:
    """Return the rigid elements of an experiment, checked.

    Raises
    ------
    ConfigError
        When rigid elements contradict each other or the positions at the start.
    """
    # Compiled code is loaded when something runs.
    from openprc.demlat.models.barhinge.constraint_calls import (  # noqa: PLC0415
        prepare,
        project_velocities,
    )
    from openprc.demlat.models.barhinge.constraint_table import (  # noqa: PLC0415
        PIVOT_TOLERANCE,
        constraint_system,
        flat_state,
        inverse_masses,
        satisfy,
    )

    geometry, held = _at_start(experiment), experiment.held_axes
    stride = geometry.n_nodes
    system = constraint_system(geometry, held=held, stride=stride)
    inverse = inverse_masses(geometry, held=held, stride=stride)
    x = flat_state(geometry.positions, stride=stride)
    gap = satisfy(system, x=x, inverse_mass=inverse)
    remarks = list(system.remarks)
    if gap > 1e-9:
        remarks.append(
            f"rigid elements were off their rest values by up to {gap:.3g} (relative, or rad) at"
            " the start: nodes were moved to close the gaps"
        )
    if system.redundant:
        remarks.append("forces of rigid elements that are left out are not determined: NaN")
    if system.n_rows:
        v = flat_state(geometry.velocities, stride=stride)
        before = v.copy()
        tail = system.table, system.work, system.factor
        prepare(x, inverse, *tail, PIVOT_TOLERANCE)
        project_velocities(v, *tail, 1e-13, 3)
        change = float(np.abs(v - before).max())
        if change > 1e-6 * float(np.abs(before).max()):
            remarks.append(
                f"initial velocities would break rigid elements: they were changed by up to"
                f" {change:.3g} m/s, to the nearest ones in kinetic energy that do not"
            )
    positions = x.reshape(3, stride)[:, : geometry.n_nodes].T.copy()
    return RigidScene(system, positions, tuple(remarks))


def _at_start(experiment: Experiment) -> Geometry:
    """Return the geometry with driven nodes where their signals say at t = 0."""
    geometry = experiment.geometry
    positions, velocities = geometry.positions.copy(), geometry.velocities.copy()
    velocities[geometry.fixed] = 0.0
    for actuator in experiment.actuators:
        signal, axes = experiment.signals[actuator.signal], np.array(actuator.axes)
        if actuator.type == "force":
            continue
        values = np.broadcast_to(sample_signal(signal, np.zeros(1))[0], 3)
        if actuator.type == "velocity":
            velocities[actuator.node, axes] = values[axes]
            continue
        positions[actuator.node, axes] = values[axes]
        slopes = [column.coefficients[0, 1:2].sum() / column.dt for column in columns_of(signal)]
        velocities[actuator.node, axes] = np.broadcast_to(slopes, 3)[axes]
    return replace(geometry, positions=positions, velocities=velocities)


def rigid_elements(
    experiment: Experiment, scene: RigidScene, *, stride: int, scaler: SimulationScaler
) -> RigidElements:
    """Return the tables of a scene in scaled units, with work arrays of their own.

    `stride` is that of the flat coordinates.
    """
    from openprc.demlat.models.barhinge.rigid_elements import RigidElements  # noqa: PLC0415

    system, geometry = scene.system, experiment.geometry
    table = system.table._replace(length=system.table.length / scaler.length, stride=stride)
    bars, hinges = np.flatnonzero(geometry.bars.rigid), np.flatnonzero(geometry.hinges.rigid)
    pull = _pulls(experiment, system)
    coordinates = 3 * stride
    return RigidElements(
        table=table,
        work=_copied(system.work),
        factor=_copied(system.factor),
        tolerance=experiment.constraint_tolerance
        or Settings._field_defaults["constraint_tolerance"],
        bar=bars,
        hinge=hinges,
        bar_node=geometry.bars.indices[bars].ravel().astype(np.uint32),
        hinge_node=geometry.hinges.indices[hinges].ravel().astype(np.uint32),
        stop=np.flatnonzero(stops(geometry)),
        row_element=np.concatenate([system.bars, system.hinges]).astype(np.int64),
        pull_row=pull[0],
        pull_block=pull[1],
        pull_axis=pull[2],
        force=np.zeros(coordinates),
        acceleration=np.zeros(coordinates),
        rates=np.zeros(ledger_size(with_bends=len(geometry.bends) > 0)),
        status=np.array([-1.0, 0.0, 0.0]),
    )


def mark_undetermined(scratch: tuple[Reals, ...], geometry: Geometry, scene: RigidScene) -> None:
    """Set forces and moments of rigid elements that are no rows to NaN, once and for all.

    `scratch` is that of `openprc.demlat.models.barhinge.tables.Body`.
    """
    bars, hinges = geometry.bars.rigid.copy(), geometry.hinges.rigid.copy()
    bars[scene.system.bars] = False
    hinges[scene.system.hinges] = False
    scratch[1][bars] = np.nan
    scratch[3][hinges] = np.nan


def stops(geometry: Geometry) -> NDArray[np.bool_]:
    """Return which hinges have hard stops: (K,) bool."""
    hinges = geometry.hinges
    return hinges.limited & ~hinges.rigid & (hinges.law == "linear")


def _copied(arrays: Any) -> Any:
    return type(arrays)(*(array.copy() for array in arrays))


def _pulls(experiment: Experiment, system: ConstraintSystem) -> tuple[NDArray[np.int64], ...]:
    """Return row, block and axis of where rows act on driven coordinates."""
    driven = experiment.driven_axes("position") | experiment.driven_axes("velocity")
    n_bars, n_hinges = len(system.bars), len(system.hinges)
    row = np.concatenate(
        [np.repeat(np.arange(n_bars), 2), n_bars + np.repeat(np.arange(n_hinges), 4)]
    )
    block, axis = np.nonzero(driven[system.table.node.astype(np.int64)])
    return row[block].astype(np.int64), block.astype(np.int64), axis.astype(np.int64)
