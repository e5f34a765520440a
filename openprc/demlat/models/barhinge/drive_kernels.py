"""What actuators prescribe, and the power that they put in."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, WORK_IN
from openprc.demlat.signal_table import SAMPLE_SLACK


@jit
def segment_of(table: Any, column: int, t: float, t_from: float, t_to: float) -> int:
    """Return the row that holds at `t`, for a step that reaches from `t_from` to `t_to`.

    A sample at the end of a step belongs to the segment before it, one at its beginning to the
    segment after it: every stage of a step sees one polynomial when samples are on step ends.
    """
    dt = table.dt[column]
    number = math.floor(t / dt)
    number = max(number, math.floor(t_from / dt + SAMPLE_SLACK))
    number = min(number, max(math.ceil(t_to / dt - SAMPLE_SLACK) - 1, 0))
    return min(max(number, 0), table.count[column] - 1)


@jit
def value_and_rate(table: Any, column: int, t: float, t_from: float, t_to: float) -> Any:
    """Return the value of a column at `t` and its rate [per second]."""
    segment = segment_of(table, column, t, t_from, t_to)
    dt = table.dt[column]
    s = t / dt - segment
    row = table.first[column] + segment
    value, rate = 0.0, 0.0
    for power in range(table.coefficients.shape[1] - 1, -1, -1):
        rate = rate * s + value
        value = value * s + table.coefficients[row, power]
    return value, rate / dt


@jit
def acceleration(table: Any, column: int, t: float, t_from: float, t_to: float) -> float:
    """Return the second rate of a column at `t` [per second squared]."""
    segment = segment_of(table, column, t, t_from, t_to)
    dt = table.dt[column]
    s = t / dt - segment
    row = table.first[column] + segment
    result = 0.0
    for power in range(table.coefficients.shape[1] - 1, 1, -1):
        result = result * s + power * (power - 1) * table.coefficients[row, power]
    return result / (dt * dt)


def _place(drives: Any, x: Any, v: Any, t: float, t_from: float, t_to: float) -> None:
    for d in range(drives.motion_at.size):
        at = drives.motion_at[d]
        value, rate = value_and_rate(drives.signals, drives.motion_signal[d], t, t_from, t_to)
        x[at] = drives.motion_start[d] + value
        v[at] = rate


def _actuate(
    drives: Any, v: Any, force: Any, rates: Any, t: float, t_from: float, t_to: float
) -> None:
    for d in range(drives.motion_at.size):
        at = drives.motion_at[d]
        # Weight and drag of a held coordinate are not among the forces, which it ignores.
        force[at] += drives.motion_weight[d] - drives.motion_drag[d] * v[at]
        _book(rates, drives.motion_lane[d], -force[at] * v[at])
        _book_drag(rates, drives.motion_lane[d], drives.motion_drag[d] * v[at] * v[at])
    for d in range(drives.force_at.size):
        at = drives.force_at[d]
        value, _ = value_and_rate(drives.signals, drives.force_signal[d], t, t_from, t_to)
        force[at] += value
        _book(rates, drives.force_lane[d], value * v[at])


def _book(rates: Any, lane: int, power: float) -> None: ...


@chosen_by_type(_book)
def _book_if_kept(rates: Any, lane: int, power: float) -> Any:
    if isinstance(rates, types.NoneType):
        return lambda rates, lane, power: None

    def book(rates, lane, power):
        rates[WORK_IN * LEDGER_STRIDE + lane] += power

    return book


def _book_drag(rates: Any, lane: int, power: float) -> None: ...


@chosen_by_type(_book_drag)
def _book_drag_if_kept(rates: Any, lane: int, power: float) -> Any:
    if isinstance(rates, types.NoneType):
        return lambda rates, lane, power: None

    def book(rates, lane, power):
        rates[LEDGER_STRIDE + lane] += power  # row DRAG

    return book


def place_driven(drives: Any, x: Any, v: Any, t: float, t_from: float, t_to: float) -> None:
    """Put driven coordinates where their signals say, with the signals' rates."""


@chosen_by_type(place_driven)
def _place_driven(drives, x, v, t, t_from, t_to):
    if isinstance(drives, types.NoneType):
        return lambda drives, x, v, t, t_from, t_to: None
    return _place


def actuate(
    drives: Any, v: Any, force: Any, rates: Any, t: float, t_from: float, t_to: float
) -> None:
    """Add the actuators' forces, and their power to `rates`."""


@chosen_by_type(actuate)
def _actuate_if_any(drives, v, force, rates, t, t_from, t_to):
    if isinstance(drives, types.NoneType):
        return lambda drives, v, force, rates, t, t_from, t_to: None
    return _actuate


def jumps_at(drives: Any, x: Any, t: float, t_to: float) -> bool:
    """Say whether a held signal is about to move a driven coordinate at once."""


@chosen_by_type(jumps_at)
def _jumps_at(drives, x, t, t_to):
    if isinstance(drives, types.NoneType):
        return lambda drives, x, t, t_to: False

    def search(drives, x, t, t_to):
        for d in range(drives.motion_at.size):
            column = drives.motion_signal[d]
            if drives.signals.steps[column]:
                value, _ = value_and_rate(drives.signals, column, t, t, t_to)
                if drives.motion_start[d] + value != x[drives.motion_at[d]]:
                    return True
        return False

    return search


def driven_energy(drives: Any, v: Any, ledger: Any, sign: float) -> None:
    """Add `sign` times the kinetic energy of driven coordinates to the work in `ledger`.

    What moves the driven masses themselves also comes from the actuators.
    """


@chosen_by_type(driven_energy)
def _driven_energy(drives, v, ledger, sign):
    if isinstance(drives, types.NoneType):
        return lambda drives, v, ledger, sign: None

    def book(drives, v, ledger, sign):
        for d in range(drives.motion_at.size):
            u = v[drives.motion_at[d]]
            share = 0.5 * drives.motion_mass[d] * u * u
            ledger[WORK_IN * LEDGER_STRIDE + drives.motion_lane[d]] += sign * share

    return book


@jit
def next_knot(drives: Any, t: float) -> float:
    """Return the next time after `t` at which a signal has a knot, or infinity."""
    table = drives.signals
    nearest = math.inf
    for column in range(table.dt.size):
        if table.knots[column]:
            dt = table.dt[column]
            number = math.floor(t / dt + SAMPLE_SLACK) + 1
            if number <= table.count[column]:
                nearest = min(nearest, number * dt)
    return nearest
