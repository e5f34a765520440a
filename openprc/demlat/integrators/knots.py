"""Where the drives are not smooth, for schemes that carry a force over from step to step."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.models.barhinge.drive_kernels import next_knot
from openprc.demlat.signal_table import SAMPLE_SLACK

#: Slack, in steps, within which a knot counts as lying on a step's end.
KNOT_SLACK = 1e-6


def knot_after(drives: Any, t: float) -> float:
    """Return the next time after `t` at which a signal has a knot or ends, or infinity.

    Even a smooth signal ends with a kink, or with a jump of the velocity that it prescribes.
    """


@jit
def _next_end(table: Any, t: float) -> float:
    nearest = math.inf
    for column in range(table.dt.size):
        end = (table.count[column] - 1) * table.dt[column]
        if end > t + SAMPLE_SLACK * table.dt[column]:
            nearest = min(nearest, end)
    return nearest


@chosen_by_type(knot_after)
def _knot_after(drives, t):
    if isinstance(drives, types.NoneType):
        return lambda drives, t: math.inf
    return lambda drives, t: min(next_knot(drives, t), _next_end(drives.signals, t))


@jit
def must_renew(clock: Any, drives: Any, t: float, h: float) -> bool:
    """Say whether the force of the last step's end is not that of the next step's start.

    It is not when a knot lies between the two steps (forces, and the motion of driven
    coordinates, jump there), nor when the run has begun anew.

    Parameters
    ----------
    clock : (2,) [s]
        Where the last step ended, and the first knot after that; updated for a step from `t`
        to ``t + h``.
    """
    ended, knot = clock[0], clock[1]
    clock[0] = t + h
    slack = KNOT_SLACK * h
    if t > 0.0 and abs(t - ended) <= slack and knot > t + slack:
        return False
    clock[1] = knot_after(drives, t)
    return True
