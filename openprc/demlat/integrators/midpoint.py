"""The implicit midpoint rule: second order, stable at any step.

Forces are those of the middle of the step, where positions and velocities are the means of
start and end; for linear bodies energy is conserved exactly (and dissipated exactly as much as
the dampers take), whatever the step, so vibrations that it cannot resolve stay bounded. They
do not die out either: for a body at rest under slow loads give the bars damping.

The mean velocity is solved for by Newton's method with a sparse factorisation of
``M + h/2 C + h^2/4 K``. The factor is kept from iteration to iteration, and from step to step,
for as long as it gains a factor of `GAIN` each time. Where the iteration fails, the tangent is
made definite by leaving out what compression and moments do to it, and then the step is taken
in halves.

Driven coordinates move along the chord of their step. Source: Hairer, Lubich & Wanner,
Geometric Numerical Integration, sec. II.1 and VI.4, doi:10.1007/3-540-30666-8.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.integrators.tangents import Tangent, assemble
from openprc.demlat.linear.ldl import factorise, solve
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import Body, Reals
from openprc.errors import Diverged

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.schema.experiment import Experiment

#: Corrections of positions that are rounding, relative to the largest coordinate.
ROUNDING = 1e-14
#: An iteration is done when the next correction would be below this, relative likewise.
DONE = 1e-12
#: It has stalled in rounding when corrections this small stop shrinking.
STALLED = 1e-9
#: Shrinking of corrections that is not worth a new factorisation.
GAIN = 0.1
ITERATIONS = 25
#: A step is divided into at most so many.
PIECES = 4096

# Entries of the clock: h of the factor, whether it is a definite one.
FACTOR_H, DEFINITE = range(2)
# Entries of the counts.
FAILED, WORST, STEPS, SOLVES, FACTORISATIONS, HALVINGS = range(6)


class Midpoint(NamedTuple):
    """Work arrays: state in the middle, driven coordinates at the end, force, powers; tangent.

    `clock` says which step the factor is for; `counts` what was done so far, and whether a
    step failed and at which coordinate.
    """

    x: Reals
    v: Reals
    end_x: Reals
    end_v: Reals
    force: Reals
    rates: Reals | None
    tangent: Tangent
    clock: Reals
    counts: NDArray[np.int64]

    can_fail = True

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> Midpoint:
        """Return work arrays for `body`."""
        return cls(
            *(np.zeros_like(body.mass) for _ in range(5)),
            make_rates(body, settings),
            Tangent.for_body(body),
            np.zeros(2),
            np.zeros(6, dtype=np.int64),
        )

    def explain(self, experiment: Experiment, assembly: Assembly, time: float) -> Diverged:
        """Return the error for a step that could not be taken."""
        axis, node = divmod(int(self.counts[WORST]), assembly.packing.stride)
        return Diverged(
            f"the implicit step before t = {time:.6g} s has no solution that Newton's method"
            f" finds, even in {PIECES} pieces: node {node} does not settle along {'xyz'[axis]}",
            expected="forces that depend smoothly on the motion",
            fix="look for elements that collapse or fold shut there; a smaller dt or rk4 shows"
            " how they come to it",
            key="simulation.dt",
        )


@jit
def _renew(work: Any, body: Any, h: float, definite: bool) -> bool:
    """Factorise the tangent at the middle of the step; say whether it is definite."""
    work.clock[FACTOR_H] = h
    work.counts[FACTORISATIONS] += 1
    assemble(work.tangent, body, work.x, work.v, 0.25 * h * h, 0.5 * h, definite)
    dropped, negative = factorise(work.tangent.factor, 0.0)
    return dropped == 0 and negative == 0


@jit
def _correct(work: Any, body: Any, state: Any, h: float) -> float:
    """Take one Newton correction of the mean velocity; return the largest one of a position."""
    tangent = work.tangent
    right = tangent.right
    for u in range(right.size):
        at = tangent.free[u]
        inertia = body.mass[at] * (work.v[at] - state.v[at])
        right[u] = 0.5 * h * work.force[at] - inertia
    solve(tangent.factor, right)
    work.counts[SOLVES] += 1
    largest = 0.0
    worst = work.counts[WORST]
    for u in range(right.size):
        at = tangent.free[u]
        work.v[at] += right[u]
        work.x[at] = state.x[at] + 0.5 * h * work.v[at]
        size = abs(right[u])
        if size > largest or size != size:
            largest, worst = size, at
    work.counts[WORST] = worst
    return 0.5 * h * largest


@jit
def _settle(work: Any, body: Any, state: Any, t: float, h: float, ends: Any, definite: bool) -> Any:
    """Iterate from the velocities at the start; say whether that converged."""
    scale = 0.0
    for u in range(work.tangent.free.size):
        at = work.tangent.free[u]
        work.v[at] = state.v[at]
        work.x[at] = state.x[at] + 0.5 * h * state.v[at]
        scale = max(scale, abs(state.x[at]))
    scale = max(scale, 1.0)  # lengths are of the order of one
    fresh = work.clock[FACTOR_H] == h and not definite
    before = 0.0
    for iteration in range(ITERATIONS):
        evaluate(body, work.x, work.v, work.force, work.rates, t + 0.5 * h, ends[0], ends[1])
        if not fresh:
            fresh = _renew(work, body, h, definite) or definite
            if not fresh:
                _renew(work, body, h, True)
                fresh = True
        size = _correct(work, body, state, h) / scale
        if not size < 1e3:
            return False
        if size <= ROUNDING:
            return True
        if iteration > 0:
            ratio = size / before
            if ratio < 1.0 and size * ratio / (1.0 - ratio) <= DONE:
                return True
            if ratio > 0.5 and size <= STALLED:
                return True
            fresh = ratio < GAIN
        before = size
    return False


@jit
def _step_once(work: Any, body: Any, state: Any, t: float, h: float, ends: Any) -> bool:
    """Advance `state` from `t` to ``t + h``, if the iteration converges."""
    for at in range(work.x.size):
        work.end_x[at], work.end_v[at] = state.x[at], state.v[at]
    place_driven(body.drives, work.end_x, work.end_v, t + h, ends[0], ends[1])
    for at in range(work.x.size):
        # Of held coordinates; the others are set where the iteration begins.
        work.x[at] = 0.5 * (state.x[at] + work.end_x[at])
        work.v[at] = (work.end_x[at] - state.x[at]) / h
    settled = _settle(work, body, state, t, h, ends, False)
    if not settled:
        settled = _settle(work, body, state, t, h, ends, True)
        work.clock[FACTOR_H] = 0.0
    if settled:
        book(state.ledger, body.lanes, work.rates, h)
        for u in range(work.tangent.free.size):
            at = work.tangent.free[u]
            state.x[at] += h * work.v[at]
            state.v[at] = 2.0 * work.v[at] - state.v[at]
        place_driven(body.drives, state.x, state.v, t + h, ends[0], ends[1])
    return settled


def midpoint_step(scheme: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``, in pieces where it must be."""
    done, piece = 0, PIECES
    while done < PIECES:
        start, size = t + h * (done / PIECES), h * (piece / PIECES)
        if _step_once(scheme, body, state, start, size, (t, t + h)):
            done += piece
            scheme.counts[STEPS] += 1
            # Pieces are powers of two and stand at multiples of themselves.
            if piece < PIECES and done % (2 * piece) == 0:
                piece *= 2
        elif piece > 1:
            piece //= 2
            scheme.counts[HALVINGS] += 1
        else:
            scheme.counts[FAILED] = 1
            return


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not Midpoint:
        return None
    return midpoint_step


@chosen_by_type(stepping.failed)
def _failed(scheme, body):
    if scheme.instance_class is not Midpoint:
        return None
    return lambda scheme, body: scheme.counts[FAILED] > 0
