"""Constraints one after the other until none is violated, compiled; and stops of hinges.

This is position-based dynamics without compliance (Müller et al. 2007,
doi:10.1016/j.jvcir.2007.01.005), swept to a tolerance instead of a fixed number of times. It
converges like Gauss-Seidel does: a network of rigid bars takes thousands of sweeps where
`constraints.project_positions` takes a few solves. It stays usable where that one does not,
because inequalities need no active set: stops push back while they are overrun, and not else.
"""

from __future__ import annotations

import math

from openprc.demlat.compiled.jit import jit
from openprc.demlat.linear.symbolic import Index, Reals
from openprc.demlat.models.barhinge.constraint_kinematics import (
    bar_value,
    hinge_corner,
    hinge_parts,
    wrap_angle,
)
from openprc.demlat.models.barhinge.constraints import (
    ConstraintTable,
    ConstraintWork,
    row_start,
    values,
)

#: A hinge this close to its stop [rad] rests on it.
STOP_SLACK = 1e-9


@jit
def stop_value(bend: float, low: float, high: float) -> float:
    """Return by how much a bend is below (negative) or above (positive) its stops [rad]."""
    if bend < low:
        return bend - low
    if bend > high:
        return bend - high
    return 0.0


@jit
def violation(x: Reals, table: ConstraintTable, work: ConstraintWork) -> float:
    """Set ``work.value``; return the largest violation as `values` does, stops included."""
    largest = values(x, table, work)
    node = table.stop_node
    for s in range(table.stop_low.size):
        b = 4 * s
        parts = hinge_parts(x, table.stride, node[b], node[b + 1], node[b + 2], node[b + 3])
        over = abs(stop_value(parts[0], table.stop_low[s], table.stop_high[s]))
        if over > largest or over != over:
            largest = over
    return largest


@jit
def move_bar(
    x: Reals, inverse_mass: Reals, i: int, j: int, stride: int, value: float, length: float
) -> None:
    """Move two nodes along their bar by what takes `value` to zero, to first order."""
    weight = 0.0
    for a in range(3):
        slope = (x[a * stride + j] - x[a * stride + i]) / length
        weight += (inverse_mass[a * stride + i] + inverse_mass[a * stride + j]) * slope * slope
    if weight > 0.0:
        amount = -value / (weight * length)
        for a in range(3):
            along = amount * (x[a * stride + j] - x[a * stride + i])
            x[a * stride + i] -= inverse_mass[a * stride + i] * along
            x[a * stride + j] += inverse_mass[a * stride + j] * along


@jit
def move_corner(
    target: Reals,
    inverse_mass: Reals,
    corner: Reals,
    node: Index,
    first: int,
    stride: int,
    value: float,
) -> None:
    """Move the four nodes of a hinge against `value`: along M^-1 times its gradient."""
    weight = 0.0
    for c in range(4):
        for a in range(3):
            slope = corner[c, a]
            weight += inverse_mass[a * stride + node[first + c]] * slope * slope
    if weight > 0.0:
        for c in range(4):
            for a in range(3):
                d = a * stride + node[first + c]
                target[d] -= value / weight * inverse_mass[d] * corner[c, a]


@jit
def gauss_seidel(
    x: Reals,
    inverse_mass: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    tolerance: float,
    max_sweeps: int,
) -> tuple[int, float]:
    """Move `x` onto the constraints and inside the stops, element by element.

    Returns
    -------
    sweeps : int
    residual : float
        What `violation` returns at the end; larger than the tolerance when `max_sweeps` were
        not enough.
    """
    node, stride = table.node, table.stride
    n_bars = table.length.size
    residual = violation(x, table, work)
    sweeps = 0
    while residual > tolerance and sweeps < max_sweeps:
        for r in range(n_bars):
            i, j, length = node[2 * r], node[2 * r + 1], table.length[r]
            move_bar(x, inverse_mass, i, j, stride, bar_value(x, stride, i, j, length), length)
        for h in range(table.rest_bend.size):
            b = 2 * n_bars + 4 * h
            parts = hinge_parts(x, stride, node[b], node[b + 1], node[b + 2], node[b + 3])
            hinge_corner(parts, work.corner)
            value = wrap_angle(parts[0] - table.rest_bend[h])
            move_corner(x, inverse_mass, work.corner, node, b, stride, value)
        for s in range(table.stop_low.size):
            b = 4 * s
            stop = table.stop_node
            parts = hinge_parts(x, stride, stop[b], stop[b + 1], stop[b + 2], stop[b + 3])
            value = stop_value(parts[0], table.stop_low[s], table.stop_high[s])
            if value != 0.0:
                hinge_corner(parts, work.corner)
                move_corner(x, inverse_mass, work.corner, stop, b, stride, value)
        sweeps += 1
        residual = violation(x, table, work)
    return sweeps, residual


@jit
def block_rate(
    v: Reals, slopes: Reals, node: Index, first: int, last: int, offset: int, stride: int
) -> tuple[float, float]:
    """Return a constraint's rate over its blocks, and the size it is to be judged by."""
    rate = 0.0
    size = 0.0
    for b in range(first, last):
        slope2 = 0.0
        speed2 = 0.0
        for a in range(3):
            slope, speed = slopes[b - offset, a], v[a * stride + node[b]]
            rate += slope * speed
            slope2 += slope * slope
            speed2 += speed * speed
        size += math.sqrt(slope2 * speed2)
    return rate, size


@jit
def gauss_seidel_velocities(
    x: Reals,
    v: Reals,
    inverse_mass: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    tolerance: float,
    max_sweeps: int,
) -> tuple[int, float]:
    """Take from `v` what would break constraints or drive a hinge further into its stop.

    Call `constraints.gradients` at `x` first. The impact on a stop is without rebound.

    Returns
    -------
    sweeps : int
    residual : float [1]
        Largest rate met in the last sweep, relative to ``|G| |v|``.
    """
    stride, stop = table.stride, table.stop_node
    n_bars = table.length.size
    residual = math.inf
    sweeps = 0
    while residual > tolerance and sweeps < max_sweeps:
        residual = 0.0
        for r in range(work.value.size):
            first, last = row_start(r, n_bars), row_start(r + 1, n_bars)
            rate, size = block_rate(v, work.gradient, table.node, first, last, 0, stride)
            weight = 0.0
            for b in range(first, last):
                for a in range(3):
                    weight += work.gradient[b, a] * work.mobile[b, a]
            if size > 0.0 and weight > 0.0:
                residual = max(residual, abs(rate) / size)
                for b in range(first, last):
                    for a in range(3):
                        v[a * stride + table.node[b]] -= rate / weight * work.mobile[b, a]
        for s in range(table.stop_low.size):
            b = 4 * s
            parts = hinge_parts(x, stride, stop[b], stop[b + 1], stop[b + 2], stop[b + 3])
            at_low = parts[0] <= table.stop_low[s] + STOP_SLACK
            at_high = parts[0] >= table.stop_high[s] - STOP_SLACK
            if at_low or at_high:
                hinge_corner(parts, work.corner)
                rate, size = block_rate(v, work.corner, stop, b, b + 4, b, stride)
                if (at_low and rate < 0.0) or (at_high and rate > 0.0):
                    residual = max(residual, abs(rate) / size)
                    move_corner(v, inverse_mass, work.corner, stop, b, stride, rate)
        sweeps += 1
    return sweeps, residual
