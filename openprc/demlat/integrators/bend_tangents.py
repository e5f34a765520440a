"""What bends add to the tangent matrix of implicit steps, compiled."""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.compiled.lanes import place
from openprc.demlat.models.barhinge.bend_kernels import collinear, damping_torque, shape
from openprc.demlat.models.barhinge.laws import TINY

#: Pairs of a bend's nodes i, j, k (the vertex is j), the later one first.
BEND_PAIRS = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))


@jit
def _axis_across(u: Any, size: float) -> Any:
    """Return a unit vector across `u`, any one."""
    ax, ay, az = abs(u[0]), abs(u[1]), abs(u[2])
    if ax <= ay and ax <= az:
        w = (0.0, u[2], -u[1])
    elif ay <= az:
        w = (-u[2], 0.0, u[0])
    else:
        w = (u[1], -u[0], 0.0)
    length = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + TINY * size
    return w[0] / length, w[1] / length, w[2] / length


@jit
def _by_arms(second: Any, arms: Any, axis: Any, factors: Any) -> None:
    """Set ``second[0], [1], [2]`` to the blocks of arms uu, uv, vv.

    `factors` are those of the gradient's square, of the same for motions across the plane, and
    of minus the second derivative of the cosine of the turn, which come after its sine and cosine;
    see `openprc.demlat.statics.bending.bend_stiffness`.
    """
    u, v, size_u, size_v = arms
    direct, across, ratio, sine, cosine = factors
    a = (u[0] / size_u, u[1] / size_u, u[2] / size_u)
    b = (v[0] / size_v, v[1] / size_v, v[2] / size_v)
    # Unit vectors along which the ends move when the turn grows.
    g = (
        axis[1] * a[2] - axis[2] * a[1],
        axis[2] * a[0] - axis[0] * a[2],
        axis[0] * a[1] - axis[1] * a[0],
    )
    h = (
        b[1] * axis[2] - b[2] * axis[1],
        b[2] * axis[0] - b[0] * axis[2],
        b[0] * axis[1] - b[1] * axis[0],
    )
    ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    for r in range(3):
        for s in range(3):
            one = 1.0 if r == s else 0.0
            tt = across * axis[r] * axis[s]
            uu = cosine * (one - a[r] * a[s]) - sine * (a[r] * g[s] + g[r] * a[s])
            vv = cosine * (one - b[r] * b[s]) - sine * (b[r] * h[s] + h[r] * b[s])
            uv = one - a[r] * a[s] - b[r] * b[s] + ab * a[r] * b[s]
            second[0, r, s] = (direct * g[r] * g[s] + tt + ratio * uu) / (size_u * size_u)
            second[1, r, s] = (direct * g[r] * h[s] + tt + ratio * uv) / (size_u * size_v)
            second[2, r, s] = (direct * h[r] * h[s] + tt + ratio * vv) / (size_v * size_v)


@jit
def add_bend_tangents(
    group: Any,
    places: Any,
    tangent: Any,
    body: Any,
    x: Any,
    v: Any,
    by_x: float,
    by_v: float,
    definite: bool,
) -> None:
    """Add the contributions of a group of bends."""
    values, stride, second = tangent.factor.values, body.stride, tangent.second
    for e in range(group.j.size):
        i, j = place(group.lanes, group.i, e), place(group.lanes, group.j, e)
        k = place(group.lanes, group.k, e)
        at = (i, j, k)
        geometry = shape(group, body.space, stride, x, e, at)
        turn, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, vv, nn = geometry
        tx, ty, tz, _ = damping_torque(group, body.space, stride, v, e, at, geometry)
        u, w = (ux, uy, uz), (vx, vy, vz)
        size_u, size_v = math.sqrt(uu), math.sqrt(vv)
        product = math.sqrt(nn + TINY)
        moment = group.stiffness[e] * (turn - group.rest_turn[e])
        moment += (tx * nx + ty * ny + tz * nz) / product
        sine, cosine = math.sin(turn), math.cos(turn)
        dashpot = by_v * group.damping[e]
        spring = by_x * group.stiffness[e]
        if collinear(nn, uu, vv):
            # Straight arms resist both ways of bending alike; a moment would have no direction.
            across = spring if abs(group.rest_turn[e]) == 0.0 else 0.0
            axis = _axis_across(u, size_u)
            factors = (spring + dashpot, across + dashpot, 0.0, 0.0, 1.0)
        else:
            axis = (nx / product, ny / product, nz / product)
            ratio = by_x * moment / sine
            if definite:
                across = max(0.5 * ratio * (1.0 + cosine), 0.0)
                factors = (spring + dashpot, across, 0.0, sine, cosine)
            else:
                factors = (spring - ratio * cosine + dashpot, 0.0, ratio, sine, cosine)
        _by_arms(second, (u, w, size_u, size_v), axis, factors)
        for r in range(3):
            for s in range(3):
                of_uu, of_uv, of_vu = second[0, r, s], second[1, r, s], second[1, s, r]
                of_vv = second[2, r, s]
                values[places[e, 0, r, s]] += of_uu
                values[places[e, 1, r, s]] -= of_uu + of_vu
                values[places[e, 2, r, s]] += of_uu + of_uv + of_vu + of_vv
                values[places[e, 3, r, s]] += of_vu
                values[places[e, 4, r, s]] -= of_vu + of_vv
                values[places[e, 5, r, s]] += of_vv
