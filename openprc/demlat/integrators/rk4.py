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
from openprc.demlat.compiled.lanes import add, load, splat, store
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.bar_kernels import keep
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import (
    add_forces,
    clear,
    first_force,
    start_forces,
)
from openprc.demlat.models.barhinge.tables import DRAG, LEDGER_STRIDE, Body, Reals


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


# With a_i the acceleration of stage i, positions gain ``h v + h^2 (a_1 + a_2 + a_3) / 6`` and
# velocities ``h (a_1 + 2 a_2 + 2 a_3 + a_4) / 6``. What the third one adds is known from the
# velocity of the last stage, ``v + h a_3``, so the sums are left alone then. Weight and drag of
# the next stage are set on the way. A large body waits for its memory more than for arithmetic.


@jit
def _first(work: Any, body: Any, x: Any, v: Any, h: float) -> None:
    """Begin the sums with the first stage, and go half a step ahead with it."""
    lanes = body.lanes
    lost = splat(lanes, 0.0)
    for at in range(0, x.size, len(lanes)):
        u = load(lanes, v, at, 0)
        a = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, work.sum_x, at, h * u + (h * h / 6.0) * a)
        store(lanes, work.sum_v, at, (h / 6.0) * a)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + (0.5 * h) * u)
        ahead = u + (0.5 * h) * a
        store(lanes, work.stage_v, at, ahead)
        begun, loss = first_force(body, at, ahead)
        store(lanes, work.force, at, begun)
        lost += loss
    keep(lanes, work.rates, DRAG * LEDGER_STRIDE, lost)


@jit
def _second(work: Any, body: Any, x: Any, v: Any, h: float) -> None:
    """Add the second stage to the sums, and go half a step ahead from the start with it."""
    lanes = body.lanes
    lost = splat(lanes, 0.0)
    for at in range(0, x.size, len(lanes)):
        u = load(lanes, work.stage_v, at, 0)
        a = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        add(lanes, work.sum_x, at, 0, (h * h / 6.0) * a)
        add(lanes, work.sum_v, at, 0, (h / 3.0) * a)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + (0.5 * h) * u)
        ahead = load(lanes, v, at, 0) + (0.5 * h) * a
        store(lanes, work.stage_v, at, ahead)
        begun, loss = first_force(body, at, ahead)
        store(lanes, work.force, at, begun)
        lost += loss
    keep(lanes, work.rates, DRAG * LEDGER_STRIDE, lost)


@jit
def _third(work: Any, body: Any, x: Any, v: Any, h: float) -> None:
    """Go a whole step ahead from the start with the third stage."""
    lanes = body.lanes
    lost = splat(lanes, 0.0)
    for at in range(0, x.size, len(lanes)):
        u = load(lanes, work.stage_v, at, 0)
        a = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, work.stage_x, at, load(lanes, x, at, 0) + h * u)
        ahead = load(lanes, v, at, 0) + h * a
        store(lanes, work.stage_v, at, ahead)
        begun, loss = first_force(body, at, ahead)
        store(lanes, work.force, at, begun)
        lost += loss
    keep(lanes, work.rates, DRAG * LEDGER_STRIDE, lost)


@jit
def _last(work: Any, body: Any, x: Any, v: Any, h: float) -> None:
    """Add the sums and the last two stages to the state."""
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        u = load(lanes, v, at, 0)
        a = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        third = load(lanes, work.stage_v, at, 0) - u  # h a_3
        add(lanes, x, at, 0, load(lanes, work.sum_x, at, 0) + (h / 6.0) * third)
        gain = load(lanes, work.sum_v, at, 0) + (1.0 / 3.0) * third + (h / 6.0) * a
        store(lanes, v, at, u + gain)


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
        else:
            clear(body, work.rates)
            start_forces(body, v, work.force, work.rates)
        add_forces(body, x, v, work.force, work.rates, stage_t, t, t + h)
        book(state.ledger, body.lanes, work.rates, h / 6.0 if stage in (0, 3) else h / 3.0)
        clear(body, work.rates)
        if stage == 0:
            _first(work, body, state.x, state.v, h)
        elif stage == 1:
            _second(work, body, state.x, state.v, h)
        elif stage == 2:
            _third(work, body, state.x, state.v, h)
        else:
            _last(work, body, state.x, state.v, h)
    place_driven(body.drives, state.x, state.v, t + h, t, t + h)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    return rk4_step if scheme.instance_class is RK4 else None
