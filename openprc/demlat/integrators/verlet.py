"""The velocity form of Verlet's scheme, of second order with damping as well.

Positions advance with the velocity half a step ahead. The force at the end of the step needs
the velocity there, which it also determines: it is evaluated with the velocity predicted by
the force at the start, ``v + h a``, which is off by O(h^2) only. Without damping the scheme is
symplectic and reversible, energy errors stay bounded, and linear and angular momentum are kept
to the last digits.

One evaluation a step: the force of the end serves the next step, unless a signal has a knot
between them. Powers of the ledger are summed by the trapezoidal rule, which has the same order.

Stable for ``h omega < 2 (sqrt(1 + 4 zeta^2) - 2 zeta)``, zeta being the damping ratio of the
mode. Source: Swope, Andersen, Berens & Wilson 1982, doi:10.1063/1.442716.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.aligned import aligned_zeros_like
from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, store
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.knots import must_renew
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import Body, Reals


class Verlet(NamedTuple):
    """Work arrays: predicted velocity, force at the end of the last step, its powers, clock."""

    predicted: Reals
    force: Reals
    rates: Reals | None
    clock: NDArray[np.float64]

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> Verlet:
        """Return work arrays for `body`."""
        zeros = aligned_zeros_like
        return cls(zeros(body.mass), zeros(body.mass), make_rates(body, settings), np.zeros(2))


@jit
def half_kick(body: Any, v: Any, force: Any, h: float) -> None:
    """Add half a step's worth of a force to velocities."""
    lanes = body.lanes
    for at in range(0, v.size, len(lanes)):
        gain = 0.5 * h * load(lanes, force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, v, at, load(lanes, v, at, 0) + gain)


@jit
def kick_and_drift(work: Any, body: Any, x: Any, v: Any, h: float) -> None:
    """Go half a step with the velocity, a whole one with the position; predict the velocity."""
    lanes = body.lanes
    for at in range(0, v.size, len(lanes)):
        gain = 0.5 * h * load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        between = load(lanes, v, at, 0) + gain
        store(lanes, v, at, between)
        store(lanes, work.predicted, at, between + gain)
        store(lanes, x, at, load(lanes, x, at, 0) + h * between)


@jit
def verlet_step(work: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    x, v, lanes = state.x, state.v, body.lanes
    if must_renew(work.clock, body.drives, t, h):
        evaluate(body, x, v, work.force, work.rates, t, t, t + h)
    book(state.ledger, lanes, work.rates, 0.5 * h)
    kick_and_drift(work, body, x, v, h)
    place_driven(body.drives, x, work.predicted, t + h, t, t + h)
    evaluate(body, x, work.predicted, work.force, work.rates, t + h, t, t + h)
    book(state.ledger, lanes, work.rates, 0.5 * h)
    half_kick(body, v, work.force, h)
    place_driven(body.drives, x, v, t + h, t, t + h)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not Verlet:
        return None
    return lambda scheme, body, state, t, h: verlet_step(scheme, body, state, t, h)
