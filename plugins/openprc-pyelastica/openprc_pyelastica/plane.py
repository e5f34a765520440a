"""Planar runs: PyElastica always keeps three coordinates, and one of them may never change.

A column without variance is not a measurement. It is left out when the caller names the plane,
and only then, since the same script may leave the plane in its next run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc_pyelastica.rods import Rod

AXES = "xyz"

#: Motion out of the plane, relative to the size of the run, that still counts as none.
FLATNESS = 1e-12


def flat_axes(rods: list[Rod]) -> str:
    """Return the axes along which no node ever moves away from the others."""
    # Axis by axis: numbers of one axis are compared quicker than rows of three.
    low, high = (
        np.array([[of(rod.positions[..., axis]) for axis in range(3)] for rod in rods])
        for of in (np.min, np.max)
    )
    spread = high.max(axis=0) - low.min(axis=0)
    return "".join(
        axis for axis, width in zip(AXES, spread, strict=True) if width <= FLATNESS * spread.max()
    )


def project(rods: list[Rod], *, plane: str) -> list[Rod]:
    """Return the rods with the two coordinates of `plane` (``"xz"``).

    Raises
    ------
    ConfigError
        When something moves along the third axis, or is distributed along it.
    """
    (lost,) = set(AXES) - set(plane)
    if lost not in flat_axes(rods):
        width = max(float(np.ptp(rod.positions[:, :, AXES.index(lost)])) for rod in rods)
        raise ConfigError(
            f"the run is not in the plane {plane}: positions spread over {width:.3g} m "
            f"along {lost}",
            expected=f"one value of {lost} for all nodes at all times",
            fix="leave plane out",
            key="plane",
        )
    columns = [AXES.index(axis) for axis in plane]
    return [
        replace(
            rod,
            positions=_pick(rod.positions, columns),
            velocities=None if rod.velocities is None else _pick(rod.velocities, columns),
        )
        for rod in rods
    ]


def _pick(array: NDArray[np.float64], columns: list[int]) -> NDArray[np.float64]:
    first, second = columns
    return array[:, :, first :: second - first][:, :, :2]
