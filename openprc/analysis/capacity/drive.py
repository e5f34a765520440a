"""Whether the drive allows capacities to be added up at all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError

if TYPE_CHECKING:
    from openprc.reservoir.io.whiteness import Whiteness

Coloured = Literal["adapt", "refuse", "ignore"]
Correlated = Literal["refuse", "whiten"]


class CapacityWarning(UserWarning):
    """A capacity that means less than it seems."""


def checked_input(u: ArrayLike, n_rows: int) -> NDArray[np.float64]:
    """Return the input as (T, C).

    Raises
    ------
    TaskError
        When it is not one finite value (or row) per row of the states.
    """
    values = np.asarray(u, dtype=np.float64)
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or not values.shape[1] or len(values) != n_rows:
        raise TaskError(
            f"the input has shape {np.shape(u)} and there are {n_rows} rows of states",
            expected=f"({n_rows},), or ({n_rows}, C) for C inputs",
            fix="give one value per row of the states",
            key="u",
        )
    if not np.isfinite(values).all():
        bad = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
        raise TaskError(
            f"{bad} of {len(values)} input values are NaN or infinite",
            expected="finite numbers",
            fix="read the input from the file of the states",
            key="u",
        )
    return values


def uncorrelated_inputs(
    u: NDArray[np.float64], *, correlated: Correlated = "refuse"
) -> tuple[NDArray[np.float64], str]:
    """Return inputs (T, C) without correlation to each other, and a remark.

    Products across inputs are orthogonal only where the inputs are independent. Whitening by
    a Cholesky factor, in which each column loses what the earlier ones say about it, removes
    correlation, which is independence for Gaussian inputs only.

    Raises
    ------
    TaskError
        When inputs are correlated and that is refused, or one is a copy of others.
    """
    if correlated not in ("refuse", "whiten"):
        raise TaskError(
            f"correlated is {correlated!r}",
            expected="refuse or whiten",
            fix="choose one of these",
            key="correlated",
        )
    if u.shape[1] == 1:
        return u, ""
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = np.corrcoef(u, rowvar=False)
    if not np.isfinite(matrix).all():
        column = int(np.flatnonzero(~np.isfinite(np.diag(matrix)))[0])
        raise TaskError(
            f"input {column} does not vary",
            expected="inputs that all drive the body",
            fix="leave that column out",
            key="u",
        )
    off = np.abs(matrix - np.eye(len(matrix)))
    worst = float(off.max())
    # Among many pairs of independent inputs some are correlated by chance, with p = 1e-3.
    pairs = len(matrix) * (len(matrix) - 1) / 2
    if worst <= max(0.05, float(np.sqrt(2.0 * np.log(2e3 * pairs) / len(u)))):
        return u, ""
    i, j = (int(k) for k in np.unravel_index(off.argmax(), off.shape))
    found = f"inputs {min(i, j)} and {max(i, j)} are correlated ({matrix[i, j]:.3f})"
    if correlated == "refuse":
        raise TaskError(
            f"{found}, so targets of one are in part targets of the other",
            expected="independent inputs",
            fix='drive with independent signals, or pass correlated="whiten" to count, for each '
            "input, what the earlier ones do not say",
            key="u",
        )
    standard = (u - u.mean(axis=0)) / u.std(axis=0)
    if np.linalg.eigvalsh(matrix)[0] < 1e-8:
        raise TaskError(
            f"{found}; one of them is a combination of the others",
            expected="inputs that are not copies",
            fix="leave the copy out",
            key="u",
        )
    factor = np.linalg.cholesky(standard.T @ standard / len(u))
    return np.linalg.solve(factor, standard.T).T, f"{found}; they were whitened in their order"


def drive_warning(whiteness: Whiteness, estimator: str) -> str:
    """Return what a drive that is not white does to capacities, and what was done about it."""
    done = (
        "totals are of exactly orthonormalised targets, and thresholds of circular shifts"
        if estimator == "insample"
        else "thresholds are of circular shifts, and the sum of held-out capacities means nothing"
    )
    return (
        f"{whiteness.sentence}: past inputs can be read off the present one, so raw capacities "
        f"count the same information many times; {done}. For capacities that mean memory, drive "
        "with independent symbols and take one row per symbol"
    )


def refused_drive(whiteness: Whiteness) -> TaskError:
    """Return the error for a drive that is not white."""
    return TaskError(
        f"{whiteness.sentence}, so that sums of capacities are inflated",
        expected="independent values from row to row",
        fix="take one row per symbol of the input (a clock of symbols), drive with independent "
        'symbols, or pass coloured="adapt" for exactly orthonormalised targets',
        key="u",
    )


def check_sum(total: float, *, n_counted: int, rank: int, n_rows: int) -> str:
    """Return what is wrong with a sum of capacities, or nothing.

    K orthonormal targets hold no more than the rank together. Targets that are orthonormal
    only on average, over T rows of white noise, have Gram eigenvalues up to
    ``(1 + sqrt(K/T))^2`` (Marchenko and Pastur 1967, doi:10.1070/SM1967v001n04ABEH001994), and
    that factor is the tolerance.
    """
    most = rank * (1.0 + np.sqrt(n_counted / n_rows)) ** 2
    if total <= most * (1 + 1e-9):
        return ""
    return (
        f"the capacities above threshold sum to {total:.4g}, and linear readouts of {rank} "
        f"independent states have no more than {rank} (here, with {n_counted} targets over "
        f"{n_rows} rows, {most:.4g}): the targets overlap"
    )
