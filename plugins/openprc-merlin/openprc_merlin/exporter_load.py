"""What drove a run, as MERLIN's load factor, reference load and supports."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from openprc_merlin.exporter_mesh import Mesh

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: "5 z" in quasi-static runs, after the label of the node; "node 4 xz" in simulated ones.
_IMPOSED = re.compile(r"(.+) ([xyz])\Z")
_EXPERIMENT = re.compile(r"node (\d+) ([xyz]+)\Z")


@dataclass(frozen=True)
class Drive:
    """The load of a run.

    Attributes
    ----------
    mode : "force", "displacement", or "" where it is not told
    history : (T, C), frame 0 included, or None
        Force: the load factor. Displacement: minus the applied forces.
    reference : (N, 3)
        Force: the force for a factor of 1. Displacement: the largest imposed displacement.
    held : (N, 3) bool, supported degrees of freedom
    notes : what a reader should know
    """

    mode: Literal["force", "displacement", ""]
    history: Floats | None
    reference: Floats
    held: NDArray[np.bool_]
    notes: tuple[str, ...]


def collect(trajectory: Trajectory, mesh: Mesh, displacements: Floats) -> Drive:
    """Find the load history of a trajectory and what it acts on.

    Parameters
    ----------
    trajectory : Trajectory
    mesh : Mesh
    displacements : (T, N, 3) from the rest shape, frame 0 first
    """
    held = _held(trajectory, len(mesh.rest))
    names = trajectory.inputs
    reference = np.zeros((len(mesh.rest), 3))
    if "load" in names and trajectory.has("/extensions/openprc-merlin/reference_load"):
        reference = np.asarray(
            trajectory.extension("openprc-merlin", "reference_load"), dtype=np.float64
        )
        return Drive("force", trajectory.input("load").value, reference, held, ())
    columns = _imposed(trajectory)
    if columns is not None:
        history = trajectory.channel("reaction") if "reaction" in trajectory.channels else None
        reference = _largest(displacements, columns)
        return Drive("displacement", history, reference, held, ())
    if "load" in names:
        return Drive("", trajectory.input("load").value, reference, held, ())
    return _of_experiment(trajectory, displacements, held)


def _held(trajectory: Trajectory, n_nodes: int) -> NDArray[np.bool_]:
    if trajectory.has("/extensions/openprc-merlin/held"):
        return np.asarray(trajectory.extension("openprc-merlin", "held"), dtype=bool)
    held = np.zeros((n_nodes, 3), dtype=bool)
    if trajectory.has("/topology/nodes/fixed"):
        held[np.asarray(trajectory.node("fixed"), dtype=bool)] = True
    if trajectory.dims == 2:
        held[:, 2] = True
    return held


def _imposed(trajectory: Trajectory) -> Ints | None:
    """Return the imposed degrees of freedom of a quasi-static run, from the names of columns."""
    # Nodes are named by their labels, which count from 1 in imported runs; else by their index.
    labelled = trajectory.has("/topology/nodes/label")
    labels = trajectory.node("label").tolist() if labelled else range(trajectory.n_nodes)
    index = {str(label): node for node, label in enumerate(labels)}
    for names in (
        trajectory.input("displacement").columns if "displacement" in trajectory.inputs else (),
        trajectory.channel_columns("reaction") if "reaction" in trajectory.channels else (),
    ):
        found = [_IMPOSED.match(name) for name in names]
        if found and all(m and m[1] in index for m in found):
            dofs = [3 * index[m[1]] + "xyz".index(m[2]) for m in found if m]
            return np.array(dofs, dtype=np.int64)
    return None


def _largest(displacements: Floats, dofs: Ints) -> Floats:
    """Return a load table whose entries mark the imposed degrees of freedom."""
    table = np.zeros(displacements.shape[1:])
    for dof in dofs.tolist():
        path = displacements[:, dof // 3, dof % 3]
        peak = float(path[np.argmax(np.abs(path))])
        # MERLIN finds the imposed degrees of freedom by their entry, so it may not be 0.
        table[dof // 3, dof % 3] = peak or 1.0
    return table


def _of_experiment(trajectory: Trajectory, displacements: Floats, held: NDArray[np.bool_]) -> Drive:
    """Translate actuators of a simulated experiment, as far as MERLIN has a place for them."""
    reference = np.zeros(displacements.shape[1:])
    signals = [trajectory.input(name) for name in trajectory.inputs]
    if not signals:
        return Drive("", None, reference, held, ("nothing is said to have driven the run",))
    nodes = {}
    for signal in signals:
        found = [_EXPERIMENT.match(target) for target in signal.targets]
        nodes[signal.name] = [
            3 * int(m[1]) + "xyz".index(axis) for m in found if m for axis in m[2]
        ]
        if not found or not all(found) or max(nodes[signal.name]) >= displacements[0].size:
            return Drive("", None, reference, held, (f"input {signal.name} is left out",))
    if all(signal.quantity == "position" for signal in signals):
        dofs = np.array(sorted({dof for row in nodes.values() for dof in row}), dtype=np.int64)
        return Drive("displacement", None, _largest(displacements, dofs), held, ())
    if len(signals) == 1 and signals[0].quantity == "force" and signals[0].value.shape[1] == 1:
        reference.reshape(-1)[nodes[signals[0].name]] = 1.0
        return Drive("force", signals[0].value, reference, held, ())
    names = ", ".join(signal.name for signal in signals)
    return Drive(
        "", None, reference, held, (f"left out: {names}; MERLIN has one load factor for all",)
    )
