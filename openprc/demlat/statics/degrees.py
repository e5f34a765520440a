"""Where the coordinates of elements stand among those of all nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]


def element_dofs(nodes: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return degrees of freedom, ``3 * node + axis``, of elements (E, k): (E, 3 * k)."""
    dofs = 3 * nodes.astype(np.int64)[:, :, None] + np.arange(3)
    return dofs.reshape(len(nodes), 3 * nodes.shape[1])


def scatter(total: Reals, nodes: NDArray[np.int32], values: Reals) -> None:
    """Add `values` (E, k, 3) of elements (E, k) to `total` (N, 3)."""
    flat = np.bincount(element_dofs(nodes).ravel(), weights=values.ravel(), minlength=total.size)
    total += flat.reshape(total.shape)
