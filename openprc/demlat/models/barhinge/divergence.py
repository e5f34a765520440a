"""What to say about a run that blew up."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.planning.stability import StepLimit
    from openprc.schema.experiment import Experiment


def strained_most(experiment: Experiment, positions: NDArray[np.float64], node: int) -> str:
    """Name the bar at a node that is strained most, or a hinge or bend there; empty if it has none.

    Parameters
    ----------
    experiment : Experiment
    positions : (N, dims) [m]
        When the run was stopped; NaN and infinity count as most strained.
    node : int
    """
    bars, hinges = experiment.geometry.bars, experiment.geometry.hinges
    at_node = np.flatnonzero((bars.indices == node).any(axis=1))
    if len(at_node):
        ends = bars.indices[at_node]
        with np.errstate(all="ignore"):
            lengths = np.linalg.norm(positions[ends[:, 1]] - positions[ends[:, 0]], axis=1)
            strains = lengths / bars.relaxed_length[at_node] - 1.0
        strains = np.where(np.isfinite(strains), np.abs(strains), np.inf)
        worst = int(np.argmax(strains))
        i, j = ends[worst]
        return (
            f"; of the bars there, bar {at_node[worst]} between nodes {i} and {j} is strained"
            f" most, by {strains[worst]:.3g}"
        )
    bends = experiment.geometry.bends.indices
    folds = np.flatnonzero((hinges.indices == node).any(axis=1))
    if len(folds):
        return f"; it belongs to hinge {folds[0]} {hinges.indices[folds[0]].tolist()}, not to a bar"
    turning = np.flatnonzero((bends == node).any(axis=1))
    if len(turning):
        return f"; it belongs to bend {turning[0]} {bends[turning[0]].tolist()}, not to a bar"
    return ""


def way_out(limit: StepLimit, dt: float) -> str:
    """Say what to change, given the stability limit at the start and the step that was used."""
    if math.isinf(limit.limit):
        return (
            "look for a force without bound: no step is too large for the body as it lies at the"
            " start"
        )
    known = f"the stability limit at the start is {limit.limit:.3g} s, set by {limit.setter}"
    if dt > limit.limit:
        return f"use a smaller dt than {dt:g} s: {known}"
    return (
        f"use a smaller dt than {dt:g} s, or an integrator that chooses its step: {known}, and"
        " the body stiffened as it deformed"
    )
