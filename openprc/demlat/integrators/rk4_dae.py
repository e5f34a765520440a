"""The classical Runge-Kutta scheme on the constrained equations of motion, of fourth order.

In every stage the forces of rigid elements are those that keep the second derivative of the
constraints at zero: the index-1 form of the equations. What the constraints drift off by in a
step, O(h^5), is projected away at its end, positions first, then velocities, which costs no
order. Four factorisations a step: the last stage's serves the projection of the positions, and
that at the new positions the velocities and the next step's first stage.

Source: Hairer & Wanner, Solving Ordinary Differential Equations II, sec. VII.1 and VII.2,
doi:10.1007/978-3-642-05221-7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from openprc.demlat.compiled.jit import chosen_by_type
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.constrained import unsatisfied
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.rigid_elements import (
    book_reactions,
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


class ConstrainedRK4(NamedTuple):
    """Work arrays: stage state, sums over the stages, force, acceleration, powers or None."""

    stage_x: Reals
    stage_v: Reals
    sum_x: Reals
    sum_v: Reals
    force: Reals
    acceleration: Reals
    rates: Reals | None

    can_fail = constrained = True

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> ConstrainedRK4:
        """Return work arrays for `body`."""
        return cls(*(np.zeros_like(body.mass) for _ in range(6)), make_rates(body, settings))

    def explain(self, experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
        """Return the error for a step that could not be taken."""
        return unsatisfied(experiment, assembly, time)


def rk4_dae_step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    rigid, slope = body.constraints, scheme.acceleration
    for at in range(state.x.size):
        scheme.stage_x[at], scheme.stage_v[at] = state.x[at], state.v[at]
        scheme.sum_x[at] = 0.0
        scheme.sum_v[at] = 0.0
    x, v = scheme.stage_x, scheme.stage_v
    for stage in range(4):
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        stage_t = t + (0.0 if stage == 0 else (h if stage == 3 else 0.5 * h))
        if stage > 0:
            place_driven(body.drives, x, v, stage_t, t, t + h)
            prepare(rigid, body, x)
        evaluate(body, x, v, scheme.force, scheme.rates, stage_t, t, t + h)
        solve_multipliers(rigid, body, x, v, scheme.force, slope, stage_t, t, t + h)
        push(rigid, slope, 1.0)
        book(state.ledger, body.lanes, scheme.rates, weight)
        book_reactions(rigid, v, state.ledger, weight)
        ahead = h if stage == 2 else 0.5 * h
        for at in range(x.size):
            scheme.sum_x[at] += weight * v[at]
            scheme.sum_v[at] += weight * slope[at]
            x[at] = state.x[at] + ahead * v[at]
            v[at] = state.v[at] + ahead * slope[at]
    for at in range(x.size):
        state.x[at] += scheme.sum_x[at]
        state.v[at] += scheme.sum_v[at]
    place_driven(body.drives, state.x, state.v, t + h, t, t + h)
    project_positions(rigid, state.x)
    prepare(rigid, body, state.x)
    project_velocities(rigid, state.v)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not ConstrainedRK4:
        return None
    return rk4_dae_step
