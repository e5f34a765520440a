"""Equilibria of a body along a path: what a point of it is, and the steps that lead to one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics import StaticProblem
    from openprc.demlat.statics.symmetric_factors import SymmetricFactors

    Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """How a path is followed.

    Parameters
    ----------
    tolerance : float
        An increment has converged when a correction is shorter than this, relative to the
        median bar length (Euclidean norm over all free degrees of freedom).
    max_iterations : int
        After which the step is halved.
    least_step : float
        Share of the first step, below which the search is given up.
    longest_step : float
        Largest displacement of a node in one iteration, in median bar lengths.
    """

    tolerance: float = 1e-6
    max_iterations: int = 15
    least_step: float = 1e-6
    longest_step: float = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """An equilibrium on a path.

    Attributes
    ----------
    positions : (N, 3) [m]
    factor : float [1]
        Of the reference load; 1 where all loads are followed as they are.
    reactions : (N, 3) [N]
        Forces of the supports and drives on the body, 0 at free axes.
    loads : (N, 3) [N]
        The factor times the reference load.
    residual : float [N]
        Largest force out of balance at a free axis.
    iterations : int
        Newton's, of the last step to this point.
    n_negative : int or None
        Negative eigenvalues of the stiffness matrix: 0 where the state is stable under what
        was controlled; it changes by one at limit points and simple bifurcations. None where
        rounding hides it.
    """

    positions: Floats
    factor: float
    reactions: Floats
    loads: Floats
    residual: float
    iterations: int
    n_negative: int | None


#: A force out of balance counts as rounding below this share of what bars can carry.
_ROUNDING = 1e-10


class StepFailed(Exception):
    """No equilibrium was reached with this step; a shorter one may do."""


class Balance:
    """Out-of-balance forces and tangents of a body under a factor times a reference load.

    Parameters
    ----------
    problem : StaticProblem
        Its own loads and weight act throughout.
    reference : (N, 3) [N], default 0
    settings : PathSettings, optional
    """

    def __init__(
        self,
        problem: StaticProblem,
        reference: Floats | None = None,
        *,
        settings: PathSettings | None = None,
    ) -> None:
        self.problem = problem
        self.settings = settings or PathSettings()
        shape = problem.positions.shape
        self.reference = np.zeros(shape) if reference is None else reference
        self.free_reference = self.reference.ravel()[problem.free]
        self.least = self.settings.tolerance * problem.length_scale
        self.longest = self.settings.longest_step * problem.length_scale
        hinges = problem.geometry.hinges
        self._walled = np.flatnonzero(hinges.law == "enhanced-linear")

    def out_of_balance(self, x: Floats, factor: float) -> Floats:
        """Return the force that nothing balances at free axes: (n_free,) [N]."""
        gradient: Floats = self.problem.gradient(x).ravel()[self.problem.free]
        return factor * self.free_reference - gradient

    def factors(self, x: Floats) -> SymmetricFactors:
        """Factorise the stiffness matrix at `x` (N, 3) [m]."""
        from openprc.demlat.statics.symmetric_factors import (  # noqa: PLC0415 - loads scipy
            SymmetricFactors,
        )

        return SymmetricFactors(self.problem.hessian(x))

    def moved(self, x: Floats, step: Floats) -> Floats:
        """Return `x` with its free axes moved by `step` (n_free,) [m].

        Raises
        ------
        StepFailed
            When the step is not finite, or a panel would pass through another one.
        """
        if not np.isfinite(step).all():
            raise StepFailed("the stiffness matrix is singular")
        result = x.copy()
        result.reshape(-1)[self.problem.free] += step
        if len(self._walled):
            jump = np.abs(self.problem.bends(result) - self.problem.bends(x))[self._walled]
            if (jump > np.pi).any():
                raise StepFailed("panels would pass through each other")
        return result

    def allowed_share(self, step: Floats) -> float:
        """Return the share of a step (n_free,) [m] that moves no node too far, at most 1."""
        size = float(np.abs(step).max(initial=0.0))
        return self.longest / size if size > self.longest else 1.0

    def under(self, loads: Floats) -> Balance:
        """Return the balance of the same body under another reference load (N, 3) [N]."""
        return Balance(self.problem, loads, settings=self.settings)

    def point(
        self, x: Floats, factor: float, *, iterations: int, n_negative: int | None
    ) -> PathPoint:
        """Return what is recorded of an equilibrium."""
        loads = factor * self.reference
        forces = self.problem.gradient(x) - loads
        held = self.problem.held
        return PathPoint(
            positions=x,
            factor=factor,
            reactions=np.where(held, forces, 0.0),
            loads=loads,
            residual=float(np.abs(forces[~held]).max(initial=0.0)),
            iterations=iterations,
            n_negative=n_negative,
        )


def newton(balance: Balance, x: Floats, *, factor: float = 1.0) -> tuple[Floats, int, int | None]:
    """Return the equilibrium near `x` (N, 3) [m] under `factor` times the reference load.

    Returns
    -------
    positions, iterations, n_negative

    Raises
    ------
    StepFailed
        When the iterations allowed are not enough, or go astray.
    NotConverged
        When an element collapses on the way.
    """
    allowed = balance.settings.max_iterations
    for iteration in range(1, allowed + 1):
        tangent = balance.factors(x)
        step = tangent.solve(balance.out_of_balance(x, factor))
        share = balance.allowed_share(step)
        x = balance.moved(x, share * step)
        if share * float(np.linalg.norm(step)) < balance.least:
            # What the tangent at hand still improves costs no factorisation.
            x = balance.moved(x, tangent.solve(balance.out_of_balance(x, factor)))
            return x, iteration, tangent.n_negative
    raise StepFailed(f"{allowed} iterations were not enough")


def starting_state(balance: Balance, *, factor: float) -> tuple[Floats, int | None]:
    """Return the equilibrium to begin with, and the number of its negative eigenvalues.

    The positions of the problem themselves where they are in balance, else what Newton's
    method, and failing that the descent of the energy, lead to from there.

    Raises
    ------
    NotConverged
        When there is none.
    """
    problem = balance.problem
    x, bars = problem.positions, problem.geometry.bars
    tangent = balance.factors(x)
    wrong = balance.out_of_balance(x, factor)
    strong = float((bars.stiffness * bars.relaxed_length).max(initial=0.0))
    if (
        np.abs(wrong).max(initial=0.0) <= _ROUNDING * strong
        or float(np.linalg.norm(tangent.solve(wrong))) < balance.least
    ):
        return x.copy(), tangent.n_negative
    try:
        x, _, n_negative = newton(balance, x.copy(), factor=factor)
    except StepFailed:
        x, n_negative = lowest_nearby(balance, x, factor=factor), 0
    return x, n_negative


def lowest_nearby(balance: Balance, x: Floats, *, factor: float = 1.0) -> Floats:
    """Return the minimum of energy downhill from `x` (N, 3) [m], held axes where they are.

    Raises
    ------
    NotConverged
        When there is none.
    """
    from openprc.demlat.statics import find_equilibrium  # noqa: PLC0415 - loads scipy

    problem = balance.problem
    loads = problem.loads + factor * balance.reference
    found: Floats = find_equilibrium(
        replace(problem, loads=loads, positions=x), kind="minimum"
    ).positions
    return found


def gave_up(where: str, failed: Exception, *, step: str, fix: str) -> NotConverged:
    """Return the error of a path that does not go on."""
    reason = failed.found if isinstance(failed, NotConverged) else str(failed)
    return NotConverged(
        f"no equilibrium at {where}: {reason}, and {step}",
        expected="an equilibrium near the one before; the frames up to there are kept",
        fix=fix,
    )
