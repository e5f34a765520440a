"""Forces, energies and observables of bends, for any number of lanes.

With arms u and v from the vertex to the ends and ``n = u x v``, all that a bend does is a torque
T on the arm v and -T on the arm u, along n where it springs back. They are the forces
``u x T / u.u`` and ``T x v / v.v`` at the ends; the vertex takes what balances these, so forces
and torques add up to zero by construction. This is the gradient of the angle (Swope & Ferguson
1992, doi:10.1002/jcc.540130508) without a division by its sine.
"""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, place, scatter, splat
from openprc.demlat.models.barhinge import laws
from openprc.demlat.models.barhinge.bar_kernels import difference, fetch, keep, push
from openprc.demlat.models.barhinge.hinge_kernels import arctangent, hinge_energy, hinge_moment
from openprc.demlat.models.barhinge.laws import select
from openprc.demlat.models.barhinge.tables import BENDS, LEDGER_STRIDE

collinear = jit(laws.collinear)
TINY = laws.TINY


def arms(group: Any, space: Any, stride: int, x: Any, p: int, places: Any) -> Any:
    """Return the arm from the vertex to the first end, and the sum of both arms, of block `p`.

    The sum is small where the bend is straight; products with it keep the digits that those of
    two opposite vectors would lose.
    """


@jit
def _arms_of(lanes: Any, space: Any, stride: int, x: Any, places: Any) -> Any:
    i, j, k = places
    ux, uy, uz = difference(lanes, space, x, stride, j, i)
    vx, vy, vz = difference(lanes, space, x, stride, j, k)
    return ux, uy, uz, ux + vx, uy + vy, uz + vz


@chosen_by_type(arms)
def _arms(group, space, stride, x, p, places):
    if isinstance(group.types[group.fields.index("offset")], types.NoneType):
        return lambda group, space, stride, x, p, places: _arms_of(
            group.lanes, space, stride, x, places
        )

    def displaced(group, space, stride, x, p, places):
        lanes, o = group.lanes, group.offset
        ux, uy, uz, wx, wy, wz = _arms_of(lanes, space, stride, x, places)
        return (
            ux + fetch(lanes, o[0], p),
            uy + fetch(lanes, o[1], p),
            uz + fetch(lanes, o[2], p),
            wx + fetch(lanes, o[3], p),
            wy + fetch(lanes, o[4], p),
            wz + fetch(lanes, o[5], p),
        )

    return displaced


@jit
def shape(group: Any, space: Any, stride: int, x: Any, p: int, places: Any) -> Any:
    """Return turn [rad], both arms (3 each), their product (3), and the squares of all three.

    The turn is pi minus the angle, by the arctangent of |u x v| and -u.v: 0 is straight, and it is
    exact to rounding there and where the arms fold back, as an arc cosine is not.
    """
    ux, uy, uz, wx, wy, wz = arms(group, space, stride, x, p, places)
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    vx, vy, vz = wx - ux, wy - uy, wz - uz
    uu = ux * ux + uy * uy + uz * uz + TINY
    vv = vx * vx + vy * vy + vz * vz + TINY
    nn = nx * nx + ny * ny + nz * nz
    turn = arctangent(math.sqrt(nn), uu - (ux * wx + uy * wy + uz * wz))
    return turn, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, vv, nn


def damping_torque(
    group: Any, space: Any, stride: int, v: Any, p: int, places: Any, geometry: Any
) -> Any:
    """Return the torque of the dashpots (3) [N m] and what they lose [W]; nothing without any."""


@chosen_by_type(damping_torque)
def _damping_torque(group, space, stride, v, p, places, geometry):
    if isinstance(group.types[group.fields.index("damping")], types.NoneType):

        def without(group, space, stride, v, p, places, geometry):
            zero = splat(group.lanes, 0.0)
            return zero, zero, zero, zero

        return without

    def dashpots(group, space, stride, v, p, places, geometry):
        lanes = group.lanes
        i, j, k = places
        _, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, vv, nn = geometry
        ax, ay, az = difference(lanes, space, v, stride, j, i)
        bx, by, bz = difference(lanes, space, v, stride, j, k)
        # The angular velocity of the first arm against the second one. Its component along n is
        # the rate of the turn. Straight arms begin to turn about it, whatever its direction.
        pu, pv = 1.0 / uu, 1.0 / vv
        rx = pu * (uy * az - uz * ay) - pv * (vy * bz - vz * by)
        ry = pu * (uz * ax - ux * az) - pv * (vz * bx - vx * bz)
        rz = pu * (ux * ay - uy * ax) - pv * (vx * by - vy * bx)
        share = (nx * rx + ny * ry + nz * rz) / (nn + TINY)
        straight = collinear(nn, uu, vv)
        damping = load(lanes, group.damping, p, 0)
        tx = damping * select(straight, rx, share * nx)
        ty = damping * select(straight, ry, share * ny)
        tz = damping * select(straight, rz, share * nz)
        return tx, ty, tz, tx * rx + ty * ry + tz * rz

    return dashpots


# --- loops --------------------------------------------------------------------------------


@jit
def add_bends(group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces of a group of bends, and what they lose to `rates`."""
    lanes = group.lanes
    width = len(lanes)
    lost = splat(lanes, 0.0)
    for b in range(group.j.shape[0]):
        p = b * width
        i, j, k = place(lanes, group.i, b), place(lanes, group.j, b), place(lanes, group.k, b)
        places = (i, j, k)
        geometry = shape(group, space, stride, x, p, places)
        turn, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, vv, nn = geometry
        tx, ty, tz, loss = damping_torque(group, space, stride, v, p, places, geometry)
        moment = hinge_moment(
            turn - load(lanes, group.rest_turn, p, 0), load(lanes, group.stiffness, p, 0)
        )
        pull = moment / math.sqrt(nn + TINY)
        tx, ty, tz = tx + pull * nx, ty + pull * ny, tz + pull * nz
        pu, pv = 1.0 / uu, 1.0 / vv
        fx, fy, fz = pu * (uy * tz - uz * ty), pu * (uz * tx - ux * tz), pu * (ux * ty - uy * tx)
        gx, gy, gz = pv * (ty * vz - tz * vy), pv * (tz * vx - tx * vz), pv * (tx * vy - ty * vx)
        push(lanes, space, force, stride, i, fx, fy, fz)
        push(lanes, space, force, stride, k, gx, gy, gz)
        push(lanes, space, force, stride, j, -fx - gx, -fy - gy, -fz - gz)
        lost += loss
    keep(lanes, rates, BENDS * LEDGER_STRIDE, lost)


@jit
def observe_bends(
    group: Any, space: Any, stride: int, x: Any, v: Any, turns: Any, moments: Any
) -> Any:
    """Write turns and moments, positive where the angle is to fall; return energies by lane."""
    lanes = group.lanes
    width = len(lanes)
    energy = splat(lanes, 0.0)
    for b in range(group.j.shape[0]):
        p = b * width
        places = (place(lanes, group.i, b), place(lanes, group.j, b), place(lanes, group.k, b))
        geometry = shape(group, space, stride, x, p, places)
        tx, ty, tz, _ = damping_torque(group, space, stride, v, p, places, geometry)
        turn, nx, ny, nz, nn = geometry[0], geometry[7], geometry[8], geometry[9], geometry[12]
        change = turn - load(lanes, group.rest_turn, p, 0)
        stiffness = load(lanes, group.stiffness, p, 0)
        against = (tx * nx + ty * ny + tz * nz) / math.sqrt(nn + TINY)
        energy += hinge_energy(change, stiffness)
        scatter(lanes, turns, group.element, p, turn)
        scatter(lanes, moments, group.element, p, -hinge_moment(change, stiffness) - against)
    return energy


def add_all_bends(groups: Any, body: Any, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces of every group of bends; nothing where there are none."""


@chosen_by_type(add_all_bends)
def _add_all_bends(groups, body, x, v, force, rates):
    if len(groups) == 0:
        return lambda groups, body, x, v, force, rates: None

    def one_by_one(groups, body, x, v, force, rates):
        add_bends(groups[0], body.space, body.stride, x, v, force, rates)
        add_all_bends(groups[1:], body, x, v, force, rates)

    return one_by_one
