"""Least squares kept as a triangle, to which rows are added one by one or in blocks.

The normal equations of n rows, ``R^T R w = R^T z``, are kept as their triangular factor
``[R z]``, never as the matrix ``R^T R`` or its inverse: what the rows have in digits is then not
halved, and the matrix that the factor stands for is positive definite by construction, whatever
rounding does. A row is rotated in, column by column (Givens; Golub & Van Loan, Matrix
Computations, sec. 6.5.3); a block is reflected in (Householder, LAPACK's ``tpqrt``).

The first column is the bias. What it explains, the mean, leaves the other columns before they
meet each other, so that small motion about a large offset keeps its digits.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

#: From this many rows on a block is faster than its rows.
LEAST_BLOCK = 8
#: Rows that are reflected in at once.
BLOCK = 256
#: Columns that LAPACK gathers into one reflection.
PANEL = 16


@cache
def _kernels() -> tuple[Any, Any]:
    """Compile what is done to single rows; the compiler is loaded on first use."""
    import numba

    def rotate_in(factor: Any, row: Any, keep: float) -> None:
        """Turn `row` into zeros against ``keep * factor``; both are changed."""
        n = factor.shape[0]
        for j in range(n):
            # Slices that begin where the loop does are what the compiler makes vectors of.
            line, rest = factor[j, j:], row[j:]
            diagonal, entry = keep * line[0], rest[0]
            length = math.sqrt(diagonal * diagonal + entry * entry)
            cosine = diagonal / length if length > 0.0 else 1.0
            sine = entry / length if length > 0.0 else 0.0
            kept, left = cosine * keep, sine * keep
            for k in range(len(line)):
                above, below = line[k], rest[k]
                line[k] = kept * above + sine * below
                rest[k] = cosine * below - left * above

    def solve(factor: Any, weights: Any) -> None:
        """Back substitution for all targets: weights (O, D)."""
        outputs, n = weights.shape
        for i in range(n - 1, -1, -1):
            line, diagonal = factor[i, i + 1 : n], factor[i, i]
            for o in range(outputs):
                known = weights[o, i + 1 :]
                total = 0.0
                for k in range(len(line)):
                    total += line[k] * known[k]
                rest = factor[i, n + o] - total
                weights[o, i] = rest / diagonal if diagonal != 0.0 else 0.0

    options = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}
    compiled = []
    for function in (rotate_in, solve):
        try:
            compiled.append(numba.njit(cache=True, **options)(function))
        except RuntimeError:
            # There is no folder in which the compiled code could be kept.
            compiled.append(numba.njit(**options)(function))
    return tuple(compiled)  # type: ignore[return-value]


class TriangularFactor:
    """Exponentially weighted least squares of O targets on a bias and F columns.

    After n rows it stands for the minimum over w and b of
    ``sum_i forgetting^(n - i) |y_i - x_i w - b|^2 + penalty |w|^2``.

    With forgetting, the penalty of the start would fade as well, and directions that the data
    have not excited for long would lose all hold (the wind-up of the covariance). So what fades
    is put back: each step adds rows ``sqrt(.) e_i`` for a few columns in turn, as many that
    every column has had its turn within one memory length ``1 / (1 - forgetting)``.

    Parameters
    ----------
    n_columns, n_targets : int
    penalty : float
        Above 0.
    forgetting : float
        In (0, 1].
    """

    def __init__(
        self, n_columns: int, n_targets: int, *, penalty: float, forgetting: float = 1.0
    ) -> None:
        size = 1 + n_columns + n_targets
        self.n_columns, self.n_targets = n_columns, n_targets
        self.keep = math.sqrt(forgetting)
        self.factor = np.zeros((size, size))
        columns = np.arange(1, 1 + n_columns)
        self.factor[columns, columns] = math.sqrt(penalty)
        self.n_rows = 0
        lost = 1.0 - forgetting
        self._renewed = min(n_columns, math.ceil(n_columns * lost)) if lost > 0.0 else 0
        share = n_columns * lost / self._renewed if self._renewed else 0.0
        self._renewal = math.sqrt(penalty * share)
        self._turn = 0
        self._row = np.zeros(size)

    @property
    def root(self) -> Reals:
        """The triangle R of bias and columns: (1 + F, 1 + F), up to the signs of its rows."""
        return np.triu(self.factor[: 1 + self.n_columns, : 1 + self.n_columns])

    def add_row(self, x: Reals, y: Reals) -> None:
        """Add one row: x (F,), y (O,)."""
        rotate_in, _ = _kernels()
        row, n = self._row, 1 + self.n_columns
        row[0] = 1.0
        row[1:n] = x
        row[n:] = y
        rotate_in(self.factor, row, self.keep)
        for _ in range(self._renewed):
            row[:] = 0.0
            row[1 + self._turn] = self._renewal
            self._turn = (self._turn + 1) % self.n_columns
            rotate_in(self.factor, row, 1.0)
        self.n_rows += 1

    def add_rows(self, x: Reals, y: Reals) -> None:
        """Add rows in their order: x (n, F), y (n, O)."""
        if len(x) < LEAST_BLOCK:
            for row, target in zip(x, y, strict=True):
                self.add_row(row, target)
            return
        for start in range(0, len(x), BLOCK):
            self._reflect_in(x[start : start + BLOCK], y[start : start + BLOCK])

    def _reflect_in(self, x: Reals, y: Reals) -> None:
        from scipy.linalg.lapack import dtpqrt

        count, n = len(x), 1 + self.n_columns
        extra = count * self._renewed
        rows = np.zeros((count + extra, len(self.factor)), order="F")
        rows[:count, 0] = 1.0
        rows[:count, 1:n] = x
        rows[:count, n:] = y
        if extra:
            turns = (self._turn + np.arange(extra)) % self.n_columns
            rows[count + np.arange(extra), 1 + turns] = self._renewal
            self._turn = int((turns[-1] + 1) % self.n_columns)
        if self.keep < 1.0:
            fade = self.keep ** np.arange(count - 1, -1, -1.0)
            rows[:count] *= fade[:, np.newaxis]
            rows[count:] *= np.repeat(fade, self._renewed)[:, np.newaxis]
        above = np.asfortranarray(self.factor * self.keep**count)
        above, _, _, _ = dtpqrt(
            0, min(PANEL, len(above)), above, rows, overwrite_a=True, overwrite_b=True
        )
        self.factor = np.ascontiguousarray(above)
        self.n_rows += count

    def solution(self) -> Reals:
        """Return bias and weights: (1 + F, O); the first row is the bias."""
        _, solve = _kernels()
        weights = np.zeros((self.n_targets, 1 + self.n_columns))
        if self.n_rows:
            solve(self.factor, weights)
        return weights.T
