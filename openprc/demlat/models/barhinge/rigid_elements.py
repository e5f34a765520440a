"""Rigid elements in the time loop: what holds between two steps, and what is saved of them.

Between steps, the factor in `RigidElements` is that of ``G M^-1 G^T`` at the state's positions
and the velocities satisfy ``G v = 0``: every scheme for constraints finds it so and leaves it
so. A scene whose scheme knows no constraints has None instead, and all of this compiles away.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.linear.ldl import PIVOT_TOLERANCE
from openprc.demlat.linear.symbolic import Factor, Index, Integers, Reals
from openprc.demlat.models.barhinge import constraints as algebra
from openprc.demlat.models.barhinge import gauss_seidel
from openprc.demlat.models.barhinge.constraint_kinematics import hinge_parts, wrap_angle
from openprc.demlat.models.barhinge.constraints import ConstraintTable, ConstraintWork
from openprc.demlat.models.barhinge.drive_kernels import acceleration as driven_acceleration
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import CONTACT, LEDGER_STRIDE, WORK_IN

#: Solves in one projection of positions, and of velocities.
POSITION_SOLVES = 50
VELOCITY_SOLVES = 3
#: Sweeps over all elements while a hinge is on its stop, and what they have to reach.
SWEEPS, SWEPT = 50_000, 1e-12
#: Violation below which an iteration that rounding has stopped is done all the same.
ROUNDING_FLOOR = algebra.ROUNDING_FLOOR
#: Relative rates of rigid elements above which velocities are not rounded but wrong: a driven
#: node has changed its speed at once.
JUMP = 1e-10
#: Columns of `RigidElements.status`.
FAILED_ROW, RESIDUAL, LARGEST = range(3)


class RigidElements(NamedTuple):
    """The rigid elements of a body.

    Attributes
    ----------
    table : ConstraintTable
    work : ConstraintWork
    factor : Factor
    tolerance : float [1]
        Largest violation, relative to lengths or in radians.
    bar, hinge : (B',), (H',) [element]
        All rigid elements, those that are no rows included, and
    bar_node, hinge_node : (2 B',), (4 H',) [node]
        their nodes.
    stop : (S,) [element]
        Hinges with hard stops.
    row_element : (R,) [element]
        Which bar or hinge a row is.
    pull_row, pull_block, pull_axis : (D,)
        Where rows act on driven coordinates.
    force, acceleration, rates
        Work arrays, as coordinates and as the ledger's powers.
    status : (3,)
        Row (then: stop) that could not be satisfied, -1 for none; its violation; and the
        largest violation that a projection has left so far.
    """

    table: ConstraintTable
    work: ConstraintWork
    factor: Factor
    tolerance: float
    bar: Integers
    hinge: Integers
    bar_node: Index
    hinge_node: Index
    stop: Integers
    row_element: Integers
    pull_row: Integers
    pull_block: Integers
    pull_axis: Integers
    force: Reals
    acceleration: Reals
    rates: Reals
    status: Reals


def is_constrained(body: Any) -> bool:
    """Say, given the numba type of a body, whether its scheme keeps constraints."""
    return not isinstance(body.types[body.fields.index("constraints")], types.NoneType)


# --- projections ----------------------------------------------------------------------------


@jit
def prepare(rigid: Any, body: Any, x: Any) -> None:
    """Take directions at `x` and factorise."""
    algebra.prepare(x, body.inverse_mass, rigid.table, rigid.work, rigid.factor, PIVOT_TOLERANCE)


@jit
def note_violation(rigid: Any, residual: float, out_of_steps: bool) -> None:
    """Remember what a projection left, and that it failed if it did."""
    status = rigid.status
    if residual > status[LARGEST]:
        status[LARGEST] = residual
    bad = not residual <= rigid.tolerance
    if bad and (out_of_steps or not residual <= ROUNDING_FLOOR) and status[FAILED_ROW] < 0.0:
        n_bars = rigid.table.length.size
        worst = 0
        largest = -1.0
        for r in range(rigid.work.value.size):
            size = abs(rigid.work.value[r])
            if r < n_bars:
                size /= rigid.table.length[r]
            if size > largest or size != size:
                worst, largest = r, size
        status[FAILED_ROW] = worst
        status[RESIDUAL] = residual


@jit
def project_positions(rigid: Any, x: Any) -> None:
    """Move `x` onto the constraints along the directions of the last `prepare`."""
    solves, residual = algebra.project_positions(
        x, rigid.table, rigid.work, rigid.factor, rigid.tolerance, POSITION_SOLVES
    )
    note_violation(rigid, residual, solves == POSITION_SOLVES)


@jit
def project_velocities(rigid: Any, v: Any) -> None:
    """Take from `v` what would break the constraints at the positions of the last `prepare`."""
    tolerance = min(rigid.tolerance, JUMP)
    algebra.project_velocities(v, rigid.table, rigid.work, rigid.factor, tolerance, VELOCITY_SOLVES)


@jit
def push(rigid: Any, target: Any, scale: float) -> None:
    """Add `scale` times what the last multipliers do to `target`."""
    algebra.push(target, rigid.work.multiplier, scale, rigid.table, rigid.work)


# --- accelerations --------------------------------------------------------------------------


def place_accelerations(drives: Any, out: Any, t: float, t_from: float, t_to: float) -> None:
    """Set the accelerations of driven coordinates to those of their signals."""


@chosen_by_type(place_accelerations)
def _place_accelerations(drives, out, t, t_from, t_to):
    if isinstance(drives, types.NoneType):
        return lambda drives, out, t, t_from, t_to: None

    def place(drives, out, t, t_from, t_to):
        for d in range(drives.motion_at.size):
            column = drives.motion_signal[d]
            out[drives.motion_at[d]] = driven_acceleration(drives.signals, column, t, t_from, t_to)

    return place


@jit
def solve_multipliers(
    rigid: Any,
    body: Any,
    x: Any,
    v: Any,
    force: Any,
    out: Any,
    t: float,
    t_from: float,
    t_to: float,
) -> None:
    """Set `out` to the accelerations without the constraints, and find the multipliers."""
    for at in range(out.size):
        out[at] = force[at] * body.inverse_mass[at]
    place_accelerations(body.drives, out, t, t_from, t_to)
    algebra.multipliers(x, v, out, rigid.table, rigid.work, rigid.factor)


# --- energy ---------------------------------------------------------------------------------


def book_reactions(rigid: Any, v: Any, ledger: Any, weight: float) -> None:
    """Book `weight` times the power of actuators against the last multipliers as their work.

    Rigid elements do no work but where they end at a driven node.
    """


@chosen_by_type(book_reactions)
def _book_reactions(rigid, v, ledger, weight):
    if isinstance(ledger, types.NoneType):
        return lambda rigid, v, ledger, weight: None

    def book(rigid, v, ledger, weight):
        power = 0.0
        stride, node = rigid.table.stride, rigid.table.node
        for p in range(rigid.pull_row.size):
            b, a = rigid.pull_block[p], rigid.pull_axis[p]
            slope = rigid.work.gradient[b, a]
            power += rigid.work.multiplier[rigid.pull_row[p]] * slope * v[a * stride + node[b]]
        ledger[WORK_IN * LEDGER_STRIDE] -= weight * power

    return book


@jit
def kinetic_energy(body: Any, v: Any) -> float:
    """Return the kinetic energy of the coordinates that are not held."""
    energy = 0.0
    for at in range(v.size):
        if body.inverse_mass[at] > 0.0:
            energy += 0.5 * body.mass[at] * v[at] * v[at]
    return energy


def book_impact(ledger: Any, gain: float) -> None:
    """Book the kinetic energy that an impact of the actuators gave."""


@chosen_by_type(book_impact)
def _book_impact(ledger, gain):
    if isinstance(ledger, types.NoneType):
        return lambda ledger, gain: None

    def book(ledger, gain):
        ledger[WORK_IN * LEDGER_STRIDE] += gain

    return book


# --- stops of hinges ------------------------------------------------------------------------


@jit
def meet_stops(rigid: Any, body: Any, x: Any) -> bool:
    """Push hinges back that have overrun their stops; say whether one is on a stop."""
    table, work = rigid.table, rigid.work
    node, resting, worst, largest = table.stop_node, False, 0, 0.0
    for s in range(table.stop_low.size):
        b = 4 * s
        bend = hinge_parts(x, table.stride, node[b], node[b + 1], node[b + 2], node[b + 3])[0]
        low, high = table.stop_low[s], table.stop_high[s]
        resting = resting or bend <= low or bend >= high
        over = abs(gauss_seidel.stop_value(bend, low, high))
        if over > largest:
            worst, largest = s, over
    if largest > SWEPT:
        _, residual = gauss_seidel.gauss_seidel(
            x, body.inverse_mass, table, work, max(rigid.tolerance, SWEPT), SWEEPS
        )
        if not residual <= 10.0 * max(rigid.tolerance, SWEPT) and rigid.status[FAILED_ROW] < 0.0:
            rigid.status[FAILED_ROW] = rigid.row_element.size + worst
            rigid.status[RESIDUAL] = residual
    return resting


def land(rigid: Any, body: Any, x: Any, v: Any, ledger: Any) -> None:
    """Take from `v` what drives hinges into their stops, without rebound; book the loss."""


@chosen_by_type(land)
def _land(rigid, body, x, v, ledger):
    keeps = not isinstance(ledger, types.NoneType)

    def run(rigid, body, x, v, ledger):
        before = kinetic_energy(body, v)
        gauss_seidel.gauss_seidel_velocities(
            x, v, body.inverse_mass, rigid.table, rigid.work, SWEPT, SWEEPS
        )
        if keeps:
            ledger[CONTACT * LEDGER_STRIDE] += before - kinetic_energy(body, v)

    return run


# --- between steps --------------------------------------------------------------------------


def begin_rigid(body: Any, state: Any) -> None:
    """Make the start what the steps expect: factorised, velocities projected."""


@chosen_by_type(begin_rigid)
def _begin_rigid(body, state):
    if not is_constrained(body):
        return lambda body, state: None

    def run(body, state):
        prepare(body.constraints, body, state.x)
        project_velocities(body.constraints, state.v)

    return run


def take_impact(body: Any, state: Any) -> None:
    """Pass a jump of driven velocities on to what is rigidly connected.

    The impulses change no position; the work of the actuators is the gain in kinetic energy.
    """


@chosen_by_type(take_impact)
def _take_impact(body, state):
    if not is_constrained(body):
        return lambda body, state: None

    def run(body, state):
        rigid = body.constraints
        if algebra.rates(state.v, rigid.table, rigid.work, rigid.work.step) > JUMP:
            before = kinetic_energy(body, state.v)
            project_velocities(rigid, state.v)
            book_impact(state.ledger, kinetic_energy(body, state.v) - before)

    return run


def failed_row(body: Any) -> int:
    """Return the row that could not be satisfied, or -1."""


@chosen_by_type(failed_row)
def _failed_row(body):
    if not is_constrained(body):
        return lambda body: -1
    return lambda body: int(body.constraints.status[FAILED_ROW])


# --- what is saved --------------------------------------------------------------------------


def find_reactions(body: Any, state: Any, t: float, h: float) -> None:
    """Write the forces and moments of rigid elements at `t` to the body's scratch.

    From the accelerations at that instant, not from the impulses of a step, so they are as
    accurate as the state is.
    """


@chosen_by_type(find_reactions)
def _find_reactions(body, state, t, h):
    if not is_constrained(body):
        return lambda body, state, t, h: None

    def run(body, state, t, h):
        rigid = body.constraints
        x, v = state.x, state.v
        evaluate(body, x, v, rigid.force, rigid.rates, t, t, t + h)
        solve_multipliers(rigid, body, x, v, rigid.force, rigid.acceleration, t, t, t + h)
        n_bars = rigid.table.length.size
        for r in range(rigid.row_element.size):
            target = body.scratch[1] if r < n_bars else body.scratch[3]
            target[rigid.row_element[r]] = -rigid.work.multiplier[r]

    return run


def observe_rigid(body: Any, x: Any) -> None:
    """Write lengths and angles of rigid elements to the body's scratch."""


@chosen_by_type(observe_rigid)
def _observe_rigid(body, x):
    if not is_constrained(body):
        return lambda body, x: None

    def run(body, x):
        rigid, stride = body.constraints, body.stride
        node = rigid.bar_node
        for b in range(rigid.bar.size):
            square = 0.0
            for a in range(3):
                d = x[a * stride + node[2 * b + 1]] - x[a * stride + node[2 * b]]
                square += d * d
            body.scratch[0][rigid.bar[b]] = math.sqrt(square)
        node = rigid.hinge_node
        for b in range(rigid.hinge.size):
            c = 4 * b
            parts = hinge_parts(x, stride, node[c], node[c + 1], node[c + 2], node[c + 3])
            rest = body.scratch[4][rigid.hinge[b]] - math.pi
            body.scratch[2][rigid.hinge[b]] = wrap_angle(parts[0] - rest)

    return run
