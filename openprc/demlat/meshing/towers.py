"""Triangulated tubes: the Kresling tower and the Yoshimura tube.

Nodes are numbered ring by ring from the bottom. Faces turn outwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import between, check_size, count, length
from openprc.demlat.meshing.surface import surface_mesh
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import NDArray


def kresling(
    sides: int,
    levels: int = 1,
    *,
    radius: float,
    height: float,
    twist: float,
    alternate: bool = False,
) -> Mesh:
    """Return a Kresling tower.

    A node of a polygon is tied to two nodes of the polygon above, at relative azimuths
    ``twist - pi/sides`` and ``twist + pi/sides``.

    Parameters
    ----------
    sides : int
        Of the polygons, at least 3.
    levels : int
    radius : float [m]
        Of the circle around the polygons.
    height : float [m]
        Of one level.
    twist : float [rad]
        Between 0 and pi; `kresling_second_state` has the other one without strain.
    alternate : bool
        Every second level is twisted the other way, so that an even number does not turn.

    Examples
    --------
    >>> import math
    >>> from openprc.demlat.meshing import kresling
    >>> tower = kresling(6, radius=1.0, height=1.75, twist=math.radians(50))
    >>> sorted({round(length, 4) for length in tower.bar_lengths.tolist()})
    [1.0, 1.7841, 2.1715]
    """
    n, floors = count(sides, "sides", least=3), count(levels, "levels")
    size, step = length(radius, "radius"), length(height, "height")
    turn = between(twist, "twist", low=0.0, high=math.pi)
    hands = [-1 if alternate and floor % 2 else 1 for floor in range(floors)]
    azimuth = np.cumsum([0.0, *(hand * (turn - math.pi / n) for hand in hands)])
    return _tube(n, azimuth, step, size, [hand > 0 for hand in hands])


def kresling_second_state(
    sides: int, *, radius: float, height: float, twist: float
) -> tuple[float, float]:
    """Return height [m] and twist [rad] of the other state without strain.

    All bars have the same length at ``pi - twist`` and at ``height^2 - 4 radius^2 cos(twist)
    cos(pi / sides)``: with a relative azimuth ``twist -+ pi/n`` the lengths of the bars are
    ``height^2 + 2 radius^2 (1 - cos(twist -+ pi/n))``, whose difference holds sin(twist) and
    whose sum holds height and cos(twist) only. Materials do not matter.

    Raises
    ------
    ConfigError
        When there is no other state: it would have no height.
    """
    n = count(sides, "sides", least=3)
    size, step = length(radius, "radius"), length(height, "height")
    turn = between(twist, "twist", low=0.0, high=math.pi)
    square = step**2 - 4.0 * size**2 * math.cos(turn) * math.cos(math.pi / n)
    if square <= 0.0:
        least = 2.0 * size * math.sqrt(math.cos(turn) * math.cos(math.pi / n))
        raise ConfigError(
            f"a height of {step:g} m: this tower has one state without strain only",
            expected=f"a height above {least:g} m at this twist",
            fix="use a larger height, or a twist nearer to pi/2",
            key="height",
        )
    return math.sqrt(square), math.pi - turn


def yoshimura(sides: int, levels: int, *, radius: float, height: float) -> Mesh:
    """Return a Yoshimura tube: isosceles triangles, every ring turned by half a side.

    Seen from outside, the rings are valleys and the diagonals mountains. The pattern is
    developable: the six sectors of every inner node add up to 2 pi.

    Parameters
    ----------
    sides : int
        Of the rings, at least 3.
    levels : int
    radius : float [m]
        Of the circle around the rings.
    height : float [m]
        Of one level.
    """
    n, floors = count(sides, "sides", least=3), count(levels, "levels")
    half = math.pi / n
    azimuth = half * (np.arange(floors + 1) % 2)
    rising = [floor % 2 == 1 for floor in range(floors)]
    return _tube(n, azimuth, length(height, "height"), length(radius, "radius"), rising)


def _tube(
    n: int,
    azimuth: NDArray[np.floating],
    step: float,
    radius: float,
    ahead: Sequence[bool],
) -> Mesh:
    """Join rings; in a level that is `ahead` the diagonals go to the next node above."""
    rings = len(azimuth)
    check_size(n * rings, "levels")
    angle = azimuth[:, None] + 2.0 * np.pi * np.arange(n) / n
    level = np.broadcast_to(step * np.arange(rings)[:, None], angle.shape)
    positions = np.stack([radius * np.cos(angle), radius * np.sin(angle), level], axis=2)
    number = np.arange(n * rings).reshape(rings, n)
    triangles = []
    for floor, leaning in enumerate(ahead):
        b, t = number[floor], number[floor + 1]
        upper = np.roll(t, -1) if leaning else t
        triangles.append(np.stack([b, np.roll(b, -1), upper], axis=1))
        triangles.append(np.stack([b, upper, np.roll(upper, 1)], axis=1))
    return surface_mesh(
        positions,
        np.concatenate(triangles),
        node_sets={"bottom": number[0], "top": number[-1]},
    )
