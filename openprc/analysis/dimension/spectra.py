"""How many independent directions the states of a body have, and how well they are told apart.

Every figure here comes from one singular value decomposition of the centred states, never from
their Gram matrix: squaring would lose the directions below 1e-8 of the largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.features.base import is_constant

SpectrumKind = Literal["eigenvalues", "singular"]
_SHARES = (0.90, 0.95, 0.99)


@dataclass(frozen=True)
class StateSpectrum:
    """Singular values of a centred state matrix, and what follows from them.

    Parameters
    ----------
    singular_values : (min(T, F),) float64
        In descending order, of the F columns that change. Columns were centred, and divided by
        their standard deviation where `standardized`.
    n_rows, n_columns : int
        T, and the number of columns before constant ones were left out.
    constant : tuple of int
        Positions of the columns that never change; they are left out of everything.
    tolerance : float
        Singular values up to here are indistinguishable from rounding errors; see
        `state_spectrum`.
    standardized : bool
        Whether the spectrum is that of the correlation matrix, or of the covariance matrix.
    """

    singular_values: NDArray[np.float64]
    n_rows: int
    n_columns: int
    constant: tuple[int, ...]
    tolerance: float
    standardized: bool

    @property
    def n_changing(self) -> int:
        """Number of columns that change, F."""
        return self.n_columns - len(self.constant)

    @property
    def eigenvalues(self) -> NDArray[np.float64]:
        """Eigenvalues of the correlation (or covariance) matrix, (F,), in descending order.

        With fewer rows than columns the last ones are zero.
        """
        values = np.zeros(self.n_changing)
        values[: len(self.singular_values)] = self.singular_values**2 / self.n_rows
        return values

    def effective_rank(self, *, spectrum: SpectrumKind = "eigenvalues") -> float:
        """Return the exponential of the entropy of the spectrum; see `effective_rank`."""
        if spectrum not in ("eigenvalues", "singular"):
            raise TaskError(
                f"spectrum is {spectrum!r}",
                expected="eigenvalues or singular",
                fix="choose one of these; they give different numbers",
                key="spectrum",
            )
        values = self.eigenvalues if spectrum == "eigenvalues" else self.singular_values
        shares = values / values.sum()
        shares = shares[shares > 0]
        return float(np.exp(-np.sum(shares * np.log(shares))))

    @property
    def condition_number(self) -> float:
        """Largest over smallest eigenvalue; infinite when singular. See `condition_number`."""
        if self.numerical_rank() < self.n_changing:
            return float("inf")
        return float((self.singular_values[0] / self.singular_values[-1]) ** 2)

    def numerical_rank(self, *, relative: float | None = None) -> int:
        """Return the number of singular values above a cut; see `numerical_rank`."""
        cut = self.tolerance
        if relative is not None:
            cut = max(cut, checked_cut(relative) * float(self.singular_values[0]))
        return int(np.count_nonzero(self.singular_values > cut))

    @property
    def participation_ratio(self) -> float:
        """``(sum of eigenvalues)^2 / sum of squared eigenvalues``; see `participation_ratio`."""
        values = self.eigenvalues
        return float(values.sum() ** 2 / np.sum(values**2))

    @property
    def explained_variance(self) -> ExplainedVariance:
        """Variance by principal component; see `explained_variance`."""
        values = self.eigenvalues
        ratio = values / values.sum()
        return ExplainedVariance(variance=values, ratio=ratio, cumulative=np.cumsum(ratio))


@dataclass(frozen=True)
class ExplainedVariance:
    """Principal components by the variance they carry.

    Parameters
    ----------
    variance : (F,) float64
        In descending order; in squared units of the states where these were not standardised.
    ratio, cumulative : (F,) float64
        Shares of the total, and their running sum.
    """

    variance: NDArray[np.float64]
    ratio: NDArray[np.float64]
    cumulative: NDArray[np.float64]

    def n_components(self, share: float) -> int:
        """Return the least number of components that carry at least `share` of the variance.

        Raises
        ------
        TaskError
            When `share` is not in (0, 1].
        """
        if not 0.0 < share <= 1.0:
            raise TaskError(
                f"the share is {share!r}",
                expected="above 0, and 1 at most",
                fix="pass a fraction, such as 0.95",
                key="share",
            )
        # A running sum of shares may end an ulp below the share that it amounts to.
        return int(np.searchsorted(self.cumulative, share - 1e-12)) + 1

    @property
    def n_90(self) -> int:
        """Components for 90 % of the variance."""
        return self.n_components(_SHARES[0])

    @property
    def n_95(self) -> int:
        """Components for 95 % of the variance."""
        return self.n_components(_SHARES[1])

    @property
    def n_99(self) -> int:
        """Components for 99 % of the variance."""
        return self.n_components(_SHARES[2])


def state_spectrum(states: ArrayLike, *, standardize: bool = True) -> StateSpectrum:
    """Return the spectrum of a state matrix.

    Parameters
    ----------
    states : (T, N)
        One row per symbol or frame. Offsets are harmless: columns are centred first.
    standardize : bool
        Divide every column by its standard deviation, so that columns of different units
        (metres, radians, volts) count alike.

    Returns
    -------
    StateSpectrum
        Its tolerance is the larger of ``max(T, F) eps`` times the largest singular value, and
        of what rounding the stored numbers can have added: a column of offset m and standard
        deviation s carries a relative error of ``eps m / s``. Affine copies of a column are
        recognised by the second part when the offset is large.

    Raises
    ------
    TaskError
        When `states` is no matrix of finite numbers with two rows, or no column changes.
    """
    stored = np.asarray(states)
    values = checked_states(stored)
    flags = is_constant(values)
    constant = tuple(np.flatnonzero(flags).tolist())
    if flags.all():
        raise TaskError(
            f"none of the {values.shape[1]} columns changes",
            expected="at least one column that changes",
            fix="leave out clamped nodes, or drive the body",
            key="states",
        )
    kept = values[:, ~flags] if constant else values
    size = np.abs(kept).max(axis=0)
    centred = kept - kept.mean(axis=0)
    # A second pass removes what rounding left in the mean of numbers with a large offset.
    centred -= centred.mean(axis=0)
    scale = centred.std(axis=0)
    if standardize:
        centred /= scale
        size = size / scale
    singular = np.linalg.svd(centred, compute_uv=False)
    eps = float(np.finfo(np.float64).eps)
    stored_eps = float(np.finfo(stored.dtype).eps) if stored.dtype.kind == "f" else eps
    rounding = max(stored_eps, eps) * np.sqrt(len(kept)) * float(np.linalg.norm(size))
    return StateSpectrum(
        singular_values=singular,
        n_rows=len(kept),
        n_columns=values.shape[1],
        constant=constant,
        tolerance=max(float(singular[0]) * max(kept.shape) * eps, rounding),
        standardized=standardize,
    )


def constant_columns(states: ArrayLike) -> NDArray[np.intp]:
    """Return the positions of the columns of `states` (T, N) that never change."""
    return np.flatnonzero(is_constant(checked_states(states)))


def effective_rank(
    states: ArrayLike, *, spectrum: SpectrumKind = "eigenvalues", standardize: bool = True
) -> float:
    """Return the exponential of the Shannon entropy of the normalised spectrum.

    Parameters
    ----------
    states : (T, N)
    spectrum : {"eigenvalues", "singular"}
        Eigenvalues of the correlation matrix, or singular values of the standardised states,
        as Roy and Vetterli 2007 defined it (EUSIPCO, section 2). Eigenvalues are the squares,
        so the two differ: a pair of columns with correlation 0.6 has 1.65 or 1.89.
    standardize : bool
        As in `state_spectrum`.

    Raises
    ------
    TaskError
        As `state_spectrum`; when `spectrum` is unknown.

    Examples
    --------
    >>> effective_rank([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    2.0
    """
    return state_spectrum(states, standardize=standardize).effective_rank(spectrum=spectrum)


def condition_number(states: ArrayLike, *, standardize: bool = True) -> float:
    """Return the largest over the smallest eigenvalue of the correlation matrix.

    Infinite when a changing column is a linear combination of others within the tolerance of
    `state_spectrum`, as with exact duplicates or with fewer rows than columns. Constant
    columns are left out; `constant_columns` names them.

    Raises
    ------
    TaskError
        As `state_spectrum`.
    """
    return state_spectrum(states, standardize=standardize).condition_number


def numerical_rank(
    states: ArrayLike, *, relative: float | None = None, standardize: bool = True
) -> int:
    """Return the number of singular values of the centred states above a cut.

    Parameters
    ----------
    states : (T, N)
    relative : float, optional
        Cut as a fraction of the largest singular value: for measured states, the fraction that
        is noise. Without it only what rounding explains is cut off; see `state_spectrum`.
    standardize : bool
        As in `state_spectrum`.

    Raises
    ------
    TaskError
        As `state_spectrum`; when the cut is not in [0, 1).
    """
    return state_spectrum(states, standardize=standardize).numerical_rank(relative=relative)


def explained_variance(states: ArrayLike, *, standardize: bool = True) -> ExplainedVariance:
    """Return the variance that each principal component carries.

    With ``standardize=False`` these are the principal components of the covariance matrix, in
    which a column of large numbers outweighs the others.

    Raises
    ------
    TaskError
        As `state_spectrum`.
    """
    return state_spectrum(states, standardize=standardize).explained_variance


def participation_ratio(states: ArrayLike, *, standardize: bool = True) -> float:
    """Return ``(sum of eigenvalues)^2 / sum of squared eigenvalues``, from 1 to N.

    Gao et al. 2017, doi:10.1101/214262, on the correlation matrix, or on the covariance
    matrix with ``standardize=False``.

    Raises
    ------
    TaskError
        As `state_spectrum`.
    """
    return state_spectrum(states, standardize=standardize).participation_ratio


def checked_cut(relative: Any) -> float:
    """Return a relative cut.

    Raises
    ------
    TaskError
        When it is not in [0, 1).
    """
    if not (np.isscalar(relative) and 0.0 <= float(relative) < 1.0):
        raise TaskError(
            f"the relative cut is {relative!r}",
            expected="at least 0 and below 1",
            fix="pass a fraction of the largest singular value, such as 0.01",
            key="relative",
        )
    return float(relative)


def checked_states(states: ArrayLike, *, key: str = "states") -> NDArray[np.float64]:
    """Return `states` as a float64 matrix.

    Raises
    ------
    TaskError
        When it is no matrix of finite numbers with at least two rows and one column.
    """
    values = np.asarray(states, dtype=np.float64)
    if values.ndim != 2 or len(values) < 2 or not values.shape[1]:
        raise TaskError(
            f"{key} has shape {values.shape}",
            expected="(T, N), at least two rows and one column",
            fix="pass one row per symbol or frame and one column per state",
            key=key,
        )
    bad = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
    if bad:
        raise TaskError(
            f"{bad} of {len(values)} rows of {key} hold NaN or infinite numbers",
            expected="finite numbers",
            fix="leave these rows out, or these columns",
            key=key,
        )
    return values
