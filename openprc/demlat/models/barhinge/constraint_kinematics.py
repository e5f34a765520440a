"""Length and bend of single elements, with their derivatives, on the flat state; compiled."""

from __future__ import annotations

import math

from openprc.demlat.compiled.jit import jit
from openprc.demlat.linear.symbolic import Reals


@jit
def wrap_angle(angle: float) -> float:
    """Return `angle` [rad] moved into [-pi, pi] by whole turns."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@jit
def bar_value(x: Reals, stride: int, i: int, j: int, length: float) -> float:
    """Return ``(|d|^2 - l0^2) / (2 l0)`` [m] of a bar."""
    dx = x[j] - x[i]
    dy = x[stride + j] - x[stride + i]
    dz = x[2 * stride + j] - x[2 * stride + i]
    return (dx * dx + dy * dy + dz * dz - length * length) / (2.0 * length)


@jit
def hinge_parts(
    x: Reals,
    stride: int,
    j: int,
    k: int,
    i: int,
    l: int,  # noqa: E741  the names of the literature
) -> tuple[float, ...]:
    """Return bend [rad], its gradients at wings i (3) and l (3) [rad/m], and p, q [1].

    The bend is the dihedral angle minus pi, from an arctangent of two arguments (Blondel &
    Karplus 1996, doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T): exact
    near flat, cut where the hinge is folded shut. The gradients at the crease are
    ``g_j = (p - 1) g_i - q g_l`` and ``g_k = (q - 1) g_l - p g_i`` (Liu & Paulino 2017,
    doi:10.1098/rspa.2017.0348).
    """
    s, t = stride, 2 * stride
    ax, ay, az = x[i] - x[j], x[s + i] - x[s + j], x[t + i] - x[t + j]
    bx, by, bz = x[k] - x[j], x[s + k] - x[s + j], x[t + k] - x[t + j]
    cx, cy, cz = x[k] - x[l], x[s + k] - x[s + l], x[t + k] - x[t + l]
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    bb = bx * bx + by * by + bz * bz
    crease = math.sqrt(bb)
    bend = math.atan2(-crease * (nx * ax + ny * ay + nz * az), -(mx * nx + my * ny + mz * nz))
    f = crease / (mx * mx + my * my + mz * mz)
    g = -crease / (nx * nx + ny * ny + nz * nz)
    p = (ax * bx + ay * by + az * bz) / bb
    q = (cx * bx + cy * by + cz * bz) / bb
    return bend, f * mx, f * my, f * mz, g * nx, g * ny, g * nz, p, q


@jit
def hinge_bend_second(
    x: Reals,
    v: Reals,
    stride: int,
    j: int,
    k: int,
    i: int,
    l: int,  # noqa: E741
) -> float:
    """Return the second derivative of a bend along straight motion ``x + t v`` [rad/s2].

    From ``bend' = f m.u + g n.w`` with ``f = |b| / m.m``, ``g = -|b| / n.n``,
    ``u = a' - p b'`` and ``w = q b' - c'`` (the gradient of `hinge_parts` times v, regrouped),
    differentiated once more term by term.
    """
    s, t = stride, 2 * stride
    ax, ay, az = x[i] - x[j], x[s + i] - x[s + j], x[t + i] - x[t + j]
    bx, by, bz = x[k] - x[j], x[s + k] - x[s + j], x[t + k] - x[t + j]
    cx, cy, cz = x[k] - x[l], x[s + k] - x[s + l], x[t + k] - x[t + l]
    dax, day, daz = v[i] - v[j], v[s + i] - v[s + j], v[t + i] - v[t + j]
    dbx, dby, dbz = v[k] - v[j], v[s + k] - v[s + j], v[t + k] - v[t + j]
    dcx, dcy, dcz = v[k] - v[l], v[s + k] - v[s + l], v[t + k] - v[t + l]

    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    dmx = day * bz - daz * by + ay * dbz - az * dby
    dmy = daz * bx - dax * bz + az * dbx - ax * dbz
    dmz = dax * by - day * bx + ax * dby - ay * dbx
    dnx = dby * cz - dbz * cy + by * dcz - bz * dcy
    dny = dbz * cx - dbx * cz + bz * dcx - bx * dcz
    dnz = dbx * cy - dby * cx + bx * dcy - by * dcx

    bb = bx * bx + by * by + bz * bz
    half_dbb = bx * dbx + by * dby + bz * dbz
    mm = mx * mx + my * my + mz * mz
    nn = nx * nx + ny * ny + nz * nz
    crease = math.sqrt(bb)
    f, g = crease / mm, -crease / nn
    df = f * (half_dbb / bb - 2.0 * (mx * dmx + my * dmy + mz * dmz) / mm)
    dg = g * (half_dbb / bb - 2.0 * (nx * dnx + ny * dny + nz * dnz) / nn)
    p = (ax * bx + ay * by + az * bz) / bb
    q = (cx * bx + cy * by + cz * bz) / bb
    dp = (dax * bx + day * by + daz * bz + ax * dbx + ay * dby + az * dbz) / bb
    dq = (dcx * bx + dcy * by + dcz * bz + cx * dbx + cy * dby + cz * dbz) / bb
    dp -= 2.0 * p * half_dbb / bb
    dq -= 2.0 * q * half_dbb / bb

    ux, uy, uz = dax - p * dbx, day - p * dby, daz - p * dbz
    wx, wy, wz = q * dbx - dcx, q * dby - dcy, q * dbz - dcz
    first = df * (mx * ux + my * uy + mz * uz) + dg * (nx * wx + ny * wy + nz * wz)
    second = f * (dmx * ux + dmy * uy + dmz * uz) + g * (dnx * wx + dny * wy + dnz * wz)
    third = g * dq * (nx * dbx + ny * dby + nz * dbz) - f * dp * (mx * dbx + my * dby + mz * dbz)
    return first + second + third


@jit
def hinge_corner(parts: tuple[float, ...], corner: Reals) -> None:
    """Set `corner` (4, 3) to the gradient at j, k, i, l [rad/m], from `hinge_parts`."""
    _, ix, iy, iz, lx, ly, lz, p, q = parts
    corner[2, 0], corner[2, 1], corner[2, 2] = ix, iy, iz
    corner[3, 0], corner[3, 1], corner[3, 2] = lx, ly, lz
    for a in range(3):
        wing_i, wing_l = corner[2, a], corner[3, a]
        corner[0, a] = (p - 1.0) * wing_i - q * wing_l
        corner[1, a] = (q - 1.0) * wing_l - p * wing_i
