"""The compiled step of openprc up to 0.1.1, on plain arrays in scaled units.

With the acceleration a(x, v) and the step h it is::

    a1 = a(x, v)
    a2 = a(x + h v / 2, v + h a1 / 2)
    a3 = a(x + h v / 2, v + h a2 / 2)
    a4 = a(x + h v, v + h a3)
    x' = x + h v
    v' = v + h (a1 + 2 a2 + 2 a3 + a4) / 6

A fourth-order Runge-Kutta scheme would take the velocities of its stages for the positions,
too. As it is, positions advance by Euler's explicit rule, and an undamped mode of angular
frequency w is multiplied by sqrt(1 + (h w)^2 / 2) in every step.

The sign of a hinge angle is that of a triple product, which is nothing but rounding while the
hinge is exactly flat, and the softened arc cosine keeps the moment there away from zero. Runs with
such hinges have depended on the processor ever since: with and without fused multiply-add the
positions of a Miura sheet whose panels start flat differ by 4e-7 m.
"""

# ruff: noqa: ANN001, ANN202 - numba compiles by the types of the arguments

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import entry, jit
from openprc.demlat.models.barhinge.tables import BARS, DRAG, WORK_IN

#: Added to squared lengths and areas, in scaled units.
SOFTENING = 1e-12
#: Tensions stay within this, in scaled units.
MOST_TENSION = 1e6
#: Squared areas in the gradient of a hinge angle are taken for at least this.
LEAST_SQUARE = 1e-8


@jit
def _length(a: float, b: float, c: float) -> float:
    return math.sqrt(a * a + b * b + c * c + SOFTENING)


@jit
def copy(source: Any, target: Any) -> None:
    """Copy vectors of nodes."""
    for n in range(source.shape[0]):
        for a in range(3):
            target[n, a] = source[n, a]


@jit
def add_bars(body: Any, x: Any, v: Any, force: Any) -> float:
    """Add the forces of bars on all nodes; return the power that dashpots take."""
    lost = 0.0
    for e in range(body.ends.shape[0]):
        i, j = body.ends[e, 0], body.ends[e, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = _length(dx, dy, dz)
        nx, ny, nz = dx / length, dy / length, dz / length
        rate = (v[j, 0] - v[i, 0]) * nx + (v[j, 1] - v[i, 1]) * ny + (v[j, 2] - v[i, 2]) * nz
        tension = body.stiffness[e] * (length - body.relaxed[e]) + body.damping[e] * rate
        tension = max(-MOST_TENSION, min(tension, MOST_TENSION))
        lost += body.damping[e] * rate * rate
        force[i, 0] += tension * nx
        force[i, 1] += tension * ny
        force[i, 2] += tension * nz
        force[j, 0] -= tension * nx
        force[j, 1] -= tension * ny
        force[j, 2] -= tension * nz
    return lost


@jit
def add_hinges(body: Any, x: Any, force: Any) -> None:
    """Add the forces of hinges on all nodes.

    The angle is an arc cosine, which the softening keeps about 1e-6 away from flat.
    """
    for e in range(body.folds.shape[0]):
        j, k = body.folds[e, 0], body.folds[e, 1]
        i, l = body.folds[e, 2], body.folds[e, 3]  # noqa: E741  the name of the literature
        ax, ay, az = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
        bx, by, bz = x[k, 0] - x[j, 0], x[k, 1] - x[j, 1], x[k, 2] - x[j, 2]
        cx, cy, cz = x[k, 0] - x[l, 0], x[k, 1] - x[l, 1], x[k, 2] - x[l, 2]
        mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        m, n, crease = _length(mx, my, mz), _length(nx, ny, nz), _length(bx, by, bz)
        cosine = (mx * nx + my * ny + mz * nz) / (m * n)
        angle = math.acos(max(-1.0, min(cosine, 1.0)))
        if mx * cx + my * cy + mz * cz < 0.0:
            angle = -angle
        change = angle - body.rest_angle[e]
        # Once each way, as it was: rest angles may be up to 2 pi.
        if change > math.pi:
            change -= 2.0 * math.pi
        if change < -math.pi:
            change += 2.0 * math.pi
        moment = -body.fold_stiffness[e] * change
        on_i = moment * crease / max(m * m, LEAST_SQUARE)
        on_l = -moment * crease / max(n * n, LEAST_SQUARE)
        p = (ax * bx + ay * by + az * bz) / (crease * crease)
        q = (cx * bx + cy * by + cz * bz) / (crease * crease)
        ix, iy, iz = on_i * mx, on_i * my, on_i * mz
        lx, ly, lz = on_l * nx, on_l * ny, on_l * nz
        force[i, 0] += ix
        force[i, 1] += iy
        force[i, 2] += iz
        force[l, 0] += lx
        force[l, 1] += ly
        force[l, 2] += lz
        force[j, 0] += (p - 1.0) * ix - q * lx
        force[j, 1] += (p - 1.0) * iy - q * ly
        force[j, 2] += (p - 1.0) * iz - q * lz
        force[k, 0] += (q - 1.0) * lx - p * ix
        force[k, 1] += (q - 1.0) * ly - p * iy
        force[k, 2] += (q - 1.0) * lz - p * iz


@jit
def find_forces(body: Any, x: Any, v: Any, rows: Any, force: Any) -> float:
    """Set forces of elements, actuators and weight on all nodes; return the dashpots' power."""
    for n in range(force.shape[0]):
        for a in range(3):
            force[n, a] = 0.0
    lost = add_bars(body, x, v, force)
    add_hinges(body, x, force)
    for p in range(body.pushed.size):
        row = rows[body.pushed_by[p]]
        for a in range(3):
            force[body.pushed[p], a] += body.samples[row, a]
    for n in range(body.mass.size):
        force[n, 2] += body.mass[n] * body.gravity
    return lost


@jit
def stage(body: Any, state: Any, number: int, h: float) -> None:
    """Add the acceleration to the weighted sum, and make the state of the next stage."""
    x, v = state.x, state.v
    weight = 2.0 if number == 1 or number == 2 else 1.0
    ahead = 0.5 * h if number < 2 else h
    for n in range(body.mass.size):
        inverse = 1.0 / body.mass[n] if body.mass[n] > 0.0 else 0.0
        for a in range(3):
            if number == 0:
                state.total[n, a] = 0.0
            if body.free[n]:
                drag = body.drag * body.mass[n] * state.v_stage[n, a]
                pull = (state.force[n, a] - drag) * inverse
                state.total[n, a] += weight * pull
                state.x_stage[n, a] = x[n, a] + ahead * v[n, a]
                state.v_stage[n, a] = v[n, a] + ahead * pull


@jit
def place(body: Any, state: Any, rows: Any, h: float) -> float:
    """Move driven nodes to their signals; return the change of their kinetic energy."""
    change = 0.0
    for p in range(body.moved.size):
        n, row = body.moved[p], rows[body.moved_by[p]]
        for a in range(3):
            target = body.samples[row, a]
            before = state.v[n, a]
            state.jump[n, a] = target - state.x[n, a]
            state.v[n, a] = state.jump[n, a] / h
            state.x[n, a] = target
            change += 0.5 * body.mass[n] * (state.v[n, a] ** 2 - before**2)
    return change


@jit
def begin_step(body: Any, state: Any, rows: Any, h: float, first: bool) -> float:
    """Place driven nodes and find the forces; return the power of the dashpots.

    The work of the displacement is booked, but for the one that starts the run.
    """
    kinetic = place(body, state, rows, h)
    copy(state.x, state.x_stage)
    copy(state.v, state.v_stage)
    lost = find_forces(body, state.x, state.v, rows, state.force)
    if not first:
        state.ledger[WORK_IN] += kinetic
        for p in range(body.moved.size):
            n = body.moved[p]
            for a in range(3):
                state.ledger[WORK_IN] -= state.force[n, a] * state.jump[n, a]
    return lost


@jit
def finish_step(body: Any, state: Any, rows: Any, h: float, lost: float) -> None:
    """Advance the free nodes; driven ones stay where they are."""
    x, v, ledger = state.x, state.v, state.ledger
    ledger[BARS] += h * lost
    for n in range(body.mass.size):
        if body.free[n]:
            square = v[n, 0] ** 2 + v[n, 1] ** 2 + v[n, 2] ** 2
            ledger[DRAG] += h * body.drag * body.mass[n] * square
    for p in range(body.pushed.size):
        n, row = body.pushed[p], rows[body.pushed_by[p]]
        if body.free[n]:
            for a in range(3):
                ledger[WORK_IN] += h * body.samples[row, a] * v[n, a]
    # One place where forces are found, in a loop: it compiles in half the time.
    for number in range(4):
        if number > 0:
            find_forces(body, state.x_stage, state.v_stage, rows, state.force)
        stage(body, state, number, h)
    for n in range(body.mass.size):
        if body.free[n]:
            for a in range(3):
                x[n, a] += h * v[n, a]
                v[n, a] += h / 6.0 * state.total[n, a]


@jit
def escaped_node(x: Any, limit: float) -> int:
    """Return the first node with a coordinate beyond the limit, or NaN; else -1."""
    for n in range(x.shape[0]):
        for a in range(3):
            if not abs(x[n, a]) <= limit:
                return n
    return -1


@entry
def advance(stamp: int) -> Any:
    """``advance(body, state, rows, h, steps_per_frame, first, limit, x, v, ledger)``.

    Save frames, beginning with the present one, and take `steps_per_frame` steps after each.
    A frame is saved when driven nodes have been placed and free nodes have not moved on.

    Parameters
    ----------
    rows : (B * steps_per_frame, C) i8
        Samples in force.
    first : bool
        Whether the run begins here.
    x, v, ledger : (B, N, 3), (B, N, 3), (B, 5)
        Get the frames.

    Returns
    -------
    int, int
        Frames saved, and the node that left the plausible range, or -1.
    """

    def advance(body, state, rows, h, steps_per_frame, first, limit, x, v, ledger):
        _ = stamp
        for frame in range(x.shape[0]):
            for s in range(steps_per_frame):
                step = frame * steps_per_frame + s
                lost = begin_step(body, state, rows[step], h, first and step == 0)
                if s == 0:
                    escaped = escaped_node(state.x, limit)
                    if escaped >= 0:
                        return frame, escaped
                    copy(state.x, x[frame])
                    copy(state.v, v[frame])
                    for kind in range(state.ledger.size):
                        ledger[frame, kind] = state.ledger[kind]
                finish_step(body, state, rows[step], h, lost)
        return x.shape[0], -1

    return advance
