"""Rigid bars and rigid hinges as constraints ``C(x) = 0``, compiled.

State is flat: axis a of node i is element ``a * stride + i`` of `x`, `v` and `inverse_mass`,
all of length ``3 * stride``. The inverse mass is 0 on held axes (fixed or driven). Their
positions and velocities take part in the constraints and are never changed by them.

A bar is ``C = (|d|^2 - l0^2) / (2 l0)`` with ``d = x_j - x_i``: to first order ``|d| - l0``,
with the same direction and with a multiplier that is the axial force where C = 0, yet without
a square root, so the gradient ``d / l0`` is linear in x and its rate ``|d'|^2 / l0`` exact. A
hinge is ``C = wrap(bend - rest)``. A multiplier acts as the generalised force
``+ multiplier * dC/dx``: positive means a strut, or a hinge held open.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from openprc.demlat.compiled.jit import jit
from openprc.demlat.linear.ldl import clear, factorise, solve
from openprc.demlat.linear.symbolic import Factor, Index, Integers, Reals
from openprc.demlat.models.barhinge.constraint_kinematics import (
    bar_value,
    hinge_bend_second,
    hinge_corner,
    hinge_parts,
    wrap_angle,
)


class ConstraintTable(NamedTuple):
    """B rigid bars, then H rigid hinges: ``R = B + H`` rows; and S hinges with stops.

    Attributes
    ----------
    stride : int
        Distance between the axes of one node in the flat state.
    node : (2 B + 4 H,)
        Nodes i, j of each bar, then j, k, i, l of each hinge (crease first): the blocks.
    length : (B,) [m]
        Of the bars.
    rest_bend : (H,) [rad]
        Rest angle minus pi.
    stop_node : (4 S,)
        Nodes j, k, i, l of each hinge with stops.
    stop_low, stop_high : (S,) [rad]
        Between which bends.
    pair_first, pair_second, pair_target : (P,)
        Blocks that meet at a node, and where their product goes in the factor's values.
    """

    stride: int
    node: Index
    length: Reals
    rest_bend: Reals
    stop_node: Index
    stop_low: Reals
    stop_high: Reals
    pair_first: Index
    pair_second: Index
    pair_target: Integers


class ConstraintWork(NamedTuple):
    """What the constraints compute; made once.

    Attributes
    ----------
    value : (R,) [m] or [rad]
        C at the last positions seen.
    gradient : (2 B + 4 H, 3) [1] or [rad/m]
        Derivative of C by the positions of each block, at the positions of `gradients`.
    mobile : (2 B + 4 H, 3) [1/kg]
        `gradient` times the inverse masses.
    right, step, multiplier : (R,)
        Second rates, the solution of the last system, and the sum of the solutions of one
        projection.
    corner : (4, 3)
        Scratch: the gradient of one hinge.
    """

    value: Reals
    gradient: Reals
    mobile: Reals
    right: Reals
    step: Reals
    multiplier: Reals
    corner: Reals

    @classmethod
    def for_table(cls, table: ConstraintTable) -> ConstraintWork:
        """Return scratch for a table."""
        n_rows = table.length.size + table.rest_bend.size
        blocks = np.zeros((table.node.size, 3)), np.zeros((table.node.size, 3))
        columns = (np.zeros(n_rows) for _ in range(3))
        return cls(np.zeros(n_rows), *blocks, *columns, np.zeros((4, 3)))


@jit
def values(x: Reals, table: ConstraintTable, work: ConstraintWork) -> float:
    """Set ``work.value`` and return the largest violation.

    Relative to the length for bars, in radians for hinges; nan where a value is nan.
    """
    node, stride = table.node, table.stride
    n_bars = table.length.size
    largest = 0.0
    broken = False
    for r in range(n_bars):
        value = bar_value(x, stride, node[2 * r], node[2 * r + 1], table.length[r])
        work.value[r] = value
        largest = max(largest, abs(value) / table.length[r])
        broken = broken or value != value
    for h in range(table.rest_bend.size):
        b = 2 * n_bars + 4 * h
        parts = hinge_parts(x, stride, node[b], node[b + 1], node[b + 2], node[b + 3])
        value = wrap_angle(parts[0] - table.rest_bend[h])
        work.value[n_bars + h] = value
        largest = max(largest, abs(value))
        broken = broken or value != value
    return math.nan if broken else largest


@jit
def gradients(x: Reals, inverse_mass: Reals, table: ConstraintTable, work: ConstraintWork) -> None:
    """Set ``work.gradient`` and ``work.mobile``."""
    node, stride, gradient = table.node, table.stride, work.gradient
    n_bars = table.length.size
    for r in range(n_bars):
        i, j = node[2 * r], node[2 * r + 1]
        for a in range(3):
            slope = (x[a * stride + j] - x[a * stride + i]) / table.length[r]
            gradient[2 * r, a] = -slope
            gradient[2 * r + 1, a] = slope
    for h in range(table.rest_bend.size):
        b = 2 * n_bars + 4 * h
        parts = hinge_parts(x, stride, node[b], node[b + 1], node[b + 2], node[b + 3])
        hinge_corner(parts, work.corner)
        for c in range(4):
            for a in range(3):
                gradient[b + c, a] = work.corner[c, a]
    for b in range(node.size):
        for a in range(3):
            work.mobile[b, a] = inverse_mass[a * stride + node[b]] * gradient[b, a]


@jit
def row_start(row: int, n_bars: int) -> int:
    """Return the first block of a row; row R gives the number of blocks."""
    return 2 * row if row < n_bars else 4 * row - 2 * n_bars


@jit
def rates(v: Reals, table: ConstraintTable, work: ConstraintWork, out: Reals) -> float:
    """Set `out` (R,) to ``G v`` and return the largest rate relative to ``|G| |v|``."""
    node, stride, gradient = table.node, table.stride, work.gradient
    n_bars = table.length.size
    largest = 0.0
    broken = False
    for r in range(out.size):
        rate = 0.0
        size = 0.0
        for b in range(row_start(r, n_bars), row_start(r + 1, n_bars)):
            slope2 = 0.0
            speed2 = 0.0
            for a in range(3):
                slope, speed = gradient[b, a], v[a * stride + node[b]]
                rate += slope * speed
                slope2 += slope * slope
                speed2 += speed * speed
            size += math.sqrt(slope2 * speed2)
        out[r] = rate
        if size > 0.0:
            largest = max(largest, abs(rate) / size)
        broken = broken or rate != rate
    return math.nan if broken else largest


@jit
def push(
    target: Reals, multiplier: Reals, scale: float, table: ConstraintTable, work: ConstraintWork
) -> None:
    """Add ``scale * M^-1 G^T multiplier`` to `target` (3 * stride): to x, v or accelerations."""
    node, stride, mobile = table.node, table.stride, work.mobile
    n_bars = table.length.size
    for r in range(multiplier.size):
        amount = scale * multiplier[r]
        for b in range(row_start(r, n_bars), row_start(r + 1, n_bars)):
            for a in range(3):
                target[a * stride + node[b]] += amount * mobile[b, a]


@jit
def add_forces(
    force: Reals, multiplier: Reals, scale: float, table: ConstraintTable, work: ConstraintWork
) -> None:
    """Add ``scale * G^T multiplier`` [N] to `force` (3 * stride), on held axes as well."""
    node, stride, gradient = table.node, table.stride, work.gradient
    n_bars = table.length.size
    for r in range(multiplier.size):
        amount = scale * multiplier[r]
        for b in range(row_start(r, n_bars), row_start(r + 1, n_bars)):
            for a in range(3):
                force[a * stride + node[b]] += amount * gradient[b, a]


@jit
def assemble(table: ConstraintTable, work: ConstraintWork, factor: Factor) -> None:
    """Set the factor's matrix to ``G M^-1 G^T`` of the last `gradients`."""
    clear(factor)
    gradient, mobile = work.gradient, work.mobile
    for p in range(table.pair_target.size):
        b, c = table.pair_first[p], table.pair_second[p]
        factor.values[table.pair_target[p]] += (
            gradient[b, 0] * mobile[c, 0]
            + gradient[b, 1] * mobile[c, 1]
            + gradient[b, 2] * mobile[c, 2]
        )


@jit
def prepare(
    x: Reals,
    inverse_mass: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    factor: Factor,
    pivot_tolerance: float,
) -> int:
    """Take directions at `x` and factorise; return the number of dependent rows there."""
    gradients(x, inverse_mass, table, work)
    assemble(table, work, factor)
    return factorise(factor, pivot_tolerance)[0]


#: Violation below which an iteration that no longer gains has reached rounding.
ROUNDING_FLOOR = 1e-10


@jit
def project_positions(
    x: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    factor: Factor,
    tolerance: float,
    max_iterations: int,
) -> tuple[int, float]:
    """Move `x` onto the constraints along the directions of the last `prepare`.

    ``x += M^-1 G_ref^T mu`` with simplified Newton steps on ``C(x) = 0``. With directions
    from the start of the step this is the position stage of SHAKE and RATTLE (Ryckaert,
    Ciccotti & Berendsen 1977, doi:10.1016/0021-9991(77)90098-5; Andersen 1983,
    doi:10.1016/0021-9991(83)90014-1). ``work.multiplier`` gets the sum of mu: an impulse in a
    step of h is ``mu / h``.

    Returns
    -------
    iterations : int
    residual : float [1]
        As `values` returns it. Compare it with the tolerance: it is larger when
        `max_iterations` were not enough or rounding stops further gain.
    """
    for r in range(work.multiplier.size):
        work.multiplier[r] = 0.0
    residual = values(x, table, work)
    iterations = 0
    while residual > tolerance and iterations < max_iterations:
        for r in range(work.step.size):
            work.step[r] = -work.value[r]
        solve(factor, work.step)
        push(x, work.step, 1.0, table, work)
        for r in range(work.step.size):
            work.multiplier[r] += work.step[r]
        iterations += 1
        before = residual
        residual = values(x, table, work)
        if residual > 0.5 * before and before < ROUNDING_FLOOR:
            break
    return iterations, residual


@jit
def newton_positions(
    x: Reals,
    inverse_mass: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    factor: Factor,
    pivot_tolerance: float,
    tolerance: float,
    max_iterations: int,
) -> tuple[int, float]:
    """Move `x` onto the constraints with directions renewed in every step.

    Full Newton steps, for larger gaps; the sum of multipliers has no meaning then. Returns as
    `project_positions` does.
    """
    residual = values(x, table, work)
    iterations = 0
    while residual > tolerance and iterations < max_iterations:
        prepare(x, inverse_mass, table, work, factor, pivot_tolerance)
        for r in range(work.step.size):
            work.step[r] = -work.value[r]
        solve(factor, work.step)
        push(x, work.step, 1.0, table, work)
        iterations += 1
        before = residual
        residual = values(x, table, work)
        if residual > 0.5 * before and before < ROUNDING_FLOOR:
            break
    return iterations, residual


@jit
def project_velocities(
    v: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    factor: Factor,
    tolerance: float,
    max_iterations: int,
) -> tuple[int, float]:
    """Take from `v` what would break the constraints: ``G v = 0`` after the last `prepare`.

    Held axes count with the velocities they have in `v`, so driven nodes pull the others
    along. ``work.multiplier`` gets the impulses. One iteration solves the linear problem;
    more take rounding away.

    Returns
    -------
    iterations : int
    residual : float [1]
        Largest ``|G v|`` relative to ``|G| |v|``.
    """
    for r in range(work.multiplier.size):
        work.multiplier[r] = 0.0
    residual = rates(v, table, work, work.step)
    iterations = 0
    while residual > tolerance and iterations < max_iterations:
        for r in range(work.step.size):
            work.step[r] = -work.step[r]
        solve(factor, work.step)
        push(v, work.step, 1.0, table, work)
        for r in range(work.step.size):
            work.multiplier[r] += work.step[r]
        iterations += 1
        residual = rates(v, table, work, work.step)
    return iterations, residual


@jit
def second_rates(x: Reals, v: Reals, table: ConstraintTable, out: Reals) -> None:
    """Set `out` (R,) to the second derivatives of C along straight motion ``x + t v``."""
    node, stride = table.node, table.stride
    n_bars = table.length.size
    for r in range(n_bars):
        i, j = node[2 * r], node[2 * r + 1]
        total = 0.0
        for a in range(3):
            speed = v[a * stride + j] - v[a * stride + i]
            total += speed * speed
        out[r] = total / table.length[r]
    for h in range(table.rest_bend.size):
        b = 2 * n_bars + 4 * h
        out[n_bars + h] = hinge_bend_second(
            x, v, stride, node[b], node[b + 1], node[b + 2], node[b + 3]
        )


@jit
def multipliers(
    x: Reals,
    v: Reals,
    acceleration: Reals,
    table: ConstraintTable,
    work: ConstraintWork,
    factor: Factor,
) -> None:
    """Set ``work.multiplier`` [N] or [N m] to what keeps ``C'' = 0``: the index-1 form.

    ``G M^-1 G^T lambda = -(G a + v.C_xx.v)`` after `prepare` at the same `x` (Hairer & Wanner,
    Solving Ordinary Differential Equations II, sec. VII.1, doi:10.1007/978-3-642-05221-7).
    Follow with ``push(acceleration, work.multiplier, 1.0, ...)`` or `add_forces`.

    Parameters
    ----------
    acceleration : (3 * stride,) [m/s2]
        Of free axes without the constraints, ``M^-1 f``; of held axes the prescribed one.
    """
    second_rates(x, v, table, work.right)
    rates(acceleration, table, work, work.step)
    for r in range(work.step.size):
        work.multiplier[r] = -(work.step[r] + work.right[r])
    solve(factor, work.multiplier)
