"""Factors of an indefinite stiffness matrix, with the number of its negative eigenvalues."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse  # noqa: TID253 - sparse factorisations are what this module is for
from scipy.sparse.linalg import splu  # noqa: TID253 - as above

from openprc.demlat.statics.factorization import PIVOT_FLOOR, diagonal_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse.linalg import SuperLU

    Reals = NDArray[np.float64]

#: Added to a singular matrix, relative to its largest diagonal entry.
_SHIFT = 1e-11
#: A solution that leaves more than this share of the right-hand side calls for row exchanges.
_TRUSTED = 1e-10
#: A pivot this many times the largest diagonal entry comes from one that vanished before it.
_GROWTH = 1e4
#: Unknowns up to which eigenvalues are computed one by one where pivots do not tell.
_SMALL = 1000


class SymmetricFactors:
    """A symmetric matrix, definite or not, ready to be solved with.

    Without exchanges of rows the signs of the pivots are those of the eigenvalues (Sylvester's
    law of inertia). Where that loses too many digits, solutions come from a factorisation with
    exchanges instead. A singular matrix is shifted by a tiny multiple of the identity: along a
    mechanism the solution is then large, not undefined.

    Parameters
    ----------
    matrix : (n, n) sparse [N/m]

    Attributes
    ----------
    n_negative : int or None
        Eigenvalues below zero; None where rounding hides their number in a matrix too large to
        look at each of them.
    n_zero : int
        Eigenvalues that vanish within rounding.
    """

    def __init__(self, matrix: sparse.csr_array) -> None:
        self.matrix = matrix
        self.n_negative: int | None = 0
        self.n_zero = 0
        self._factors: SuperLU | None = None
        n = matrix.shape[0]
        if n == 0:
            return
        scale = diagonal_scale(matrix)
        plain, nothing = _unpivoted(matrix), 0.0
        if plain is None or (np.abs(plain[1]) <= PIVOT_FLOOR * scale).any():
            nothing = 2.0 * _SHIFT * scale
            self.matrix = sparse.csr_array(matrix + _SHIFT * scale * sparse.eye_array(n))
            plain = _unpivoted(self.matrix)
        pivots: Reals | None = None
        if plain is not None and _is_sound(self.matrix, *plain):
            self._factors, pivots = plain
        else:
            self._factors = splu(sparse.csc_array(self.matrix), permc_spec="MMD_AT_PLUS_A")
            if n <= _SMALL:
                pivots = np.linalg.eigvalsh(self.matrix.toarray())
        if pivots is None:
            self.n_negative = None
        else:
            self.n_negative = int((pivots < -nothing).sum())
            self.n_zero = int((np.abs(pivots) <= nothing).sum())

    def solve(self, right: Reals) -> Reals:
        """Return the solution for (n,) or (n, r) right-hand sides, refined once."""
        if self._factors is None:
            return np.zeros_like(right)
        found = self._factors.solve(right)
        refined: Reals = found + self._factors.solve(right - self.matrix @ found)
        return refined


def _unpivoted(matrix: sparse.csr_array) -> tuple[SuperLU, Reals] | None:
    """Return factors without exchanges of rows, and their pivots; None where there are none."""
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
    return factors, factors.U.diagonal()


def _is_sound(matrix: sparse.csr_array, factors: SuperLU, pivots: Reals) -> bool:
    """Tell whether a solution is good to some digits although no rows were exchanged."""
    if np.abs(pivots).max() > _GROWTH * diagonal_scale(matrix):
        return False
    right = np.cos(np.arange(matrix.shape[0], dtype=np.float64))  # no symmetry favours it
    found = factors.solve(right)
    left = float(np.abs(right - matrix @ found).max())
    # Backward error: what is left, against the sizes of the terms that should cancel.
    size = float(abs(matrix).sum(axis=1).max() * np.abs(found).max()) + 1.0
    return bool(np.isfinite(left) and left <= _TRUSTED * size)
