"""Equilibria of a body along a path: what a point of it is, and the steps that lead to one."""

from __future__ import annotations

from dataclasses import dataclass
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
    residual: float
    iterations: int
    n_negative: int | None


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

    def point(
        self, x: Floats, factor: float, *, iterations: int, n_negative: int | None
    ) -> PathPoint:
        """Return what is recorded of an equilibrium."""
        forces = self.problem.gradient(x) - factor * self.reference
        free = np.abs(forces[~self.problem.held])
        return PathPoint(
            positions=x,
            factor=factor,
            reactions=np.where(self.problem.held, forces, 0.0),
            residual=float(free.max(initial=0.0)),
            iterations=iterations,
            n_negative=n_negative,
        )


def gave_up(where: str, reason: str, *, step: str, fix: str) -> NotConverged:
    """Return the error of a path that does not go on."""
    return NotConverged(
        f"no equilibrium at {where}: {reason}, and {step}",
        expected="an equilibrium near the one before; the frames up to there are kept",
        fix=fix,
    )
