"""The OpenPRC paper's hybrid: Runge-Kutta for what is soft, projection for what is rigid.

A classical Runge-Kutta step with the soft forces; then the positions are moved onto the
constraints, and the velocities follow. The directions of the first are those at the start of
the step, and the same impulse acts on the velocities, which are then made compatible along the
directions at the end. That is what makes the scheme second order: with directions of the
end, or velocities left to themselves, it is of first order or less. A direct sparse solution
finds in a few steps the point that sweeps over the elements approach in thousands.

The stages' states contain what the rigid elements do at the start of the step, so that dampers
and the energy balance, which depend on stage velocities, do not lower the order.

Hinges may have hard stops, which they hit without rebound. While one does, sweeps over all
elements and stops replace the direct solution, and the scheme is of first order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.constrained import unsatisfied
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.rigid_elements import (
    book_reactions,
    land,
    meet_stops,
    prepare,
    project_positions,
    project_velocities,
    push,
    solve_multipliers,
)
from openprc.demlat.models.barhinge.tables import Body, Reals

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.errors import Diverged
    from openprc.schema.experiment import Experiment


class ProjectedRK4(NamedTuple):
    """Work arrays: stage state, sums, force, pull of rigid elements, scratch, powers or None."""

    stage_x: Reals
    stage_v: Reals
    sum_x: Reals
    sum_v: Reals
    force: Reals
    pull: Reals
    scratch: Reals
    rates: Reals | None

    can_fail = constrained = True

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> ProjectedRK4:
        """Return work arrays for `body`."""
        return cls(*(np.zeros_like(body.mass) for _ in range(7)), make_rates(body, settings))

    def explain(self, experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
        """Return the error for a step that could not be taken."""
        return unsatisfied(experiment, assembly, time)


@jit
def soft_step(work: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Take the Runge-Kutta step; positions include the rigid elements' pull at the start."""
    rigid, pull = body.constraints, work.pull
    for at in range(state.x.size):
        work.stage_x[at], work.stage_v[at] = state.x[at], state.v[at]
        work.sum_x[at] = 0.0
        work.sum_v[at] = 0.0
        pull[at] = 0.0
    x, v = work.stage_x, work.stage_v
    for stage in range(4):
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        stage_t = t + (0.0 if stage == 0 else (h if stage == 3 else 0.5 * h))
        if stage > 0:
            place_driven(body.drives, x, v, stage_t, t, t + h)
        evaluate(body, x, v, work.force, work.rates, stage_t, t, t + h)
        if stage == 0:
            solve_multipliers(rigid, body, x, v, work.force, work.scratch, t, t, t + h)
            push(rigid, pull, 1.0)
            book_reactions(rigid, v, state.ledger, 0.5 * h)
        book(state.ledger, body.lanes, work.rates, weight)
        ahead = h if stage == 2 else 0.5 * h
        for at in range(x.size):
            slope = work.force[at] * body.inverse_mass[at]
            work.sum_x[at] += weight * v[at]
            work.sum_v[at] += weight * slope
            x[at] = state.x[at] + ahead * v[at]
            v[at] = state.v[at] + ahead * (slope + pull[at])
    for at in range(x.size):
        state.x[at] += work.sum_x[at]
        state.v[at] += work.sum_v[at] + 0.5 * h * pull[at]


def rk4_projection_step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    rigid = body.constraints
    soft_step(scheme, body, state, t, h)
    # Driven coordinates go to their places, but the impulse of the start meets them at their
    # velocities of the start.
    place_driven(body.drives, state.x, scheme.stage_v, t + h, t, t + h)
    project_positions(rigid, state.x)
    push(rigid, state.v, 1.0 / h)
    book_reactions(rigid, state.v, state.ledger, 1.0 / h)
    on_a_stop = meet_stops(rigid, body, state.x)
    prepare(rigid, body, state.x)
    place_driven(body.drives, state.x, state.v, t + h, t, t + h)
    project_velocities(rigid, state.v)
    book_reactions(rigid, state.v, state.ledger, 1.0)
    if on_a_stop:
        land(rigid, body, state.x, state.v, state.ledger)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not ProjectedRK4:
        return None
    return rk4_projection_step
