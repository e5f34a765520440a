"""The longest stable time step of a rod, before anything is run.

PyElastica's position Verlet step is stable up to ``2 / omega`` for the fastest linear oscillation
(e.g. Hairer, Lubich & Wanner 2003, doi:10.1017/S0962492902000144). Oscillations of the
straight rod fall into stretching ones and those of deflections with rotations of the elements, so
that two banded eigenvalue problems give omega, end conditions and uneven elements included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc_pyelastica.rod_material import RodMaterial


@dataclass(frozen=True)
class StepLimit:
    """Longest stable steps [s].

    Parameters
    ----------
    stretching, bending : float [s]
        Of stretching alone, and of deflection with shear, bending and rotation.
    """

    stretching: float
    bending: float

    @property
    def step(self) -> float:
        """The shorter one [s]."""
        return min(self.stretching, self.bending)

    @property
    def setter(self) -> str:
        """What sets it."""
        if self.stretching < self.bending:
            return "stretching waves (l/c with c = sqrt(EA/(rho A)))"
        return "shear and rotation of the elements (l/c and R/c with c = sqrt(a G/rho))"


def step_limit(
    material: RodMaterial,
    *,
    held_nodes: NDArray[np.bool_],
    held_elements: NDArray[np.bool_],
) -> StepLimit:
    """Return the longest stable step of a straight rod.

    Parameters
    ----------
    material : RodMaterial
    held_nodes : (n + 1,) bool
    held_elements : (n,) bool
        Whose directors are held.
    """
    n = len(material.rest_lengths)
    k = material.stretch / material.rest_lengths
    axial = np.zeros((2, n + 1))
    axial[0, :-1] += k
    axial[0, 1:] += k
    axial[1, :-1] = -k
    along = _fastest(axial, material.mass, held_nodes)

    # Unknowns w0, q0, w1, q1, ..., wn in this order: shear strain (w[i+1] - w[i]) / l - q[i].
    band = np.zeros((4, 2 * n + 1))
    s, length = material.shear, material.rest_lengths
    node, turn = slice(0, 2 * n, 2), slice(1, 2 * n, 2)
    band[0, node] += s / length
    band[0, 2 : 2 * n + 1 : 2] += s / length
    band[0, turn] += s * length
    band[1, node] += s  # w[i] with q[i]
    band[1, turn] -= s  # q[i] with w[i+1]
    band[2, node] -= s / length  # w[i] with w[i+1]
    b = material.bend / material.vertex_lengths
    band[0, 1 : 2 * n - 2 : 2] += b
    band[0, 3 : 2 * n : 2] += b
    band[2, 1 : 2 * n - 2 : 2] -= b  # q[i] with q[i+1]
    inertia = np.empty(2 * n + 1)
    inertia[::2], inertia[1::2] = material.mass, material.inertia
    held = np.empty(2 * n + 1, dtype=bool)
    held[::2], held[1::2] = held_nodes, held_elements
    across = _fastest(band, inertia, held)
    return StepLimit(_limit(along), _limit(across))


def _limit(omega: float) -> float:
    return 2.0 / omega if omega > 0.0 else math.inf


def _fastest(
    lower: NDArray[np.float64], inertia: NDArray[np.float64], held: NDArray[np.bool_]
) -> float:
    """Return the largest frequency [rad/s] of a banded stiffness (lower form) and a mass."""
    from scipy.linalg import eigvals_banded  # scipy is slow to load

    scale = np.where(held, 0.0, 1.0 / np.sqrt(inertia))
    scaled = lower.copy()
    size = len(inertia)
    for offset in range(len(lower)):
        count = size - offset
        scaled[offset, :count] *= scale[:count] * scale[offset:]
        scaled[offset, count:] = 0.0
    largest = eigvals_banded(scaled, lower=True, select="i", select_range=(size - 1, size - 1))
    return math.sqrt(max(0.0, float(largest[0])))
