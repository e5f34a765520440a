"""The classical fourth-order Runge-Kutta scheme.

Positions and velocities advance together, ``k_x`` being the *stage's* velocity: with the
velocity of the step's start the scheme would be of first order and feed energy into every
mode. Driven coordinates, and forces, are evaluated at every stage's own time. Work and loss
are more unknowns of the same system, so the energy balance is of fourth order as well.

Stability: see `openprc.demlat.planning.stability`. Source: Hairer, Norsett & Wanner, Solving
Ordinary Differential Equations I, sec. II.1, doi:10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from openprc.demlat.compiled.aligned import aligned_zeros_like
from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import add, load, store
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
        return cls(*(aligned_zeros_like(body.mass) for _ in range(5)), make_rates(body, settings))


@jit
def _first(work: Any, body: Any, x: Any, v: Any, weight: float, ahead: float) -> None:
    """Begin the sums with the derivative at the step's start, and go `ahead` from there."""
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        slope_x = load(lanes, v, at, 0)
        slope_v = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, work.sum_x, at, weight * slope_x)
        store(lanes, work.sum_v, at, weight * slope_v)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + ahead * slope_x)
        store(lanes, work.stage_v, at, slope_x + ahead * slope_v)


@jit
def _middle(work: Any, body: Any, x: Any, v: Any, weight: float, ahead: float) -> None:
    """Add a stage's derivative to the sums, and go `ahead` from the step's start with it."""
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        slope_x = load(lanes, work.stage_v, at, 0)
        slope_v = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        add(lanes, work.sum_x, at, 0, weight * slope_x)
        add(lanes, work.sum_v, at, 0, weight * slope_v)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + ahead * slope_x)
        store(lanes, work.stage_v, at, load(lanes, v, at, 0) + ahead * slope_v)


@jit
def _last(work: Any, body: Any, x: Any, v: Any, weight: float) -> None:
    """Add the last derivative and the sums to the state."""
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        slope_v = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        change_x = load(lanes, work.sum_x, at, 0) + weight * load(lanes, work.stage_v, at, 0)
        add(lanes, x, at, 0, change_x)
        add(lanes, v, at, 0, load(lanes, work.sum_v, at, 0) + weight * slope_v)


def rk4_step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    work = scheme
    # Stages are a loop, so that the forces are compiled into it once.
    for stage in range(4):
        stage_t = t + (0.0 if stage == 0 else (h if stage == 3 else 0.5 * h))
        x = state.x if stage == 0 else work.stage_x
        v = state.v if stage == 0 else work.stage_v
        if stage > 0:
            place_driven(body.drives, x, v, stage_t, t, t + h)
        evaluate(body, x, v, work.force, work.rates, stage_t, t, t + h)
        book(state.ledger, body.lanes, work.rates, h / 6.0 if stage in (0, 3) else h / 3.0)
        if stage == 0:
            _first(work, body, state.x, state.v, h / 6.0, 0.5 * h)
        elif stage < 3:
            _middle(work, body, state.x, state.v, h / 3.0, h if stage == 2 else 0.5 * h)
        else:
            _last(work, body, state.x, state.v, h / 6.0)
    place_driven(body.drives, state.x, state.v, t + h, t, t + h)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    return rk4_step if scheme.instance_class is RK4 else None
