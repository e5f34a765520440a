"""CONTACT_POINTS logs: what each pair of bodies exerts, step by step.

The number of contact points differs from step to step and a point has no identity, so points
cannot be nodes. What is well defined on every step is what a pair exerts in all: the sum of
the normal forces, its vector, and the number of points. One record is one contact, hence a
step without records is a step without contact, and its force is 0 by measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged, UnsafeFile
from openprc.schema import TrajectoryWriter
from openprc_pybullet.clock import step_of_stamps
from openprc_pybullet.settings import Settings
from openprc_pybullet.state_log import StateLog

#: Steps times pairs that are summed in memory: five such arrays make 4 GB.
MAX_CELLS = 100_000_000

_NORMAL = ("contactNormalOnBX", "contactNormalOnBY", "contactNormalOnBZ")


@dataclass(frozen=True, slots=True)
class PairForces:
    """Contact of P pairs of bodies over F steps.

    Parameters
    ----------
    pairs : (P, 2) int
        Unique ids, the smaller first.
    count : (F, P)
        Number of contact points.
    normal : (F, P) [N]
        Sum of the normal forces.
    vector : (F, P, 3) [N]
        Sum of the normal force vectors on the second body of each pair.
    """

    pairs: NDArray[np.int64]
    count: NDArray[np.float64]
    normal: NDArray[np.float64]
    vector: NDArray[np.float64]


def sum_over_pairs(log: StateLog) -> PairForces:
    """Add up the records of each pair and step, from step 0 to the last one logged.

    ``contactNormalOnB`` points from B to A, so B feels ``-normalForce * normal``; Bullet may
    name a pair either way round.
    """
    records = log.records
    a = records["bodyUniqueIdA"].astype(np.int64)
    b = records["bodyUniqueIdB"].astype(np.int64)
    both = np.stack([np.minimum(a, b), np.maximum(a, b)], axis=1)
    pairs, column = np.unique(both, axis=0, return_inverse=True)
    step = records["stepCount"].astype(np.int64)
    at = (step, column.reshape(-1))
    shape = (int(step[-1]) + 1, len(pairs))
    force = records["normalForce"].astype(np.float64)
    normals = np.stack([records[name] for name in _NORMAL], axis=1).astype(np.float64)
    on_second = np.where(b >= a, -force, force)[:, None] * normals
    count, normal, vector = np.zeros(shape), np.zeros(shape), np.zeros((*shape, 3))
    np.add.at(count, at, 1.0)
    np.add.at(normal, at, force)
    np.add.at(vector, at, on_second)
    return PairForces(pairs, count, normal, vector)


def _refuse_bombs(log: StateLog, path: Path) -> None:
    """Refuse a damaged counter before it asks for memory: it sets the number of frames."""
    steps = int(log.records["stepCount"][-1]) + 1
    pairs = np.unique(log.records[["bodyUniqueIdA", "bodyUniqueIdB"]]).size
    if steps * pairs > MAX_CELLS:
        raise UnsafeFile(
            f"the last record is of step {steps - 1:,} and there are {pairs} pairs of bodies: "
            f"{steps * pairs:,} values a quantity",
            expected=f"at most {MAX_CELLS:,}",
            fix="log fewer pairs (bodyUniqueIdA, bodyUniqueIdB) or fewer steps a file; a small "
            "file with such a counter is damaged",
            file=path,
            key="stepCount",
        )


def import_contact_log(
    log: StateLog, writer: TrajectoryWriter, *, path: Path, settings: Settings
) -> None:
    """Write a contact log as channels, one column a pair of bodies; there are no nodes.

    Raises
    ------
    OpenPRCError
        See `step_of_stamps`; `Diverged` when a force is not a finite number, `UnsafeFile`
        when the frames would not fit in memory.
    """
    records = log.records
    bad = np.flatnonzero(~np.isfinite(records["normalForce"]))
    if bad.size:
        raise Diverged(
            f"normalForce is {records['normalForce'][bad[0]]} in record {bad[0]}",
            expected="finite forces: the simulation blew up",
            fix="record again with a smaller time step",
            file=path,
            key="normalForce",
        )
    dt = step_of_stamps(
        records["stepCount"].astype(np.int64),
        records["timeStamp"],
        given=settings.dt,
        file=str(path),
    )
    _refuse_bombs(log, path)
    forces = sum_over_pairs(log)
    names = [f"{a}-{b}" for a, b in forces.pairs]
    two = forces.pairs[:, 0] != forces.pairs[:, 1]
    writer.declare_channel("contact_count", names, unit="1", quantity="number of contact points")
    writer.declare_channel("contact_normal_force", names, unit="N", quantity="sum of normal forces")
    channels = {"contact_count": forces.count, "contact_normal_force": forces.normal}
    if two.any():
        axes = [
            f"{name}.{axis}"
            for name, keep in zip(names, two, strict=True)
            if keep
            for axis in "xyz"
        ]
        writer.declare_channel(
            "contact_force", axes, unit="N", quantity="normal force on the second body"
        )
        channels["contact_force"] = forces.vector[:, two].reshape(len(forces.vector), -1)
    writer.note(
        "contact points come and go, so they are no nodes: the channels hold sums over each "
        "pair of bodies, friction not included; the frames end with the last logged contact"
    )
    if log.cut_bytes:
        writer.note(
            f"the last record is cut off after {log.cut_bytes} bytes and was left out: contacts "
            "of the last step may be missing"
        )
    time = settings.t0 + (np.arange(len(forces.count)) + 1) * dt
    writer.append(time, channels=channels)
