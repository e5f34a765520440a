"""Newton's method on the energy, along the constraints of rigid elements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.demlat.statics.bending import bend_slopes
from openprc.demlat.statics.element_shapes import hinge_gradients
from openprc.demlat.statics.factorization import (
    Constraints,
    definite_step,
    diagonal_scale,
    out_of_balance,
    stationary_step,
)
from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy import sparse

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]

_EPS = float(np.finfo(np.float64).eps)
#: Share of the predicted gain that a step has to make (Armijo).
_SUFFICIENT = 1e-4
_HALVINGS = 40
#: A hinge's wing closer to its crease than this part of a bar counts as being there.
_STEEPEST = 1e3
#: Rounding may hide forces up to this share of those that elements can exert.
_HIDDEN = 1e-6
#: Steps to bring rigid elements of a start together.
_FITTING = 200
#: Steps after convergence, as long as each divides the residual by this.
_POLISH, _POLISH_GAIN = 3, 4.0


@dataclass(frozen=True)
class State:
    """What is known at a configuration.

    Attributes
    ----------
    energy : float [J]
    noise : float [J]
        Rounding of the energy.
    residual : (n_free,) [N]
        Gradient, less what rigid elements carry.
    size, limit : float [N]
        Largest entry of the residual, and where it counts as zero.
    multipliers : (C,) or None
    constraints : Constraints or None
    hessian : (n_free, n_free) [N/m]
    """

    energy: float
    noise: float
    residual: Reals
    size: float
    limit: float
    multipliers: Reals | None
    constraints: Constraints | None
    hessian: sparse.csr_array


class Descent:
    """A search for an equilibrium of one problem.

    Parameters
    ----------
    problem : StaticProblem
    tolerance : float
        Relative to the largest force.
    force_tolerance : float [N]
        A residual below it counts as zero anyway.
    max_step : float [m], optional
    kind : {"minimum", "stationary"}
    """

    def __init__(
        self,
        problem: StaticProblem,
        *,
        tolerance: float,
        force_tolerance: float = 0.0,
        max_step: float | None = None,
        kind: Literal["minimum", "stationary"] = "minimum",
    ) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.force_tolerance = force_tolerance
        self.kind = kind
        self.max_step = 0.5 * problem.length_scale if max_step is None else max_step
        self._shift = 0.0
        self._polish_reach = 1e-3 * problem.length_scale

    def state(self, x: Reals) -> State:
        """Evaluate everything at positions `x` (N, 3) [m]."""
        problem = self.problem
        parts = problem.energies(x)
        residual, multipliers, constraints = out_of_balance(problem, x)
        hessian = problem.hessian(x, multipliers)
        return State(
            energy=float(sum(part.sum() for part in parts)),
            noise=8.0 * _EPS * float(sum(np.abs(part).sum() for part in parts)),
            residual=residual,
            size=float(np.abs(residual).max(initial=0.0)),
            limit=self._limit(x, hessian, multipliers),
            multipliers=multipliers,
            constraints=constraints,
            hessian=hessian,
        )

    def _limit(self, x: Reals, hessian: sparse.csr_array, multipliers: Reals | None) -> float:
        """Return which force counts as zero, from the forces of elements and from rounding.

        An element counts at most with the force that doubles its length or turns it once, so
        that one that is crushed to nothing does not let everything else pass.
        """
        problem = self.problem
        bars, hinges = problem.geometry.bars, problem.geometry.hinges
        applied = np.abs(problem.applied).max(initial=0.0)
        present, possible = [applied], [applied]
        strong = bars.stiffness * bars.relaxed_length
        present.append(np.minimum(np.abs(problem.bar_forces(x)), strong).max(initial=0.0))
        possible.append(strong.max(initial=0.0))
        if len(hinges):
            slope = np.abs(hinge_gradients(x, hinges.indices)).max(axis=(1, 2))
            slope = np.minimum(slope, _STEEPEST / problem.length_scale)
            turn = 2.0 * np.pi * hinges.stiffness
            present.append((slope * np.minimum(np.abs(problem.hinge_moments(x)), turn)).max())
            possible.append((slope * turn).max())
        bends = problem.geometry.bends
        if len(bends):
            slope = np.abs(bend_slopes(x, bends.indices))
            slope = np.minimum(slope, _STEEPEST / problem.length_scale)
            turn = np.pi * bends.stiffness
            present.append((slope * np.abs(problem.bend_torques(x))).max())
            possible.append((slope * turn).max())
        if multipliers is not None:
            present.append(np.abs(multipliers).max())
            possible.append(present[-1])
        stiffest = float(np.abs(hessian.diagonal()).max(initial=0.0))
        rounding = 16.0 * _EPS * stiffest * float(np.abs(x).max())
        # Rounding that hides every sensible force is no excuse.
        rounding = min(rounding, _HIDDEN * float(max(possible)))
        return max(self.tolerance * float(max(present)), rounding, self.force_tolerance)

    # --- the iteration ------------------------------------------------------------------------

    def run(self, x: Reals, *, max_iterations: int) -> tuple[Reals, int]:
        """Return an equilibrium and how many iterations it took.

        Raises
        ------
        NotConverged
            When `max_iterations` do not suffice, or no step makes progress.
        """
        x = self._satisfy_constraints(x)
        if len(self.problem.free) == 0:
            return x, 0
        state = self.state(x)
        polish = 0
        for iteration in range(max_iterations + 1):
            converged = state.size <= state.limit
            if converged and (polish == _POLISH or state.size == 0.0):
                return x, iteration
            step = self._step(state)
            if converged:
                # The limit is met; further digits are taken as long as they come fast and near.
                near = step is not None and np.abs(step).max() < self._polish_reach
                trial = self._move(x, state, step) if step is not None and near else None
                better = None if trial is None else self._try(trial)
                gained = better is not None and better.size * _POLISH_GAIN < state.size
                if trial is None or better is None or not gained:
                    return x, iteration
                x, state, polish = trial, better, polish + 1
                continue
            moved = None if step is None else self._search(x, state, step)
            if moved is None:
                raise self._failure(state, iteration, "no step makes progress")
            x, state = moved
        raise self._failure(state, max_iterations, "the iterations are used up")

    def _step(self, state: State) -> Reals | None:
        """Return Newton's step, shifted where the energy is not convex: (n_free,) [m]."""
        if self.kind == "stationary":
            return stationary_step(state.hessian, state.residual, state.constraints)
        scale = diagonal_scale(state.hessian)
        shift = self._shift if self._shift > 1e-9 * scale else 0.0
        for _ in range(40):
            step = definite_step(state.hessian, state.residual, state.constraints, shift)
            if step is not None:
                self._shift = shift / 10.0
                return step
            shift = max(4.0 * shift, 1e-10 * scale)
        return None

    def _search(self, x: Reals, state: State, step: Reals) -> tuple[Reals, State] | None:
        """Shorten the step until it makes progress; None when it never does."""
        longest = float(np.abs(step).max())
        length = min(1.0, self.max_step / longest) if longest > 0 else 1.0
        slope = float(state.residual @ step)
        for _ in range(_HALVINGS):
            moved = self._move(x, state, length * step)
            trial = None if moved is None else self._try(moved)
            if moved is not None and trial and self._accepts(state, trial, length * slope):
                return moved, trial
            length *= 0.5
        return None

    def _try(self, x: Reals) -> State | None:
        """Evaluate a trial; None where a bar or hinge has collapsed."""
        try:
            return self.state(x)
        except NotConverged:  # a shorter step stays clear of it
            return None

    def _accepts(self, old: State, new: State, gain: float) -> bool:
        if not np.isfinite(new.energy) or not np.isfinite(new.size):
            return False
        if self.kind == "stationary":
            return float(np.linalg.norm(new.residual)) < float(np.linalg.norm(old.residual))
        noise = max(old.noise, new.noise)
        if -_SUFFICIENT * gain > noise:
            return new.energy <= old.energy + _SUFFICIENT * gain
        # Energies no longer tell the two apart; their slopes do.
        return new.energy <= old.energy + noise and new.size < old.size

    def _move(self, x: Reals, state: State, step: Reals) -> Reals | None:
        """Return `x` moved and put back on the constraints, or None where that fails."""
        problem = self.problem
        moved = x.copy()
        moved.reshape(-1)[problem.free] += step
        if state.constraints is not None:
            settled = self._pull_back(moved, state.constraints)
            if settled is None:
                return None
            moved = settled
        hinges = problem.geometry.hinges
        walled = hinges.law == "enhanced-linear"
        if walled.any():
            # Beyond folded shut the panels have passed through each other.
            jump = np.abs(problem.bends(moved) - problem.bends(x))
            if (jump[walled] > np.pi).any():
                return None
        return moved

    def _pull_back(self, x: Reals, constraints: Constraints) -> Reals | None:
        """Return the point of the constraints near `x`, with Jacobians of the step's start."""
        limit = 8.0 * _EPS * max(float(np.abs(x).max()), self.problem.length_scale)
        x, last = x.copy(), np.inf
        for _ in range(60):
            gaps = self.problem.constraints(x)
            size = float(np.abs(gaps).max())
            if size <= limit or (size < 1e3 * limit and size > 0.5 * last):
                return x
            if not size < 4.0 * last:
                return None
            last = min(size, last)
            x.reshape(-1)[self.problem.free] -= constraints.shortest(gaps)
        return None

    def _satisfy_constraints(self, x: Reals) -> Reals:
        """Bring rigid elements of the start to their lengths and angles."""
        if not self.problem.n_constraints:
            return x
        gaps, damping = self.problem.constraints(x), 1e-3
        for _ in range(_FITTING):
            jacobian = self.problem.constraint_jacobian(x)
            settled = self._pull_back(x, Constraints(jacobian))
            if settled is not None:
                return settled
            # Levenberg and Marquardt's step, since the start may be far away.
            moved = x.copy()
            fitted = Constraints(jacobian, damping=damping).shortest(gaps)
            moved.reshape(-1)[self.problem.free] -= fitted
            trial = self.problem.constraints(moved)
            if float(trial @ trial) < float(gaps @ gaps):
                x, gaps, damping = moved, trial, 0.1 * damping
            else:
                damping = 10.0 * damping
            if damping > 1e12:
                break
        size = float(np.abs(gaps).max())
        raise NotConverged(
            f"rigid elements cannot all have their length or angle: {size:.3g} m are left",
            expected="rigid bars and hinges that fit together with what is held",
            fix="check their rest lengths and rest angles, or make some of them soft",
        )

    def leave_saddle(self, x: Reals, direction: Reals) -> Reals:
        """Return positions beside a saddle, on the side where the energy is lower."""
        reach = 0.02 * self.problem.length_scale / max(float(np.abs(direction).max()), 1e-300)
        state = self.state(x)
        step = reach * direction.ravel()[self.problem.free]
        for _ in range(_HALVINGS):
            sides = [self._move(x, state, sign * step) for sign in (1.0, -1.0)]
            found = [side for side in sides if side is not None]
            if found:
                best = min(found, key=self.problem.energy)
                if self.problem.energy(best) < state.energy:
                    return best
            step = 0.5 * step
        raise NotConverged(
            "a saddle whose direction of lower energy leads nowhere",
            expected="lower energy beside it",
            fix="start elsewhere, or ask for kind='stationary'",
        )

    def _failure(self, state: State, iterations: int, why: str) -> NotConverged:
        worst = int(np.abs(state.residual).argmax())
        node, axis = divmod(int(self.problem.free[worst]), 3)
        return NotConverged(
            f"no equilibrium after {iterations} iterations ({why}): {state.size:.3g} N are out"
            f" of balance along {'xyz'[axis]} of node {node}",
            expected=f"at most {state.limit:.3g} N",
            fix="start nearer, move held axes in more load_steps, or allow a force_tolerance",
        )
