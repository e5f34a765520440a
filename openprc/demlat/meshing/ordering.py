"""The order of elements that compiled code likes best.

Elements of one direction differ by the same offset of node numbers. Sorted by that offset and
then by the first node, their ends advance by one from each element to the next wherever nodes
are numbered row by row, so that a run of elements is a run of consecutive nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def bar_order(bars: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the order of `bars` (M, 2), whose first end has the lower number: (M,)."""
    return np.lexsort((bars[:, 0], bars[:, 1] - bars[:, 0]))


def hinge_order(hinges: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the order of `hinges` (K, 4), ``[j, k, i, l]`` with ``j < k``: (K,)."""
    j, k, i, l = hinges.T  # noqa: E741
    return np.lexsort((j, l - j, i - j, k - j))


def canonical_bars(bars: Any) -> NDArray[np.int32]:
    """Return `bars` (M, 2) with the lower node first."""
    return np.sort(np.asarray(bars, dtype=np.int32).reshape(-1, 2), axis=1)


def canonical_hinges(hinges: Any) -> NDArray[np.int32]:
    """Return `hinges` (K, 4) with ``j < k``.

    Crease and wings are exchanged together, which leaves the angle as it is; exchanging one
    pair alone would turn the angle into 2 pi minus itself.
    """
    rows = np.array(hinges, dtype=np.int32).reshape(-1, 4)
    swap = rows[:, 0] > rows[:, 1]
    rows[swap] = rows[swap][:, [1, 0, 3, 2]]
    return rows


def canonical_bends(bends: Any) -> NDArray[np.int32]:
    """Return `bends` (B, 3), ``[end, vertex, end]``, with the lower end first."""
    rows = np.array(bends, dtype=np.int32).reshape(-1, 3)
    rows[:, [0, 2]] = np.sort(rows[:, [0, 2]], axis=1)
    return rows


def bend_order(bends: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the order of `bends` (B, 3), whose first end has the lower number: (B,)."""
    i, j, k = bends.T
    return np.lexsort((j, k - j, i - j))


def unit_stride_runs(elements: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the lengths of the runs in which every node number advances by one: (R,)."""
    if len(elements) == 0:
        return np.zeros(0, dtype=np.int64)
    breaks = np.flatnonzero((np.diff(elements, axis=0) != 1).any(axis=1)) + 1
    runs: NDArray[np.int64] = np.diff(np.concatenate([[0], breaks, [len(elements)]]))
    return runs
