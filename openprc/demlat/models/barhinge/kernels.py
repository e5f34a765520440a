"""The force laws, compiled and assembled over all elements.

Plain loops in a fixed order: the same input gives the same bits on every run. Division by
zero gives infinities (no Python exceptions inside the loop), which the integrator reports.
"""

from __future__ import annotations

import math

import numba  # noqa: TID253 - compiling is what this file is for

from openprc.demlat.models.barhinge import laws
from openprc.demlat.models.barhinge.tables import BarTable, Drives, HingeTable, NodeTable, Reals
from openprc.demlat.signals import SignalTable

jit = numba.njit(error_model="numpy")

bar_force = jit(laws.bar_force)
bar_energy = jit(laws.bar_energy)
wrap_angle = jit(laws.wrap_angle)
bend_angle = jit(laws.bend_angle)
hinge_moment = jit(laws.hinge_moment)
hinge_energy = jit(laws.hinge_energy)
first_segment = jit(laws.first_segment)
last_segment = jit(laws.last_segment)
linear_value = jit(laws.linear_value)
cubic_value = jit(laws.cubic_value)
cubic_rate = jit(laws.cubic_rate)

HOLD, CUBIC = laws.HOLD, laws.CUBIC


# --- signals ------------------------------------------------------------------------------


@jit
def signal_at(
    table: SignalTable, signal: int, axis: int, t: float, t_from: float, t_to: float
) -> tuple[float, float]:
    """Return value and rate of a signal at `t`, as seen from within the step [t_from, t_to].

    The segment is confined to those that the step touches, so a stage at the end of a step
    uses the value from before a jump (or kink) that lies exactly there. Without that, every
    held symbol would cost the scheme its order.
    """
    dt = table.dt[signal]
    first = max(first_segment(t_from, dt), 0)
    last = max(last_segment(t_to, dt), first)
    segment = min(max(math.floor(t / dt), first), last)
    row = table.start[signal]
    end = table.count[signal] - 1
    if segment >= end:
        return table.values[row + end, axis], 0.0
    row += segment
    left = table.values[row, axis]
    if table.kind[signal] == HOLD:
        return left, 0.0
    right = table.values[row + 1, axis]
    s = t / dt - segment
    if table.kind[signal] == CUBIC:
        m0, m1 = table.slopes[row, axis], table.slopes[row + 1, axis]
        return cubic_value(s, left, right, m0, m1), cubic_rate(s, left, right, m0, m1) / dt
    return linear_value(s, left, right), (right - left) / dt


@jit
def place_driven(
    x: Reals,
    v: Reals,
    drives: Drives,
    table: SignalTable,
    t: float,
    t_from: float,
    t_to: float,
) -> None:
    """Put position-driven axes where their signals say, with the signals' rates."""
    for d in range(drives.position_node.size):
        node, axis = drives.position_node[d], drives.position_axis[d]
        x[node, axis], v[node, axis] = signal_at(
            table, drives.position_signal[d], axis, t, t_from, t_to
        )


@jit
def jumps_at(x: Reals, drives: Drives, table: SignalTable, t: float, t_to: float) -> bool:
    """Say whether a held signal is about to move a driven axis at once."""
    for d in range(drives.position_node.size):
        signal = drives.position_signal[d]
        if table.kind[signal] == HOLD:
            axis = drives.position_axis[d]
            if signal_at(table, signal, axis, t, t, t_to)[0] != x[drives.position_node[d], axis]:
                return True
    return False


@jit
def add_actuator_forces(
    v: Reals,
    force: Reals,
    drives: Drives,
    table: SignalTable,
    t: float,
    t_from: float,
    t_to: float,
) -> float:
    """Add the actuators' forces to `force` [N] and return their power [W]."""
    power = 0.0
    for d in range(drives.force_node.size):
        node, axis = drives.force_node[d], drives.force_axis[d]
        value, _ = signal_at(table, drives.force_signal[d], axis, t, t_from, t_to)
        force[node, axis] += value
        power += value * v[node, axis]
    return power


# --- elements -----------------------------------------------------------------------------


@jit
def add_node_forces(v: Reals, force: Reals, nodes: NodeTable) -> float:
    """Set `force` to weight and drag of every node; return the dissipated power [W]."""
    dissipated = 0.0
    for i in range(nodes.mass.size):
        drag = nodes.drag[i]
        for a in range(3):
            force[i, a] = nodes.weight[i, a] - drag * v[i, a]
            dissipated += drag * v[i, a] * v[i, a]
    return dissipated


@jit
def add_bar_forces(x: Reals, v: Reals, force: Reals, bars: BarTable) -> float:
    """Add the forces of all bars to `force` [N]; return the dissipated power [W]."""
    dissipated = 0.0
    for e in range(bars.i.size):
        i, j = bars.i[e], bars.j[e]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0.0:
            continue  # no direction: a spring of rest length 0 is relaxed here anyway
        rate = (
            dx * (v[j, 0] - v[i, 0]) + dy * (v[j, 1] - v[i, 1]) + dz * (v[j, 2] - v[i, 2])
        ) / length
        tension = bar_force(length, rate, bars.stiffness[e], bars.relaxed[e], bars.damping[e])
        scale = tension / length
        force[i, 0] += scale * dx
        force[i, 1] += scale * dy
        force[i, 2] += scale * dz
        force[j, 0] -= scale * dx
        force[j, 1] -= scale * dy
        force[j, 2] -= scale * dz
        dissipated += bars.damping[e] * rate * rate
    return dissipated


@jit
def hinge_frame(
    x: Reals,
    j: int,
    k: int,
    i: int,
    l: int,  # noqa: E741  the names of the literature
) -> tuple[float, ...]:
    """Return the bend of a hinge and what its gradient is made of.

    Returns
    -------
    bend [rad]; gradient at wing i (3), at wing l (3) [rad/m]; and the fractions p and q at
    which the wings stand along the crease, so that the gradients at the crease are
    ``g_j = (p - 1) g_i - q g_l`` and ``g_k = (q - 1) g_l - p g_i``
    (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, after Blondel & Karplus 1996).
    """
    ax, ay, az = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
    bx, by, bz = x[k, 0] - x[j, 0], x[k, 1] - x[j, 1], x[k, 2] - x[j, 2]
    cx, cy, cz = x[k, 0] - x[l, 0], x[k, 1] - x[l, 1], x[k, 2] - x[l, 2]
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    bb = bx * bx + by * by + bz * bz
    crease = math.sqrt(bb)
    mm = mx * mx + my * my + mz * mz
    nn = nx * nx + ny * ny + nz * nz
    bend = bend_angle(crease, nx * ax + ny * ay + nz * az, mx * nx + my * ny + mz * nz)
    si, sl = crease / mm, -crease / nn
    p = (ax * bx + ay * by + az * bz) / bb
    q = (cx * bx + cy * by + cz * bz) / bb
    return bend, si * mx, si * my, si * mz, sl * nx, sl * ny, sl * nz, p, q


@jit
def add_hinge_forces(x: Reals, v: Reals, force: Reals, hinges: HingeTable) -> float:
    """Add the forces ``-M dtheta/dx`` of all hinges to `force` [N]; return the loss [W]."""
    dissipated = 0.0
    for e in range(hinges.j.size):
        j, k, i, l = hinges.j[e], hinges.k[e], hinges.i[e], hinges.l[e]  # noqa: E741
        bend, ix, iy, iz, lx, ly, lz, p, q = hinge_frame(x, j, k, i, l)
        jx, jy, jz = (p - 1.0) * ix - q * lx, (p - 1.0) * iy - q * ly, (p - 1.0) * iz - q * lz
        kx, ky, kz = (q - 1.0) * lx - p * ix, (q - 1.0) * ly - p * iy, (q - 1.0) * lz - p * iz
        damping = hinges.damping[e]
        rate = 0.0
        if damping != 0.0:
            rate = (
                (ix * v[i, 0] + iy * v[i, 1] + iz * v[i, 2])
                + (jx * v[j, 0] + jy * v[j, 1] + jz * v[j, 2])
                + (kx * v[k, 0] + ky * v[k, 1] + kz * v[k, 2])
                + (lx * v[l, 0] + ly * v[l, 1] + lz * v[l, 2])
            )
        difference = wrap_angle(bend - hinges.rest_bend[e])
        moment = hinge_moment(difference, rate, hinges.stiffness[e], damping)
        force[i, 0] -= moment * ix
        force[i, 1] -= moment * iy
        force[i, 2] -= moment * iz
        force[l, 0] -= moment * lx
        force[l, 1] -= moment * ly
        force[l, 2] -= moment * lz
        force[j, 0] -= moment * jx
        force[j, 1] -= moment * jy
        force[j, 2] -= moment * jz
        force[k, 0] -= moment * kx
        force[k, 1] -= moment * ky
        force[k, 2] -= moment * kz
        dissipated += damping * rate * rate
    return dissipated


@jit
def body_forces(
    x: Reals,
    v: Reals,
    force: Reals,
    nodes: NodeTable,
    bars: BarTable,
    hinges: HingeTable,
) -> float:
    """Set `force` (N, 3) [N] to everything but the actuators; return the dissipated power [W]."""
    dissipated = add_node_forces(v, force, nodes)
    dissipated += add_bar_forces(x, v, force, bars)
    dissipated += add_hinge_forces(x, v, force, hinges)
    return dissipated


# --- energies -----------------------------------------------------------------------------


@jit
def potential_energy(x: Reals, nodes: NodeTable, bars: BarTable, hinges: HingeTable) -> float:
    """Return elastic energy plus ``-m g.x`` of every node [J]."""
    energy = 0.0
    for i in range(nodes.mass.size):
        for a in range(3):
            energy -= nodes.weight[i, a] * x[i, a]
    for e in range(bars.i.size):
        i, j = bars.i[e], bars.j[e]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        energy += bar_energy(length, bars.stiffness[e], bars.relaxed[e])
    for e in range(hinges.j.size):
        frame = hinge_frame(x, hinges.j[e], hinges.k[e], hinges.i[e], hinges.l[e])
        difference = wrap_angle(frame[0] - hinges.rest_bend[e])
        energy += hinge_energy(difference, hinges.stiffness[e])
    return energy


@jit
def kinetic_energy(v: Reals, nodes: NodeTable, driven_only: bool) -> float:
    """Return the kinetic energy [J] of all axes, or of those that are position-driven."""
    energy = 0.0
    for i in range(nodes.mass.size):
        for a in range(3):
            if not driven_only or nodes.driven[i, a]:
                energy += 0.5 * nodes.mass[i] * v[i, a] * v[i, a]
    return energy
