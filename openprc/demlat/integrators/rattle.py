"""RATTLE: Verlet's scheme for rigid bars and hinges, of second order, symplectic.

The rigid elements push in two halves, like everything else in that scheme: in the first along
their directions at the start of the step, by as much as puts the end positions on the
constraints; in the second along those at the end, by as much as makes the velocities there
compatible. Both are solved for with the one factor that belongs to these directions, so a step
takes one factorisation and a few solves. Without damping, energy errors stay bounded and
momenta are kept to rounding.

Damping: the force at the end is evaluated with a predicted velocity, as in
`openprc.demlat.integrators.verlet`. Source: Andersen 1983, doi:10.1016/0021-9991(83)90014-1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.jit import chosen_by_type
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.constrained import unsatisfied
from openprc.demlat.integrators.knots import must_renew
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.integrators.verlet import half_kick, kick_and_drift
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.rigid_elements import (
    book_reactions,
    prepare,
    project_positions,
    project_velocities,
    push,
)
from openprc.demlat.models.barhinge.tables import Body, Reals

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.errors import Diverged
    from openprc.schema.experiment import Experiment


class Rattle(NamedTuple):
    """Work arrays: predicted velocity, force at the end of the last step, its powers, clock."""

    predicted: Reals
    force: Reals
    rates: Reals | None
    clock: NDArray[np.float64]

    can_fail = constrained = True

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> Rattle:
        """Return work arrays for `body`."""
        zeros = np.zeros_like
        return cls(zeros(body.mass), zeros(body.mass), make_rates(body, settings), np.zeros(2))

    def explain(self, experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
        """Return the error for a step that could not be taken."""
        return unsatisfied(experiment, assembly, time)


def rattle_step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    x, v, lanes, rigid = state.x, state.v, body.lanes, body.constraints
    if must_renew(scheme.clock, body.drives, t, h):
        evaluate(body, x, v, scheme.force, scheme.rates, t, t, t + h)
    book(state.ledger, lanes, scheme.rates, 0.5 * h)
    kick_and_drift(scheme, body, x, v, h)
    place_driven(body.drives, x, scheme.predicted, t + h, t, t + h)
    project_positions(rigid, x)
    push(rigid, v, 1.0 / h)
    push(rigid, scheme.predicted, 2.0 / h)
    book_reactions(rigid, v, state.ledger, 1.0 / h)

    prepare(rigid, body, x)
    evaluate(body, x, scheme.predicted, scheme.force, scheme.rates, t + h, t, t + h)
    book(state.ledger, lanes, scheme.rates, 0.5 * h)
    half_kick(body, v, scheme.force, h)
    place_driven(body.drives, x, v, t + h, t, t + h)
    project_velocities(rigid, v)
    book_reactions(rigid, v, state.ledger, 1.0)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not Rattle:
        return None
    return rattle_step
