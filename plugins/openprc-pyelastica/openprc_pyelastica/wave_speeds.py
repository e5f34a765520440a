"""How fast waves run along a rod, and the time step that they allow.

PyElastica steps explicitly, so that no wave may pass an element in less than a step (Courant,
Friedrichs & Lewy 1928, doi:10.1007/BF01448839): ``dt < l / c`` for stretch, ``c = sqrt(E / rho)``,
and shear, ``c = sqrt(a G / rho)`` with the factor a = 27/28 that PyElastica takes; and the
rotation of an element against shear, ``2 c / R``, sets ``dt < R / c`` for a radius R.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Shear correction factor that PyElastica takes for round sections (Kaneko 1975,
#: doi:10.1088/0022-3727/8/16/003).
SHEAR_FACTOR = 27.0 / 28.0


@dataclass(frozen=True)
class RodLimits:
    """Wave speeds [m/s] of a rod and the steps [s] that they allow."""

    stretch_speed: float
    shear_speed: float
    stretch_step: float
    shear_step: float
    rotation_step: float

    @property
    def step(self) -> float:
        """The shortest of the three [s]."""
        return min(self.stretch_step, self.shear_step, self.rotation_step)

    def text(self) -> str:
        """Name the three."""
        return (
            f"l/c of stretch {self.stretch_step:.3g} s, of shear {self.shear_step:.3g} s, R/c of"
            f" shear {self.rotation_step:.3g} s"
        )


def of_rod(rod: Any) -> RodLimits | None:
    """Return the limits of a PyElastica rod, None when it does not tell its stiffness.

    Parameters
    ----------
    rod : object
        With ``shear_matrix`` (3, 3, n) [N], ``rest_lengths`` (n,) [m], ``mass`` [kg] and
        ``radius`` (n,) [m].
    """
    names = ("shear_matrix", "rest_lengths", "mass", "radius")
    if not all(isinstance(getattr(rod, name, None), np.ndarray) for name in names):
        return None
    lengths = rod.rest_lengths
    per_length = float(rod.mass.sum() / lengths.sum())
    stretch = float(rod.shear_matrix[2, 2].max())
    shear = float(max(rod.shear_matrix[0, 0].max(), rod.shear_matrix[1, 1].max()))
    if not (per_length > 0.0 and stretch > 0.0 and shear > 0.0):
        return None
    c_stretch, c_shear = math.sqrt(stretch / per_length), math.sqrt(shear / per_length)
    shortest = float(lengths.min())
    return RodLimits(
        stretch_speed=c_stretch,
        shear_speed=c_shear,
        stretch_step=shortest / c_stretch,
        shear_step=shortest / c_shear,
        rotation_step=float(rod.radius.min()) / c_shear,
    )
