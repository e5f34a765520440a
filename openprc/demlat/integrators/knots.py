"""Where the drives are not smooth, for schemes that carry a force over from step to step."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.models.barhinge.drive_kernels import next_knot

#: Slack, in steps, within which a knot counts as lying on a step's end.
KNOT_SLACK = 1e-6


def knot_after(drives: Any, t: float) -> float:
    """Return the next time after `t` at which a signal has a knot, or infinity."""


@chosen_by_type(knot_after)
def _knot_after(drives, t):
    if isinstance(drives, types.NoneType):
        return lambda drives, t: math.inf
    return lambda drives, t: next_knot(drives, t)


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
