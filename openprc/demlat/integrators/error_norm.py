"""How large the error of a step is, compared with the motion.

Positions are measured against the rms displacement since t = 0, velocities against the rms
velocity, each the largest so far, at least `QUIET` and at most one in the engine's units, which
are those of the mean bar and of its vibration. The root mean square over all free coordinates
is compared with the tolerance. So neither the place of the scene nor its units matter.
"""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.compiled.lanes import load, splat, store
from openprc.demlat.integrators.embedded import weighted_sums
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE

#: Smallest motion that errors are measured against, in the engine's units.
QUIET = 1e-3
#: Entries of the clock of a scheme: the largest rms displacement and velocity so far.
FAR, FAST = range(2)


@jit
def _sum(sums: Any, row: int) -> float:
    result = 0.0
    for lane in range(LEDGER_STRIDE):
        result += sums[row * LEDGER_STRIDE + lane]
    return result


@jit
def _add_up(work: Any, body: Any, h: float) -> None:
    """Sum the squares of two error estimates of x and of v, of displacements and velocities."""
    table, stages, lanes = work.table, work.stages, body.lanes
    zero = splat(lanes, 0.0)
    x1, x2, v1, v2, far, fast = zero, zero, zero, zero, zero, zero
    count = table.stages + 1
    for at in range(0, stages.x.size, len(lanes)):
        mobility = h * load(lanes, body.inverse_mass, at, 0)
        ev, ex = weighted_sums(stages, lanes, table.error, table.double_error, 0, count, at)
        ev *= mobility
        ex *= mobility * h
        x1 += ex * ex
        v1 += ev * ev
        ev, ex = weighted_sums(stages, lanes, table.error, table.double_error, 1, count, at)
        ev *= mobility
        ex *= mobility * h
        x2 += ex * ex
        v2 += ev * ev
        moved = load(lanes, stages.x, at, 0) - load(lanes, work.start, at, 0)
        far += moved * moved
        u = load(lanes, stages.v, at, 0)
        fast += u * u
    store(lanes, work.sums, 0, x1)
    store(lanes, work.sums, LEDGER_STRIDE, x2)
    store(lanes, work.sums, 2 * LEDGER_STRIDE, v1)
    store(lanes, work.sums, 3 * LEDGER_STRIDE, v2)
    store(lanes, work.sums, 4 * LEDGER_STRIDE, far)
    store(lanes, work.sums, 5 * LEDGER_STRIDE, fast)


@jit
def rms_moved(work: Any) -> float:
    """Return the rms displacement since t = 0 at the end of the step just tried."""
    return math.sqrt(_sum(work.sums, 4) / max(work.free, 1))


@jit
def rms_speed(work: Any) -> float:
    """Return the rms velocity at the end of the step just tried."""
    return math.sqrt(_sum(work.sums, 5) / max(work.free, 1))


@jit
def relative_error(work: Any, body: Any, h: float) -> float:
    """Return the error of the step just tried in units of what is tolerated; may be NaN.

    Two estimates are combined as by Hairer, Norsett & Wanner, sec. II.10; with one of them
    zero the other is left.
    """
    _add_up(work, body, h)
    free = max(work.free, 1)
    far, fast = max(rms_moved(work), work.clock[FAR]), max(rms_speed(work), work.clock[FAST])
    x_unit = work.tolerance * min(max(far, QUIET), 1.0)
    v_unit = work.tolerance * min(max(fast, QUIET), 1.0)
    first = _sum(work.sums, 0) / (x_unit * x_unit) + _sum(work.sums, 2) / (v_unit * v_unit)
    second = _sum(work.sums, 1) / (x_unit * x_unit) + _sum(work.sums, 3) / (v_unit * v_unit)
    if first == 0.0:
        return 0.0
    return first / math.sqrt(2.0 * free * (first + 0.01 * second))


@jit
def worst_coordinate(work: Any, body: Any) -> int:
    """Return the coordinate whose velocity has the largest estimated error."""
    table, stages = work.table, work.stages
    worst, largest = 0, -1.0
    for at in range(stages.x.size):
        error = 0.0
        for j in range(table.stages):
            error += table.error[0, j] * stages.forces[at + j * stages.pitch]
        error = abs(error * body.inverse_mass[at])
        if not error <= largest:
            worst, largest = at, error
    return worst
