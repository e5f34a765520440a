"""Sparse symmetric systems: definiteness from the pivots, and steps along constraints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse  # noqa: TID253 - sparse factorisations are what this module is for
from scipy.sparse.linalg import splu  # noqa: TID253 - as above

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse.linalg import SuperLU

    from openprc.demlat.statics.assembly import StaticProblem

    Reals = NDArray[np.float64]

#: A pivot below this share of its diagonal entry counts as zero.
PIVOT_FLOOR = 1e-12
#: Penalty of the constraints, relative to the largest diagonal entry of the stiffness. Each
#: correction of the multipliers divides what is left of the violation by about this number.
PENALTY = 1e4
_CORRECTIONS = 6


def factor_definite(matrix: sparse.csr_array) -> SuperLU | None:
    """Return the factors of a symmetric matrix (n, n), or None unless it is positive definite.

    Without exchanges of rows the pivots have the signs of the eigenvalues (Sylvester's law of
    inertia), and for a positive definite matrix none are needed.
    """
    try:
        factors = splu(
            sparse.csc_array(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # the factorisation met an exactly singular column
        return None
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return None
    diagonal = np.empty(matrix.shape[0])
    diagonal[factors.perm_c] = matrix.diagonal()
    # perm_c[j] is where column j went, so this is the diagonal in the order of elimination.
    pivots = factors.U.diagonal()
    return factors if (pivots > PIVOT_FLOOR * np.abs(diagonal)).all() else None


class Constraints:
    """Linearised constraints ``A p = 0``, possibly redundant.

    Parameters
    ----------
    jacobian : (C, n) sparse, rows of about unit length
    damping : float
        Added to the diagonal of ``A A^T``; more makes `shortest` a shorter, safer step.
    """

    def __init__(self, jacobian: sparse.csr_array, *, damping: float = 0.0) -> None:
        self.jacobian = jacobian
        self.transpose = sparse.csr_array(jacobian.T)
        gram = jacobian @ self.transpose
        # Redundant constraints make the Gram matrix singular.
        shift = damping + 1e-12 * max(float(gram.diagonal().max(initial=0.0)), 1e-300)
        self._gram = splu(sparse.csc_array(gram + shift * sparse.eye_array(gram.shape[0])))
        self.normal = self.transpose @ jacobian

    def multipliers(self, gradient: Reals) -> Reals:
        """Return m with the smallest ``|gradient + A^T m|``: (C,)."""
        found = np.zeros(self.jacobian.shape[0])
        for _ in range(3):
            found -= self._gram.solve(self.jacobian @ (gradient + self.transpose @ found))
        return found

    def shortest(self, gaps: Reals) -> Reals:
        """Return the smallest p with ``A p = gaps``: (n,)."""
        step: Reals = self.transpose @ self._gram.solve(gaps)
        return step


def out_of_balance(
    problem: StaticProblem, positions: Reals
) -> tuple[Reals, Reals | None, Constraints | None]:
    """Return the force that nothing balances (n_free,) [N], multipliers (C,) and constraints.

    The multipliers are what rigid elements carry; the smallest set of them where redundant
    ones make it ambiguous.
    """
    gradient = problem.gradient(positions).ravel()[problem.free]
    if not problem.n_constraints:
        return gradient, None, None
    constraints = Constraints(problem.constraint_jacobian(positions))
    multipliers = constraints.multipliers(gradient)
    return gradient + constraints.transpose @ multipliers, multipliers, constraints


def diagonal_scale(matrix: sparse.csr_array) -> float:
    """Return the largest diagonal entry by size, or 1 when all are 0."""
    return float(np.abs(matrix.diagonal()).max(initial=0.0)) or 1.0


def definite_step(
    hessian: sparse.csr_array, residual: Reals, constraints: Constraints | None, shift: float
) -> Reals | None:
    """Return the minimiser of the shifted quadratic model along the constraints.

    With ``W = hessian + shift I`` it solves ``W p + A^T m = -residual, A p = 0`` by the method
    of multipliers: ``W + c A^T A`` is positive definite for large c exactly when W is so along
    the constraints (Nocedal & Wright, Numerical Optimization, ch. 16-17,
    doi:10.1007/978-0-387-40065-5). None when it is not.
    """
    scale = diagonal_scale(hessian)
    matrix = hessian + shift * sparse.eye_array(hessian.shape[0])
    if constraints is None:
        factors = factor_definite(matrix)
        return None if factors is None else factors.solve(-residual)
    penalty = PENALTY * (scale + shift)
    factors = factor_definite(matrix + penalty * constraints.normal)
    if factors is None:
        return None
    multipliers = np.zeros(constraints.jacobian.shape[0])
    for _ in range(_CORRECTIONS):
        step = factors.solve(-residual - constraints.transpose @ multipliers)
        multipliers += penalty * (constraints.jacobian @ step)
    return step


def stationary_step(
    hessian: sparse.csr_array, residual: Reals, constraints: Constraints | None
) -> Reals | None:
    """Return Newton's step towards the next stationary point, or None if there is none.

    A shift far below the stiffness keeps rigid-body motion from making the matrix singular.
    """
    n = hessian.shape[0]
    scale = diagonal_scale(hessian)
    matrix = hessian + 1e-11 * scale * sparse.eye_array(n)
    right = -residual
    if constraints is not None:
        count = constraints.jacobian.shape[0]
        corner = sparse.csr_array(sparse.eye_array(count) * (-1e-11 / scale))
        matrix = sparse.block_array(
            [[matrix, constraints.transpose], [constraints.jacobian, corner]]
        )
        right = np.concatenate([right, np.zeros(count)])
    try:
        return splu(sparse.csc_array(matrix)).solve(right)[:n]
    except RuntimeError:  # exactly singular
        return None
