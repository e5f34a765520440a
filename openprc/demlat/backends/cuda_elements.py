"""Bars, hinges and signals as device functions of CUDA threads, one element a thread.

The scalar laws are those of `openprc.demlat.models.barhinge.laws`, compiled for the device.
An element never adds to a node: it stores the forces of its ends in slots of its own, and the
nodes gather them in a fixed order, so a run gives the same bits every time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple

from numba import cuda

from openprc.demlat.models.barhinge import laws
from openprc.demlat.signal_table import SAMPLE_SLACK

TINY = laws.TINY
#: Codes of the bar laws, in the order of `openprc.schema.geometry.BAR_LAWS`.
LINEAR, CUBIC, CABLE, STRUT, OGDEN = range(5)
#: Rows of `Bars.reals` and `Hinges.reals`.
STIFFNESS, RELAXED, DAMPING, STIFFNESS_CUBIC, DAMPING_CUBIC, DRAG_I, DRAG_J = range(7)
SINE, COSINE, REST_BEND, LOW, HIGH, LOW_ROOM, HIGH_ROOM = 1, 3, 4, 5, 6, 7, 8
#: Rows of `Nodes.motion`, three axes each; every stage reads the stage rows.
X, V, STAGE_X, STAGE_V, SUM_X, SUM_V = range(0, 18, 3)


class Bars(NamedTuple):
    """Bars in the order of the geometry.

    Attributes
    ----------
    nodes : (3, M) i4
        i, j and the code of the law.
    reals : (7, M)
        Stiffness, relaxed length, damping, the two cubic coefficients, and the coefficients of
        the printed damping at either end.
    """

    nodes: Any
    reals: Any


class Hinges(NamedTuple):
    """Hinges in the order of the geometry.

    Attributes
    ----------
    nodes : (5, K) i4
        j, k, i, l, and 1 where there are walls beyond limits.
    reals : (9, K)
        Stiffness, sine, damping, cosine, rest bend (0 where the sine and cosine turn it back),
        low, high, low room, high room, as in the tables of the compiled kernels.
    """

    nodes: Any
    reals: Any


class Drives(NamedTuple):
    """What drives which coordinate.

    Attributes
    ----------
    motion_row : (3, N) i4
        Row of the next two tables for a prescribed coordinate, else -1.
    motion_column : (P,) i4
        Columns of the signals.
    motion_reals : (3, P)
        Start, drag and weight.
    push_first : (3 N + 1,) i4
        Where the pushes of coordinate a of node n begin, at ``3 n + a``.
    push_column : (Q,) i4
        Columns of the signals.
    signal_rows : (2, C) i4
        First row of a column among the coefficients, and how many it has.
    signal_dt : (C,)
    coefficients : (R, n)
    """

    motion_row: Any
    motion_column: Any
    motion_reals: Any
    push_first: Any
    push_column: Any
    signal_rows: Any
    signal_dt: Any
    coefficients: Any


def device(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that CUDA threads call."""
    compiled: Callable[..., Any] = cuda.jit(device=True)(function)
    return compiled


def _laws_on_device() -> dict[str, Any]:
    # The laws call each other by their names in their module. Twins of them that look names up
    # in a scope of compiled functions need no change to the source.
    scope = dict(vars(laws))
    for name, law in vars(laws).items():
        if isinstance(law, FunctionType):
            scope[name] = device(FunctionType(law.__code__, scope, name))
    return scope


_ON_DEVICE = _laws_on_device()
linear_tension = _ON_DEVICE["linear_tension"]
linear_energy = _ON_DEVICE["linear_energy"]
cubic_tension = _ON_DEVICE["cubic_tension"]
cubic_energy = _ON_DEVICE["cubic_energy"]
ogden_tension = _ON_DEVICE["ogden_tension"]
ogden_energy = _ON_DEVICE["ogden_energy"]
taut = _ON_DEVICE["taut"]
pressed = _ON_DEVICE["pressed"]
engaged = _ON_DEVICE["engaged"]
arctangent = _ON_DEVICE["arctangent"]
turned_back = _ON_DEVICE["turned_back"]
hinge_moment = _ON_DEVICE["hinge_moment"]
hinge_energy = _ON_DEVICE["hinge_energy"]
wall_moment = _ON_DEVICE["wall_moment"]
wall_energy = _ON_DEVICE["wall_energy"]


# --- bars -----------------------------------------------------------------------------------


@device
def bar_tension(law: int, stretch: float, rate: float, reals: Any, e: int) -> Any:
    """Return the tension of bar `e` and the power that its dashpot loses."""
    stiffness = reals[STIFFNESS, e]
    resistance = reals[DAMPING, e] * rate
    if law == CUBIC:
        spring = cubic_tension(stretch, stiffness, reals[STIFFNESS_CUBIC, e])
        resistance += reals[DAMPING_CUBIC, e] * rate * rate * rate
    elif law == CABLE:
        spring = linear_tension(taut(stretch), stiffness)
        resistance *= engaged(stretch)
    elif law == STRUT:
        spring = linear_tension(pressed(stretch), stiffness)
        resistance *= engaged(-stretch)
    elif law == OGDEN:
        spring = ogden_tension(stretch, stiffness, reals[RELAXED, e])
    else:
        spring = linear_tension(stretch, stiffness)
    return spring + resistance, resistance * rate


@device
def bar_energy(law: int, stretch: float, reals: Any, e: int) -> float:
    """Return the elastic energy of bar `e`."""
    stiffness = reals[STIFFNESS, e]
    if law == CUBIC:
        return cubic_energy(stretch, stiffness, reals[STIFFNESS_CUBIC, e])
    if law == CABLE:
        return linear_energy(taut(stretch), stiffness)
    if law == STRUT:
        return linear_energy(pressed(stretch), stiffness)
    if law == OGDEN:
        return ogden_energy(stretch, stiffness, reals[RELAXED, e])
    return linear_energy(stretch, stiffness)


@device
def between(motion: Any, row: int, i: int, j: int) -> Any:
    """Return the difference of three rows of `motion` between the nodes j and i."""
    return (
        motion[row, j] - motion[row, i],
        motion[row + 1, j] - motion[row + 1, i],
        motion[row + 2, j] - motion[row + 2, i],
    )


@device
def measure_bar(e: int, bars: Bars, motion: Any) -> Any:
    """Return length, rate of the length, and the vector from i to j of bar `e`."""
    i, j = bars.nodes[0, e], bars.nodes[1, e]
    dx, dy, dz = between(motion, STAGE_X, i, j)
    ux, uy, uz = between(motion, STAGE_V, i, j)
    length = math.sqrt(dx * dx + dy * dy + dz * dz + TINY)
    return length, (dx * ux + dy * uy + dz * uz) / length, dx, dy, dz


@device
def push_bar(e: int, bars: Bars, motion: Any, ends: Any, losses: Any, weight: float) -> None:
    """Store the force at end i of bar `e`, and `weight` times the power that it loses.

    Where dampers are as printed, the two ends have slots of their own: M + e is that of j.
    """
    length, rate, dx, dy, dz = measure_bar(e, bars, motion)
    tension, lost = bar_tension(
        bars.nodes[2, e], length - bars.reals[RELAXED, e], rate, bars.reals, e
    )
    scale = tension / length
    fx, fy, fz = scale * dx, scale * dy, scale * dz
    n_bars = bars.nodes.shape[1]
    ci, cj = bars.reals[DRAG_I, e], bars.reals[DRAG_J, e]
    if ci != 0.0 or cj != 0.0:
        i, j = bars.nodes[0, e], bars.nodes[1, e]
        ux, uy, uz = between(motion, STAGE_V, i, j)
        lost += ux * (cj * motion[STAGE_V, j] - ci * motion[STAGE_V, i])
        lost += uy * (cj * motion[STAGE_V + 1, j] - ci * motion[STAGE_V + 1, i])
        lost += uz * (cj * motion[STAGE_V + 2, j] - ci * motion[STAGE_V + 2, i])
        ends[0, n_bars + e] = -fx - cj * ux
        ends[1, n_bars + e] = -fy - cj * uy
        ends[2, n_bars + e] = -fz - cj * uz
        fx, fy, fz = fx + ci * ux, fy + ci * uy, fz + ci * uz
    ends[0, e], ends[1, e], ends[2, e] = fx, fy, fz
    losses[e] += weight * lost


# --- hinges ---------------------------------------------------------------------------------


@device
def measure_hinge(h: int, hinges: Hinges, motion: Any) -> Any:
    """Return bend minus rest bend, its rate, its gradients at the wings, and their footpoints.

    As `openprc.demlat.models.barhinge.hinge_kernels.frame`
    (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, after Blondel & Karplus 1996).
    """
    j, k = hinges.nodes[0, h], hinges.nodes[1, h]
    i, l = hinges.nodes[2, h], hinges.nodes[3, h]  # noqa: E741
    ax, ay, az = between(motion, STAGE_X, j, i)
    bx, by, bz = between(motion, STAGE_X, j, k)
    cx, cy, cz = between(motion, STAGE_X, l, k)
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    bb = bx * bx + by * by + bz * bz + TINY
    crease = math.sqrt(bb)
    away, along = turned_back(
        -crease * (nx * ax + ny * ay + nz * az),
        -(mx * nx + my * ny + mz * nz),
        hinges.reals[SINE, h],
        hinges.reals[COSINE, h],
    )
    si = crease / (mx * mx + my * my + mz * mz + TINY)
    sl = -crease / (nx * nx + ny * ny + nz * nz + TINY)
    ix, iy, iz, lx, ly, lz = si * mx, si * my, si * mz, sl * nx, sl * ny, sl * nz
    at_i = (ax * bx + ay * by + az * bz) / bb
    at_l = (cx * bx + cy * by + cz * bz) / bb
    ux, uy, uz = between(motion, STAGE_V, j, i)
    wx, wy, wz = between(motion, STAGE_V, k, l)
    ex, ey, ez = between(motion, STAGE_V, j, k)
    rate = ix * (ux - at_i * ex) + iy * (uy - at_i * ey) + iz * (uz - at_i * ez)
    rate += lx * (wx + at_l * ex) + ly * (wy + at_l * ey) + lz * (wz + at_l * ez)
    change = arctangent(away, along) - hinges.reals[REST_BEND, h]
    return change, rate, ix, iy, iz, lx, ly, lz, at_i, at_l


@device
def beyond(difference: float, reals: Any, h: int) -> Any:
    """Return how far hinge `h` is beyond a limit, and the room that this limit has."""
    if difference > reals[HIGH, h]:
        return difference - reals[HIGH, h], reals[HIGH_ROOM, h]
    return min(difference - reals[LOW, h], 0.0), reals[LOW_ROOM, h]


@device
def spring_moment(difference: float, hinges: Hinges, h: int) -> float:
    """Return the moment of the spring of hinge `h`."""
    stiffness = hinges.reals[STIFFNESS, h]
    moment = hinge_moment(difference, stiffness)
    if hinges.nodes[4, h] != 0:
        excess, room = beyond(difference, hinges.reals, h)
        moment += wall_moment(excess, stiffness, room)
    return moment


@device
def fold_energy(difference: float, hinges: Hinges, h: int) -> float:
    """Return the elastic energy of hinge `h`."""
    stiffness = hinges.reals[STIFFNESS, h]
    energy = hinge_energy(difference, stiffness)
    if hinges.nodes[4, h] != 0:
        excess, room = beyond(difference, hinges.reals, h)
        energy += wall_energy(excess, stiffness, room)
    return energy


@device
def push_hinge(
    h: int, hinges: Hinges, motion: Any, ends: Any, begin: int, losses: Any, at: int, weight: float
) -> None:
    """Store the forces of hinge `h` in four slots from `begin` on, for j, k, i and l."""
    difference, rate, gix, giy, giz, glx, gly, glz, at_i, at_l = measure_hinge(h, hinges, motion)
    resistance = hinges.reals[DAMPING, h] * rate
    moment = spring_moment(difference, hinges, h) + resistance
    n_hinges = hinges.nodes.shape[1]
    slot = begin + h
    for a in range(3):
        gi = gix if a == 0 else (giy if a == 1 else giz)
        gl = glx if a == 0 else (gly if a == 1 else glz)
        fi, fl = -moment * gi, -moment * gl
        crease = at_i * fi - at_l * fl
        ends[a, slot] = crease - fi
        ends[a, slot + n_hinges] = -crease - fl
        ends[a, slot + 2 * n_hinges] = fi
        ends[a, slot + 3 * n_hinges] = fl
    losses[at] += weight * resistance * rate


# --- signals --------------------------------------------------------------------------------


@device
def signal_at(drives: Drives, column: int, t: float, t_from: float, t_to: float) -> Any:
    """Return value and rate of a signal, as seen by a step from `t_from` to `t_to`.

    As `openprc.demlat.models.barhinge.drive_kernels.value_and_rate`.
    """
    dt = drives.signal_dt[column]
    # Rounding down gives a real number on the device.
    segment = int(math.floor(t / dt))  # noqa: RUF046
    begins = int(math.floor(t_from / dt + SAMPLE_SLACK))  # noqa: RUF046
    ends = int(math.ceil(t_to / dt - SAMPLE_SLACK)) - 1  # noqa: RUF046
    segment = min(max(segment, begins), max(ends, 0))
    segment = min(max(segment, 0), drives.signal_rows[1, column] - 1)
    s = t / dt - segment
    row = drives.signal_rows[0, column] + segment
    value, rate = 0.0, 0.0
    for power in range(drives.coefficients.shape[1] - 1, -1, -1):
        rate = rate * s + value
        value = value * s + drives.coefficients[row, power]
    return value, rate / dt
