"""Elements between fixed nodes: they never change, so nobody has to step them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.tables import Reals
    from openprc.demlat.scaling import SimulationScaler
    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Geometry


class IdleElements(NamedTuple):
    """Which bars, hinges and bends are idle: (M,), (K,) and (E,) bool."""

    bars: NDArray[np.bool_]
    hinges: NDArray[np.bool_]
    bends: NDArray[np.bool_]


def idle_elements(experiments: Sequence[Experiment], *, wanted: bool) -> IdleElements:
    """Return the soft elements whose nodes are fixed in every scene; none unless `wanted`."""
    geometry = experiments[0].geometry
    fixed = np.logical_and.reduce([e.geometry.fixed for e in experiments]) & wanted
    return IdleElements(
        ~geometry.bars.rigid & fixed[geometry.bars.indices].all(axis=1),
        ~geometry.hinges.rigid & fixed[geometry.hinges.indices].all(axis=1),
        fixed[geometry.bends.indices].all(axis=1),
    )


def preset(
    scratch: tuple[Reals, ...], geometry: Geometry, idle: IdleElements, unit: SimulationScaler
) -> tuple[float, float, float]:
    """Write what idle elements show for ever to the body's scratch.

    Returns
    -------
    bars, hinges, bends : float [J]
        Their energies.
    """
    if not any(which.any() for which in idle):
        return 0.0, 0.0, 0.0
    from openprc.demlat.statics.bending import BendLaws, bend_turns  # noqa: PLC0415
    from openprc.demlat.statics.element_laws import BarLaws, HingeLaws  # noqa: PLC0415 - seldom
    from openprc.demlat.statics.element_shapes import hinge_bends  # noqa: PLC0415

    lengths, tensions, changes, moments, _, turns, torques = scratch
    ends = geometry.positions[geometry.bars.indices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    bar_laws, hinge_laws = BarLaws(geometry.bars), HingeLaws(geometry.hinges)
    b, h, e = idle
    lengths[b] = length[b] / unit.length
    tensions[b] = bar_laws.force(length)[b] / unit.force
    energies = [float(bar_laws.energy(length)[b].sum()), 0.0, 0.0]
    if h.any():
        bends = hinge_bends(geometry.positions, geometry.hinges.indices)
        changes[h] = hinge_laws.difference(bends)[h]
        moments[h] = hinge_laws.force(bends)[h] / unit.moment
        energies[1] = float(hinge_laws.energy(bends)[h].sum())
    if e.any():
        bend_laws = BendLaws(geometry.bends)
        turn = bend_turns(geometry.positions, geometry.bends.indices)
        turns[e] = turn[e]
        torques[e] = -bend_laws.force(turn)[e] / unit.moment
        energies[2] = float(bend_laws.energy(turn)[e].sum())
    return energies[0], energies[1], energies[2]
