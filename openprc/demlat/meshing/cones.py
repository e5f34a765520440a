"""The k-cone: a pleated cone of k ridges and k troughs around one vertex."""

from __future__ import annotations

import math

import numpy as np

from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import between, check_size, count, length
from openprc.demlat.meshing.surface import surface_mesh
from openprc.errors import ConfigError


def k_cone(
    k: int,
    *,
    radius: float,
    opening: float,
    popped: bool = False,
    sheet_angle: float = 2.0 * math.pi,
    inner_radius: float = 0.0,
    rings: int = 1,
) -> Mesh:
    """Return a cone of 2 k equal sectors, folded along ridges and troughs in turn.

    k = 4 is the waterbomb base, a bistable vertex (Hanna, Lund, Lang, Magleby & Howell 2014,
    doi:10.1088/0964-1726/23/9/094009). Ridges make the angle `opening` with the axis, troughs
    ``o``, from the spherical law of cosines in a sector of angle ``w = sheet_angle / (2 k)``:
    ``cos w = cos(opening) cos(o) + sin(opening) sin(o) cos(pi / k)``. It has two solutions,
    between which the cone snaps.

    Parameters
    ----------
    k : int
        Number of ridges, at least 2.
    radius : float [m]
        Length of the folds, from the apex.
    opening : float [rad]
        Between the axis (z) and the ridges: pi/2 is flat, less is a pointed cone.
    popped : bool
        The solution with the troughs nearer to the axis.
    sheet_angle : float [rad]
        Sum of the sectors; 2 pi is a flat disc.
    inner_radius : float [m]
        0, or the radius of a hole around the apex.
    rings : int
        Rows of panels between apex (or hole) and rim.

    Raises
    ------
    ConfigError
        When the sheet does not reach around at that opening.
    """
    number_of_ridges = count(k, "k", least=2)
    outer, inner = length(radius, "radius"), length(inner_radius, "inner_radius", zero=True)
    layers = count(rings, "rings")
    ridge = between(opening, "opening", low=0.0, high=math.pi)
    total = between(sheet_angle, "sheet_angle", low=0.0, high=2.0 * math.pi, closed=True)
    if inner >= outer:
        raise ConfigError(
            f"a hole of {inner:g} m in a cone of {outer:g} m",
            expected="less than the radius",
            key="inner_radius",
        )
    trough = _trough(number_of_ridges, ridge, total, popped)
    lines = 2 * number_of_ridges
    check_size(lines * (layers + 1), "rings")
    polar = np.where(np.arange(lines) % 2 == 0, ridge, trough)
    azimuth = math.pi * np.arange(lines) / number_of_ridges
    ray = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1
    )
    distance = np.linspace(inner, outer, layers + 1)[0 if inner else 1 :]
    positions = (distance[:, None, None] * ray).reshape(-1, 3)
    number = np.arange(len(positions)).reshape(-1, lines)
    beside = np.roll(number, -1, axis=1)
    a, b, c, d = (table.ravel() for table in (number[:-1], number[1:], beside[1:], beside[:-1]))
    triangles = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    facets = [np.stack([a, c], axis=1)]
    facets += [np.stack([row, np.roll(row, -1)], axis=1) for row in number]
    sets = {"rim": number[-1], "ridges": number[:, ::2], "troughs": number[:, 1::2]}
    if inner == 0.0:
        apex = np.full(lines, len(positions))
        positions = np.concatenate([positions, np.zeros((1, 3))])
        triangles.append(np.stack([apex, number[0], beside[0]], axis=1))
        sets["apex"] = apex[:1]
    else:
        sets["hole"] = number[0]
    return surface_mesh(
        positions,
        np.concatenate(triangles),
        facets=np.concatenate(facets),
        node_sets={name: nodes.ravel() for name, nodes in sets.items()},
    )


def _trough(k: int, ridge: float, total: float, popped: bool) -> float:
    along, across = math.cos(ridge), math.sin(ridge) * math.cos(math.pi / k)
    reach = math.hypot(along, across)
    share = math.cos(total / (2 * k))
    if share > reach * (1.0 + 1e-12):
        raise ConfigError(
            f"an opening of {ridge:g} rad for sectors of {total:g} rad in all",
            expected="an opening at which the sectors reach around the axis",
            fix="use a smaller opening, or a larger sheet_angle",
            key="opening",
        )
    half = math.acos(min(1.0, share / reach)) if reach > 0.0 else math.pi / 2
    middle = math.atan2(across, along)
    return middle - half if popped else middle + half
