"""Numerical ``L D L^T`` factorisation and solution, compiled, in place.

Row by row ("up-looking"): row k of L solves a triangular system with the rows above it
(Davis 2005, Algorithm 849, doi:10.1145/1114268.1114277). There is no pivoting, so the matrix
has to be positive definite or quasi-definite (Vanderbei 1995, doi:10.1137/0805005), where
every order of elimination has its factors.
"""

from __future__ import annotations

from openprc.demlat.compiled.jit import jit
from openprc.demlat.linear.symbolic import Factor, Reals

#: A pivot that is smaller than this, relative to the terms it is the difference of, is taken
#: for the zero of a dependent row.
PIVOT_TOLERANCE = 1e-13


@jit
def clear(factor: Factor) -> None:
    """Set the matrix to zero, before contributions are added to ``factor.values``."""
    for p in range(factor.values.size):
        factor.values[p] = 0.0


@jit
def factorise(factor: Factor, tolerance: float) -> tuple[int, int]:
    """Factorise the matrix in ``factor.values``, which stays as it is.

    Parameters
    ----------
    factor : Factor
    tolerance : float [1]
        Relative size at which a pivot counts as zero, e.g. `PIVOT_TOLERANCE`.

    Returns
    -------
    dropped : int
        Number of zero pivots: dependent rows. Their unknowns are set to 0 by `solve`, which
        solves the remaining system; when the right-hand side is consistent, that solves the
        whole one.
    negative : int
        Number of negative pivots, which is that of negative eigenvalues.
    """
    y = factor.column
    l_values = factor.l_values
    inverse_pivot = factor.inverse_pivot
    dropped = 0
    negative = 0
    for k in range(factor.order.size):
        for p in range(factor.start[k], factor.start[k + 1]):
            y[factor.row[p]] = factor.values[p]
        pivot = y[k]
        y[k] = 0.0
        size = abs(pivot)
        for q in range(factor.row_start[k], factor.row_start[k + 1]):
            i = factor.row_column[q]
            yi = y[i]
            y[i] = 0.0
            end = factor.row_position[q]
            for p in range(factor.l_start[i], end):
                y[factor.l_row[p]] -= l_values[p] * yi
            entry = yi * inverse_pivot[i]
            l_values[end] = entry
            pivot -= entry * yi
            size += abs(entry * yi)
        factor.relative_pivot[k] = abs(pivot) / size if size > 0.0 else 0.0
        # An infinite pivot, so to speak: it takes the row out, where a small one would return
        # rounding errors multiplied by its inverse.
        if abs(pivot) <= tolerance * size:
            inverse_pivot[k] = 0.0
            dropped += 1
        else:
            inverse_pivot[k] = 1.0 / pivot
            if pivot < 0.0:
                negative += 1
    return dropped, negative


@jit
def solve(factor: Factor, b: Reals) -> None:
    """Replace `b` (n,) by the solution of ``A x = b``; `factorise` comes first."""
    y = factor.vector
    l_row, l_values = factor.l_row, factor.l_values
    n = factor.order.size
    for k in range(n):
        y[k] = b[factor.order[k]]
    for k in range(n):
        yk = y[k]
        for p in range(factor.l_start[k], factor.l_start[k + 1]):
            y[l_row[p]] -= l_values[p] * yk
    for k in range(n - 1, -1, -1):
        yk = y[k] * factor.inverse_pivot[k]
        for p in range(factor.l_start[k], factor.l_start[k + 1]):
            yk -= l_values[p] * y[l_row[p]]
        y[k] = yk
        b[factor.order[k]] = yk


@jit
def multiply(factor: Factor, x: Reals, out: Reals) -> None:
    """Set `out` (n,) to ``A x``, from the unfactorised values."""
    for k in range(factor.order.size):
        out[k] = 0.0
    for k in range(factor.order.size):
        column = factor.order[k]
        total = 0.0
        for p in range(factor.start[k], factor.start[k + 1]):
            row = factor.order[factor.row[p]]
            total += factor.values[p] * x[row]
            if row != column:
                out[row] += factor.values[p] * x[column]
        out[column] += total


@jit
def refine(factor: Factor, b: Reals, x: Reals) -> float:
    """Improve the solution `x` of ``A x = b`` once; return the largest correction's size.

    One step of iterative refinement (Higham 2002, Accuracy and Stability of Numerical
    Algorithms, ch. 12, doi:10.1137/1.9780898718027) makes up for the missing pivoting.
    """
    residual = factor.residual
    multiply(factor, x, residual)
    for k in range(x.size):
        residual[k] = b[k] - residual[k]
    solve(factor, residual)
    largest = 0.0
    for k in range(x.size):
        x[k] += residual[k]
        largest = max(largest, abs(residual[k]))
    return largest
