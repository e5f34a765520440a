"""From actuators and signals to the table of driven coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.models.barhinge.tables import Drives
from openprc.demlat.signal_table import Column, columns_of, signal_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.compiled.scene_packing import Packing
    from openprc.demlat.scaling import SimulationScaler
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]


def drive_table(
    experiments: Sequence[Experiment],
    packing: Packing,
    scale: SimulationScaler,
    *,
    nodal: tuple[Reals, Reals, Reals],
    origin: Reals,
    optional: bool,
) -> Drives | None:
    """Return what drives which coordinate.

    Parameters
    ----------
    experiments : sequence of S Experiment
    packing : Packing
    scale : SimulationScaler
    nodal : masses (S, N), drags (S, N), weights (S, N, 3)
        Scaled.
    origin : (S, N, 3) [m]
        What positions are counted from.
    optional : bool
        Return None when there is nothing to drive.
    """
    columns: list[Column] = []
    masses, drag, weight = nodal
    known: dict[tuple[int, str, str], int] = {}
    motion: list[tuple[Any, ...]] = []
    force: list[tuple[Any, ...]] = []
    for scene, experiment in enumerate(experiments):
        for actuator in experiment.actuators:
            signal = experiment.signals[actuator.signal]
            key = (scene, actuator.signal, actuator.type)
            unit = scale.force if actuator.type == "force" else scale.length
            if key not in known:
                known[key] = len(columns)
                for column in columns_of(signal, integrated=actuator.type == "velocity"):
                    columns.append(
                        column._replace(
                            dt=column.dt / scale.time,
                            coefficients=column.coefficients / unit,
                        )
                    )
            for axis in np.flatnonzero(actuator.axes):
                if axis >= packing.dims:
                    continue  # a planar scene: the signal is 0 along z
                at = packing.at(actuator.node, axis, scene)
                index = known[key] + (axis if signal.values.shape[1] == 3 else 0)
                if actuator.type == "force":
                    force.append((at, index, scene))
                    continue
                start = -origin[scene, actuator.node, axis]
                if actuator.type == "velocity":
                    start += experiment.geometry.positions[actuator.node, axis]
                node = scene, actuator.node
                motion.append(
                    (
                        at,
                        index,
                        start / scale.length,
                        masses[node],
                        drag[node],
                        weight[(*node, axis)],
                        scene,
                    )
                )
    if optional and not columns:
        return None
    m = list(zip(*motion, strict=True)) or [()] * 7
    f = list(zip(*force, strict=True)) or [()] * 3
    integers = (0, 1, 6)
    return Drives(
        signal_table(columns),
        *(np.array(c, dtype="i8" if n in integers else "f8") for n, c in enumerate(m)),
        *(np.array(c, dtype="i8") for c in f),
    )
