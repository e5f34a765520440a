"""Chain, rod and tapered spring, and what a chain that stands for a rod is made of."""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.meshing.mesh import Mesh
from openprc.demlat.meshing.parameters import between, check_size, count
from openprc.demlat.meshing.parameters import length as positive
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Reals = NDArray[np.float64]

#: More corners would need more bars in a cross-section than a truss has use for.
MOST_SIDES = 8


def chain(links: int, *, link_length: float, bends: bool = False) -> Mesh:
    """Return a straight chain of bars along x.

    Parameters
    ----------
    links : int
    link_length : float [m]
    bends : bool
        Whether there is a bending spring at every inner node; without them a chain has no
        stiffness against bending.

    Examples
    --------
    >>> from openprc.demlat.meshing import chain
    >>> chain(3, link_length=0.5).positions[:, 0].tolist()
    [0.0, 0.5, 1.0, 1.5]
    """
    n = count(links, "links")
    positions = np.zeros((n + 1, 3))
    positions[:, 0] = np.arange(n + 1) * positive(link_length, "link_length")
    first = np.arange(n)
    return Mesh(
        positions=positions,
        bars=np.stack([first, first + 1], axis=1),
        bar_kinds=np.full(n, "link"),
        bends=first[1:, np.newaxis] + [-1, 0, 1] if bends else np.zeros((0, 3), "i4"),
        node_sets={"left": first[:1], "right": first[-1:] + 1},
    )


def rod_constants(
    mesh: Mesh, *, radius: float, young_modulus: float, density: float
) -> dict[str, Reals]:
    """Return what makes a chain with bends the bar form of a round elastic rod.

    Segments of length l have ``k = E A / l`` and half of their mass ``rho A l`` at either end;
    a bend between segments of mean length l has ``k = E I / l``, with ``A = pi r^2`` and
    ``I = pi r^4 / 4`` (Bergou et al. 2008, "Discrete elastic rods", doi:10.1145/1360612.1360662,
    without twist). Fix the first two nodes to clamp an end: the tip of a cantilever then moves by
    ``F L^3 / (3 E I) (1 - 3 / (2 n) + 1 / (2 n^2))`` under a small load, n being the number of
    segments.

    Parameters
    ----------
    mesh : Mesh
        Such as ``chain(n, link_length=l, bends=True)``.
    radius : float [m]
    young_modulus : float [Pa]
    density : float [kg/m3]

    Returns
    -------
    dict
        "mass" (N,) [kg], "stiffness" (M,) [N/m] and "bend_stiffness" (B,) [N*m/rad], arguments
        of `Mesh.to_setup`.

    Examples
    --------
    >>> from openprc.demlat import SimulationSetup
    >>> from openprc.demlat.meshing import chain, rod_constants
    >>> mesh = chain(10, link_length=0.1, bends=True)
    >>> rod = rod_constants(mesh, radius=0.02, young_modulus=1e6, density=1000.0)
    >>> setup = SimulationSetup("cantilever", overwrite=True)
    >>> nodes = mesh.to_setup(setup, **rod, fixed=[0, 1])
    >>> print(f"{rod['bend_stiffness'][0]:.6f} N*m/rad")
    1.256637 N*m/rad
    """
    area = np.pi * positive(radius, "radius") ** 2
    modulus = between(young_modulus, "young_modulus", low=0.0, high=math.inf, unit="Pa")
    rho = between(density, "density", low=0.0, high=math.inf, unit="kg/m3")
    lengths = mesh.bar_lengths
    masses = np.zeros(mesh.n_nodes)
    np.add.at(masses, mesh.bars, 0.5 * rho * area * lengths[:, np.newaxis])
    ends, vertex = mesh.positions[mesh.bends[:, [0, 2]]], mesh.positions[mesh.bends[:, 1]]
    arms = np.linalg.norm(ends - vertex[:, np.newaxis], axis=2)
    return {
        "mass": masses,
        "stiffness": modulus * area / lengths,
        "bend_stiffness": 0.25 * modulus * area * radius**2 / arms.mean(axis=1),
    }


def rod(segments: int, *, length: float, radius: float, sides: int = 3) -> Mesh:
    """Return a straight rod along x: a truss of longerons, rings and braces.

    With n longerons of axial rigidity EA each, at distance `radius` from the axis, a slender
    rod has the bending rigidity ``n EA radius^2 / 2``, the same in every direction.

    Parameters
    ----------
    segments : int
    length : float [m]
    radius : float [m]
        From the axis to the longerons.
    sides : int
        Number of longerons, from 3 to 8.
    """
    n = count(segments, "segments")
    axis = np.zeros((n + 1, 3))
    axis[:, 0] = np.linspace(0.0, positive(length, "length"), n + 1)
    return truss_along(axis, np.full(n + 1, positive(radius, "radius")), sides=sides)


def tapered_spring(
    turns: float,
    segments: int,
    *,
    height: float,
    coil_radius: ArrayLike,
    wire_radius: ArrayLike,
    sides: int = 3,
) -> Mesh:
    """Return a helical spring along z whose coil, or wire, becomes thinner towards the top.

    The wire is a truss, so that it resists bending and torsion by axial forces.

    Parameters
    ----------
    turns : float
    segments : int
        Of the wire, altogether; at least 8 a turn.
    height : float [m]
        Of the axis of the wire, from end to end.
    coil_radius : float or (bottom, top) [m]
        From the axis of the spring to the axis of the wire.
    wire_radius : float or (bottom, top) [m]
        From the axis of the wire to its longerons.
    sides : int
        Number of longerons.

    Raises
    ------
    ConfigError
        When the wire would touch itself.
    """
    wound = positive(turns, "turns")
    n = count(segments, "segments", least=max(1, math.ceil(8 * wound)))
    rise = positive(height, "height")
    coil = _two(coil_radius, "coil_radius")
    wire = _two(wire_radius, "wire_radius")
    along = np.linspace(0.0, 1.0, n + 1)
    radii = coil[0] + (coil[1] - coil[0]) * along
    thick = wire[0] + (wire[1] - wire[0]) * along
    pitch = math.hypot(rise, coil[1] - coil[0]) / wound
    if max(wire) >= min(coil) or (wound > 1 and 2 * max(wire) >= pitch):
        raise ConfigError(
            f"a wire radius of {max(wire):g} m in a coil of radius {min(coil):g} m"
            f" with turns {pitch:g} m apart",
            expected="a wire that is thinner than the coil and than half the distance of turns",
            fix="use a thinner wire, or fewer turns",
            key="wire_radius",
        )
    angle = 2.0 * np.pi * wound * along
    axis = np.stack([radii * np.cos(angle), radii * np.sin(angle), rise * along], axis=1)
    return truss_along(axis, thick, sides=sides)


def truss_along(axis: Reals, radii: Reals, *, sides: int = 3) -> Mesh:
    """Return a truss around a curve.

    Nodes are numbered longeron by longeron. The sections do not twist: their frames are
    rotation minimising, by double reflection (Wang, Juettler, Zheng & Liu 2008,
    doi:10.1145/1330511.1330513).

    Parameters
    ----------
    axis : (S, 3) [m]
        Centres of the sections.
    radii : (S,) [m]
    sides : int
        Number of longerons, from 3 to 8.

    Returns
    -------
    Mesh
        Bars of the kinds "longeron", "ring" and "brace"; node sets "left" and "right" are
        the first and the last section.
    """
    corners = count(sides, "sides", least=3)
    if corners > MOST_SIDES:
        raise ConfigError(f"{corners} sides", expected=f"3 to {MOST_SIDES}", key="sides")
    n = len(axis)
    check_size(n * corners, "segments")
    normal, binormal = rotation_minimising(axis)
    turn = 2.0 * np.pi * np.arange(corners) / corners
    around = np.cos(turn)[:, None, None] * normal + np.sin(turn)[:, None, None] * binormal
    positions = axis + radii[:, None] * around
    number = np.arange(corners * n).reshape(corners, n)
    beside = np.roll(number, -1, axis=0)
    parts = {
        "longeron": [(number[:, :-1], number[:, 1:])],
        "ring": [(number[i], number[j]) for i, j in combinations(range(corners), 2)],
        "brace": [(number[:, :-1], beside[:, 1:])],
    }
    rows = {
        kind: np.concatenate([np.stack([i.ravel(), j.ravel()], axis=1) for i, j in ends])
        for kind, ends in parts.items()
    }
    a, b = number[:, :-1].ravel(), beside[:, :-1].ravel()
    c, d = beside[:, 1:].ravel(), number[:, 1:].ravel()
    return Mesh(
        positions=positions.reshape(-1, 3),
        bars=np.concatenate(list(rows.values())),
        bar_kinds=np.concatenate([np.full(len(ends), kind) for kind, ends in rows.items()]),
        faces=np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)]),
        node_sets={"left": number[:, 0], "right": number[:, -1]},
    )


def rotation_minimising(axis: Reals) -> tuple[Reals, Reals]:
    """Return two unit vectors across a curve (S, 3) at each point: (S, 3), (S, 3)."""
    tangent = np.gradient(axis, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.zeros_like(axis)
    helper = np.eye(3)[np.abs(tangent[0]).argmin()]
    first = np.cross(tangent[0], helper)
    normal[0] = first / np.linalg.norm(first)
    for s in range(len(axis) - 1):
        step = axis[s + 1] - axis[s]
        scale = 2.0 / (step @ step)
        left = normal[s] - scale * (step @ normal[s]) * step
        ahead = tangent[s] - scale * (step @ tangent[s]) * step
        mirror = tangent[s + 1] - ahead
        size = mirror @ mirror
        turned = left if size == 0.0 else left - 2.0 / size * (mirror @ left) * mirror
        # Rounding adds up along the curve.
        turned -= (turned @ tangent[s + 1]) * tangent[s + 1]
        normal[s + 1] = turned / np.linalg.norm(turned)
    return normal, np.cross(tangent, normal)


def _two(values: ArrayLike, key: str) -> tuple[float, float]:
    array = np.asarray(values, dtype="f8")
    if array.shape not in ((), (1,), (2,)):
        raise ConfigError(f"shape {array.shape}", expected="one radius, or two", key=key)
    bottom, top = np.broadcast_to(array, 2)
    return positive(bottom, key), positive(top, key)
