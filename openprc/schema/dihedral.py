"""The angle between two panels that share a crease, as every file of the contract means it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def dihedral_angles(
    positions: NDArray[np.float64], indices: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return dihedral angles in [0, 2 pi): (B, K) [rad]; pi is flat.

    The angle is measured on one side throughout, so it is continuous through flat and jumps
    only where a hinge folds shut. Nothing is divided by a length or by a sine, so hinges that
    are flat or folded lose no digits (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, after
    Blondel & Karplus 1996).

    Parameters
    ----------
    positions : (B, N, 3)
        B frames.
    indices : (K, 4)
        Crease nodes j and k, then the wing nodes i and l: /topology/hinges/indices.
    """
    j, k, i, l = (positions[:, indices[:, c]] for c in range(4))  # noqa: E741
    a, b, c = i - j, k - j, k - l
    m, n = np.cross(a, b), np.cross(b, c)
    crease = np.sqrt(np.einsum("bea,bea->be", b, b))
    bend = np.arctan2(-crease * np.einsum("bea,bea->be", n, a), -np.einsum("bea,bea->be", m, n))
    angles: NDArray[np.float64] = np.mod(bend + np.pi, 2.0 * np.pi)
    return angles
