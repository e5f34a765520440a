"""Where a lost point is looked for.

Three guesses are made, none of which needs the point to be seen: that it moves with its
neighbours from frame to frame, that it lies among them as it did in the reference frame, and
that it goes on as it did. The first needs few neighbours, but its errors add up; the second
does not add them up, but needs a surrounding that has deformed evenly; the third needs nobody,
for a while.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.local_motion import LocalMotion, local_motion, nearest
from openprc.vision.tracking.point_state import PointState


def along_with_neighbours(
    points: NDArray[np.intp],
    at: NDArray[np.float64],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    found: NDArray[np.bool_],
    neighbours: NDArray[np.intp],
) -> LocalMotion:
    """Return the motion of the surroundings of `points` (n,) between two states of all points.

    Parameters
    ----------
    points : (n,)
        Rows of the table of neighbours.
    at : (n, 2) [px]
        Where the points were in the first state.
    before, after : (N, 2) [px]
        The two states.
    found : (N,)
        Points known in both.
    neighbours : (N, k)
        Nearest points of each point.
    """
    table = neighbours[points]
    valid = found[table]
    few = valid.sum(axis=1) < 3
    survivors = np.flatnonzero(found)
    if few.any() and len(survivors):
        # What hid a point may have hidden all of its neighbours; those farther away remain.
        k = min(max(table.shape[1], 1), len(survivors))
        wider = survivors[nearest(before[survivors], at[few], k)]
        if wider.shape[1] > table.shape[1]:
            table = np.pad(table, ((0, 0), (0, wider.shape[1] - table.shape[1])))
            valid = np.pad(valid, ((0, 0), (0, wider.shape[1] - valid.shape[1])))
        table = table.copy()
        table[few, : wider.shape[1]] = wider
        valid[few] = False
        valid[few, : wider.shape[1]] = True
    return local_motion(before[table], after[table], valid, at)


def carry(
    state: PointState,
    lost: NDArray[np.intp],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    found: NDArray[np.bool_],
    neighbours: NDArray[np.intp],
) -> None:
    """Move the lost points on by one frame, with their neighbours where there are any."""
    state.coasting[lost] += state.velocity[lost]
    if not found.any():
        state.warps[lost, :2] += state.velocity[lost]
        return
    motion = along_with_neighbours(lost, before[lost], before, after, found, neighbours)
    known = np.isfinite(motion.positions).all(axis=1)
    some = lost[known]
    state.warps[some, :2] = motion.positions[known]
    deformation = state.warps[some, 2:].reshape(-1, 2, 2) + np.eye(2)
    carried = motion.gradients[known] @ deformation
    state.warps[some, 2:] = (carried - np.eye(2)).reshape(-1, 4)
    rest = lost[~known]
    state.warps[rest, :2] += state.velocity[rest]
