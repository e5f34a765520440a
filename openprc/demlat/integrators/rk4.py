"""The classical fourth-order Runge-Kutta scheme.

Positions and velocities advance together, ``k_x`` being the *stage's* velocity: with the
velocity of the step's start the scheme would be of first order and feed energy into every
mode. Driven coordinates, and forces, are evaluated at every stage's own time. Work and loss
are more unknowns of the same system, so the energy balance is of fourth order as well.

Stability: see `openprc.demlat.stability`. Source: Hairer, Norsett & Wanner, Solving Ordinary
Differential Equations I, sec. II.1, doi:10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import add, load, splat, store
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import Body, Reals


class RK4(NamedTuple):
    """Work arrays: stage state, sums over the stages, force; rates of the ledger or None."""

    stage_x: Reals
    stage_v: Reals
    sum_x: Reals
    sum_v: Reals
    force: Reals
    rates: Reals | None

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> RK4:
        """Return work arrays for `body`."""
        return cls(*(np.zeros_like(body.mass) for _ in range(5)), make_rates(body, settings))


@jit
def _stage(work: Any, body: Any, x: Any, v: Any, weight: float, ahead: float) -> None:
    """Add the derivative to the sums with `weight`, and go `ahead` from the step's start."""
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        slope_x = load(lanes, work.stage_v, at, 0)
        slope_v = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, work.sum_x, at, load(lanes, work.sum_x, at, 0) + weight * slope_x)
        store(lanes, work.sum_v, at, load(lanes, work.sum_v, at, 0) + weight * slope_v)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + ahead * slope_x)
        store(lanes, work.stage_v, at, load(lanes, v, at, 0) + ahead * slope_v)


@jit
def rk4_step(work: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    x, v, lanes = state.x, state.v, body.lanes
    zero = splat(lanes, 0.0)
    for at in range(0, x.size, len(lanes)):
        store(lanes, work.sum_x, at, zero)
        store(lanes, work.sum_v, at, zero)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0))
        store(lanes, work.stage_v, at, load(lanes, v, at, 0))
    for stage in range(4):
        outer = stage == 0 or stage == 3
        weight = h / 6.0 if outer else h / 3.0
        stage_t = t + (0.0 if stage == 0 else (h if stage == 3 else 0.5 * h))
        if stage > 0:
            place_driven(body.drives, work.stage_x, work.stage_v, stage_t, t, t + h)
        evaluate(body, work.stage_x, work.stage_v, work.force, work.rates, stage_t, t, t + h)
        book(state.ledger, lanes, work.rates, weight)
        _stage(work, body, x, v, weight, h if stage == 2 else 0.5 * h)
    for at in range(0, x.size, len(lanes)):
        add(lanes, x, at, 0, load(lanes, work.sum_x, at, 0))
        add(lanes, v, at, 0, load(lanes, work.sum_v, at, 0))
    place_driven(body.drives, x, v, t + h, t, t + h)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not RK4:
        return None
    return lambda scheme, body, state, t, h: rk4_step(scheme, body, state, t, h)
