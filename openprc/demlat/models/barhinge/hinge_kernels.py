"""Forces, energies and observables of hinges, for any number of lanes."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, place, scatter, splat
from openprc.demlat.models.barhinge import laws
from openprc.demlat.models.barhinge.bar_kernels import damp, difference, fetch, keep, push
from openprc.demlat.models.barhinge.laws import select
from openprc.demlat.models.barhinge.tables import (
    HINGES,
    LEDGER_STRIDE,
    LinearHinges,
    WalledHinges,
)

arctangent = jit(laws.arctangent)
turned_back = jit(laws.turned_back)
hinge_moment = jit(laws.hinge_moment)
hinge_energy = jit(laws.hinge_energy)
wall_moment = jit(laws.wall_moment)
wall_energy = jit(laws.wall_energy)
TINY = laws.TINY


def spring_moment(group: Any, p: int, difference: Any) -> Any:
    """Return the moment [N m] of block `p` by the group's law."""


def stored_energy(group: Any, p: int, difference: Any) -> Any:
    """Return the elastic energy [J] of block `p` by the group's law."""


def _linear(group: Any, p: int, difference: Any) -> Any:
    return hinge_moment(difference, load(group.lanes, group.stiffness, p, 0))


def _linear_energy(group: Any, p: int, difference: Any) -> Any:
    return hinge_energy(difference, load(group.lanes, group.stiffness, p, 0))


@jit
def _beyond(group: Any, p: int, difference: Any) -> Any:
    """Return how far the lanes are beyond a limit, and the room that this limit has."""
    lanes = group.lanes
    over = difference - load(lanes, group.high, p, 0)
    under = difference - load(lanes, group.low, p, 0)
    zero = splat(lanes, 0.0)
    excess = select(over > 0.0, over, select(under < 0.0, under, zero))
    low_room, high_room = load(lanes, group.low_room, p, 0), load(lanes, group.high_room, p, 0)
    return excess, select(over > 0.0, high_room, low_room)


def _walled(group: Any, p: int, difference: Any) -> Any:
    excess, room = _beyond(group, p, difference)
    stiffness = load(group.lanes, group.stiffness, p, 0)
    return hinge_moment(difference, stiffness) + wall_moment(excess, stiffness, room)


def _walled_energy(group: Any, p: int, difference: Any) -> Any:
    excess, room = _beyond(group, p, difference)
    stiffness = load(group.lanes, group.stiffness, p, 0)
    return hinge_energy(difference, stiffness) + wall_energy(excess, stiffness, room)


@chosen_by_type(spring_moment)
def _spring_moment(group: Any, p: int, difference: Any) -> Any:
    return {LinearHinges: _linear, WalledHinges: _walled}[group.instance_class]


@chosen_by_type(stored_energy)
def _stored_energy(group: Any, p: int, difference: Any) -> Any:
    return {LinearHinges: _linear_energy, WalledHinges: _walled_energy}[group.instance_class]


def from_rest(group: Any, p: int, turned: Any) -> Any:
    """Return bend minus rest bend of block `p`.

    A linear hinge has turned it back already, and means the shorter way round. One with walls
    cannot go through shut, so for it the way there is the way it came.
    """


@chosen_by_type(from_rest)
def _from_rest(group, p, turned):
    if group.instance_class is LinearHinges:
        return lambda group, p, turned: turned
    return lambda group, p, turned: turned - load(group.lanes, group.rest_bend, p, 0)


# --- geometry -----------------------------------------------------------------------------


def edges(group: Any, space: Any, stride: int, x: Any, p: int, places: Any) -> Any:
    """Return the vectors j to i, j to k and l to k of block `p`."""


@jit
def _edges_of(lanes: Any, space: Any, stride: int, x: Any, places: Any) -> Any:
    j, k, i, l = places  # noqa: E741
    ax, ay, az = difference(lanes, space, x, stride, j, i)
    bx, by, bz = difference(lanes, space, x, stride, j, k)
    cx, cy, cz = difference(lanes, space, x, stride, l, k)
    return ax, ay, az, bx, by, bz, cx, cy, cz


@chosen_by_type(edges)
def _edges(group: Any, space: Any, stride: int, x: Any, p: int, places: Any) -> Any:
    if isinstance(group.types[group.fields.index("offset")], types.NoneType):
        return lambda group, space, stride, x, p, places: _edges_of(
            group.lanes, space, stride, x, places
        )

    def displaced(group, space, stride, x, p, places):
        lanes, o = group.lanes, group.offset
        ax, ay, az, bx, by, bz, cx, cy, cz = _edges_of(lanes, space, stride, x, places)
        return (
            ax + fetch(lanes, o[0], p),
            ay + fetch(lanes, o[1], p),
            az + fetch(lanes, o[2], p),
            bx + fetch(lanes, o[3], p),
            by + fetch(lanes, o[4], p),
            bz + fetch(lanes, o[5], p),
            cx + fetch(lanes, o[6], p),
            cy + fetch(lanes, o[7], p),
            cz + fetch(lanes, o[8], p),
        )

    return displaced


@jit
def frame(group: Any, space: Any, stride: int, x: Any, p: int, places: Any) -> Any:
    """Return bend minus rest bend [rad], and what its gradient is made of.

    Returns
    -------
    difference [rad]; gradient at wing i (3), at wing l (3) [rad/m]; and the fractions p and q
    at which the wings stand along the crease, so that the gradients at the crease are
    ``g_j = (p - 1) g_i - q g_l`` and ``g_k = (q - 1) g_l - p g_i``
    (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, after Blondel & Karplus 1996).
    """
    lanes = group.lanes
    ax, ay, az, bx, by, bz, cx, cy, cz = edges(group, space, stride, x, p, places)
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    bb = bx * bx + by * by + bz * bz + TINY
    crease = math.sqrt(bb)
    away, along = turned_back(
        -crease * (nx * ax + ny * ay + nz * az),
        -(mx * nx + my * ny + mz * nz),
        load(lanes, group.sine, p, 0),
        load(lanes, group.cosine, p, 0),
    )
    change = from_rest(group, p, arctangent(away, along))
    si = crease / (mx * mx + my * my + mz * mz + TINY)
    sl = -crease / (nx * nx + ny * ny + nz * nz + TINY)
    inverse = 1.0 / bb
    at_i = (ax * bx + ay * by + az * bz) * inverse
    at_l = (cx * bx + cy * by + cz * bz) * inverse
    return change, si * mx, si * my, si * mz, sl * nx, sl * ny, sl * nz, at_i, at_l


@jit
def moment_of(
    group: Any, space: Any, stride: int, v: Any, p: int, places: Any, geometry: Any
) -> Any:
    """Return moment [N m], and the power that the damper loses [W]."""
    lanes = group.lanes
    change, ix, iy, iz, lx, ly, lz, p_i, p_l = geometry
    j, k, i, l = places  # noqa: E741
    # g.v with the gradients at the crease written out: wings against points of the crease.
    ux, uy, uz = difference(lanes, space, v, stride, j, i)
    wx, wy, wz = difference(lanes, space, v, stride, k, l)
    cx, cy, cz = difference(lanes, space, v, stride, j, k)
    rate = ix * (ux - p_i * cx) + iy * (uy - p_i * cy) + iz * (uz - p_i * cz)
    rate += lx * (wx + p_l * cx) + ly * (wy + p_l * cy) + lz * (wz + p_l * cz)
    resistance, loss = damp(lanes, group.damping, p, rate)
    return spring_moment(group, p, change) + resistance, loss


# --- loops --------------------------------------------------------------------------------


@jit
def add_hinges(group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces ``-M d(angle)/dx`` of a group of hinges, and what they lose to `rates`."""
    lanes = group.lanes
    width = len(lanes)
    lost = splat(lanes, 0.0)
    for b in range(group.j.shape[0]):
        j, k = place(lanes, group.j, b), place(lanes, group.k, b)
        i, l = place(lanes, group.i, b), place(lanes, group.l, b)  # noqa: E741
        places = (j, k, i, l)
        geometry = frame(group, space, stride, x, b * width, places)
        moment, loss = moment_of(group, space, stride, v, b * width, places, geometry)
        _, gix, giy, giz, glx, gly, glz, p_i, p_l = geometry
        ix, iy, iz = -moment * gix, -moment * giy, -moment * giz
        lx, ly, lz = -moment * glx, -moment * gly, -moment * glz
        push(lanes, space, force, stride, i, ix, iy, iz)
        push(lanes, space, force, stride, l, lx, ly, lz)
        sx, sy, sz = p_i * ix - p_l * lx, p_i * iy - p_l * ly, p_i * iz - p_l * lz
        push(lanes, space, force, stride, j, sx - ix, sy - iy, sz - iz)
        push(lanes, space, force, stride, k, -sx - lx, -sy - ly, -sz - lz)
        lost += loss
    keep(lanes, rates, HINGES * LEDGER_STRIDE, lost)


@jit
def observe_hinges(
    group: Any, space: Any, stride: int, x: Any, v: Any, changes: Any, moments: Any
) -> Any:
    """Write angle minus rest angle, and moments; return the elastic energy by lane."""
    lanes = group.lanes
    width = len(lanes)
    energy = splat(lanes, 0.0)
    for b in range(group.j.shape[0]):
        j, k = place(lanes, group.j, b), place(lanes, group.k, b)
        i, l = place(lanes, group.i, b), place(lanes, group.l, b)  # noqa: E741
        places = (j, k, i, l)
        geometry = frame(group, space, stride, x, b * width, places)
        moment, _ = moment_of(group, space, stride, v, b * width, places, geometry)
        energy += stored_energy(group, b * width, geometry[0])
        scatter(lanes, changes, group.element, b * width, geometry[0])
        scatter(lanes, moments, group.element, b * width, moment)
    return energy
