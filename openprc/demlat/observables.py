"""Quantities of elements, from saved positions and velocities.

Every function takes a block of B frames: positions ``x`` (B, N, 3) [m] and velocities ``v``
(B, N, 3) [m/s].
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.schema.dihedral import dihedral_angles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.geometry import Bars, Hinges

    Reals = NDArray[np.float64]


def bar_lengths(x: Reals, bars: Bars) -> Reals:
    """Return lengths: (B, M) [m]."""
    along = x[:, bars.indices[:, 1]] - x[:, bars.indices[:, 0]]
    length: Reals = np.sqrt(np.einsum("bea,bea->be", along, along))
    return length


def bar_strains(lengths: Reals, bars: Bars) -> Reals:
    """Return ``(l - l_rest) / l_rest``: (B, M) [1]; the unstressed length, without prestress."""
    strains: Reals = (lengths - bars.rest_length) / bars.rest_length
    return strains


def bar_forces(x: Reals, v: Reals, lengths: Reals, bars: Bars) -> Reals:
    """Return tensions, spring and dashpot together: (B, M) [N], positive when pulling."""
    along = x[:, bars.indices[:, 1]] - x[:, bars.indices[:, 0]]
    relative = v[:, bars.indices[:, 1]] - v[:, bars.indices[:, 0]]
    rate = np.einsum("bea,bea->be", along, relative)
    rate = np.divide(rate, lengths, out=np.zeros_like(rate), where=lengths > 0)
    forces: Reals = bars.stiffness * (lengths - bars.relaxed_length) + bars.damping * rate
    return forces


def hinge_angles(x: Reals, hinges: Hinges) -> Reals:
    """Return dihedral angles in [0, 2 pi): (B, K) [rad]; pi is flat.

    The angle is measured on one side throughout, so it is continuous through flat and jumps
    only where a hinge folds shut.
    """
    return dihedral_angles(x, hinges.indices)


def hinge_gradients(x: Reals, indices: NDArray[np.int32]) -> Reals:
    """Return d(angle)/dx at the nodes j, k, i, l: (B, K, 4, 3) [rad/m].

    Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, after Blondel & Karplus 1996. Nothing is
    divided by the sine of the angle: it is regular when flat and when folded shut.
    """
    j, k, i, l = (x[:, indices[:, c]] for c in range(4))  # noqa: E741
    a, b, c = i - j, k - j, k - l
    m, n = np.cross(a, b), np.cross(b, c)
    bb = np.sum(b * b, axis=2, keepdims=True)
    gi = np.sqrt(bb) / np.sum(m * m, axis=2, keepdims=True) * m
    gl = -np.sqrt(bb) / np.sum(n * n, axis=2, keepdims=True) * n
    p = np.sum(a * b, axis=2, keepdims=True) / bb
    q = np.sum(c * b, axis=2, keepdims=True) / bb
    return np.stack([(p - 1) * gi - q * gl, (q - 1) * gl - p * gi, gi, gl], axis=2)


def hinge_rates(x: Reals, v: Reals, hinges: Hinges) -> Reals:
    """Return d(angle)/dt: (B, K) [rad/s]."""
    gradients = hinge_gradients(x, hinges.indices)
    rates: Reals = np.einsum("bkna,bkna->bk", gradients, v[:, hinges.indices])
    return rates


def hinge_torques(angles: Reals, rates: Reals, hinges: Hinges) -> Reals:
    """Return moments that resist the fold, spring and damper together: (B, K) [N*m]."""
    difference = np.mod(angles - hinges.rest_angle + np.pi, 2.0 * np.pi) - np.pi
    torques: Reals = hinges.stiffness * difference + hinges.damping * rates
    return torques
