"""Means and centred second moments of states and targets, in one pass and without a copy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.training.row_blocks import RowBlocks

Precision = Literal["float64", "float32"]


@dataclass(frozen=True)
class Moments:
    """What least squares needs to know of n rows of states and targets.

    Parameters
    ----------
    n : int
        Number of rows.
    origin, shift : (F + O,) float64
        Their sum is the mean of the states, then of the targets. The origin is a value among the
        data and the shift is as small as their spread, so that differences between means keep
        their digits when the data are far from zero.
    scatter : (F + O, F + O) float64
        Sum over rows of the outer product of (row - mean) with itself.
    n_states : int
        Number of states, F.
    """

    n: int
    origin: NDArray[np.float64]
    shift: NDArray[np.float64]
    scatter: NDArray[np.float64]
    n_states: int

    @property
    def mean(self) -> NDArray[np.float64]:
        """Means of the states, then of the targets, (F + O,)."""
        return self.origin + self.shift

    @property
    def mean_x(self) -> NDArray[np.float64]:
        """Means of the states, (F,)."""
        return self.mean[: self.n_states]

    @property
    def mean_y(self) -> NDArray[np.float64]:
        """Means of the targets, (O,)."""
        return self.mean[self.n_states :]

    @property
    def gxx(self) -> NDArray[np.float64]:
        """Centred Gram matrix of the states, (F, F)."""
        return self.scatter[: self.n_states, : self.n_states]

    @property
    def gxy(self) -> NDArray[np.float64]:
        """Centred products of states and targets, (F, O)."""
        return self.scatter[: self.n_states, self.n_states :]

    @property
    def gyy(self) -> NDArray[np.float64]:
        """Centred Gram matrix of the targets, (O, O)."""
        return self.scatter[self.n_states :, self.n_states :]

    @property
    def std_x(self) -> NDArray[np.float64]:
        """Standard deviations of the states, ddof 0, (F,)."""
        return np.sqrt(np.diagonal(self.gxx) / self.n)

    def merge(self, other: Moments) -> Moments:
        """Return the moments of the rows of both.

        ``S = S_a + S_b + (n_a n_b / n) d d'`` with the difference ``d`` of the means: exact but
        for rounding, and without cancellation: the pairwise formula of Chan, Golub & LeVeque
        1983, doi:10.1080/00031305.1983.10483115.

        Raises
        ------
        TaskError
            When the columns differ.
        """
        ours, theirs = len(self.mean_y), len(other.mean_y)
        if (ours, self.n_states) != (theirs, other.n_states):
            raise TaskError(
                f"moments of {self.n_states} states and {ours} targets meet those of "
                f"{other.n_states} and {theirs}",
                expected="the same columns",
                fix="compute both from the same features and targets",
                key="moments",
            )
        n = self.n + other.n
        difference = (other.origin - self.origin) + (other.shift - self.shift)
        shift = self.shift + difference * (other.n / n)
        scatter = self.scatter + other.scatter
        scatter += np.outer(difference * (self.n * other.n / n), difference)
        return Moments(n, self.origin, shift, scatter, self.n_states)


class MomentSum:
    """Adds up the moments of blocks of rows that come one after the other.

    All products are of differences from one provisional origin that lies within the data, and
    what its distance from the mean contributes is taken off at the end. An origin that is the
    mean of at least one k-th of the rows lies within sqrt(k) standard deviations of the mean,
    so that taking it off costs k rounding errors at most, however far the data are from zero.

    Parameters
    ----------
    origin : (F + O,) float64
        States, then targets: for instance the mean of some rows.
    n_states : int
    precision : {"float64", "float32"}
        In which products are formed. ``float32`` is about twice as fast, and leaves relative
        errors of 1e-7 in the products; sums over blocks are float64 all the same.
    scale : (F + O,) float64, optional
        With ``float32``, what differences are divided by so that their squares stay in range.
    """

    def __init__(
        self,
        origin: NDArray[np.float64],
        n_states: int,
        *,
        precision: Precision = "float64",
        scale: NDArray[np.float64] | None = None,
    ) -> None:
        self.origin, self.n_states, self.precision = origin, n_states, precision
        self.n, size = 0, len(origin)
        self._sum = np.zeros(size)
        self._upper = np.zeros((size, size), order="F")
        self._scratch = np.empty((0, size))
        single = precision == "float32"
        self._scale = (np.ones(size) if scale is None else scale) if single else None

    def add(self, states: NDArray[np.float64], target: NDArray[np.float64]) -> None:
        """Add rows of states (n, F) and targets (n, O), few enough to fit into the cache."""
        from scipy.linalg.blas import dsyrk, ssyrk

        n, split = len(states), self.n_states
        if n > len(self._scratch):
            self._scratch = np.empty((n, len(self.origin)))
        centred = self._scratch[:n]
        # Infinite values are found in the end, without a pass of their own.
        with np.errstate(invalid="ignore", over="ignore"):
            np.subtract(states, self.origin[:split], out=centred[:, :split])
            np.subtract(target, self.origin[split:], out=centred[:, split:])
            self._sum += np.add.reduce(centred, axis=0)
        self.n += n
        # `centred` is C-ordered, so its transpose is what Fortran calls a matrix of n columns.
        if self._scale is None:
            self._upper = dsyrk(1.0, centred.T, beta=1.0, c=self._upper, overwrite_c=1)
        else:
            centred /= self._scale
            self._upper += ssyrk(1.0, centred.astype(np.float32).T)

    def moments(self) -> Moments:
        """Return the moments of all rows that were added.

        Raises
        ------
        TaskError
            When there were no rows, or NaN or infinite values among them.
        """
        if self.n == 0:
            raise _no_rows()
        upper = self._upper
        shift = self._sum / self.n
        with np.errstate(invalid="ignore", over="ignore"):
            if self._scale is not None:
                upper = upper * self._scale[:, None] * self._scale
            # The other triangle of `upper` is still zero.
            scatter = upper + upper.T
            np.fill_diagonal(scatter, np.diagonal(upper))
            scatter -= np.outer(shift * self.n, shift)
        diagonal = np.diagonal(scatter)
        if not np.isfinite(diagonal).all():
            column = int(np.flatnonzero(~np.isfinite(diagonal))[0])
            what = "state" if column < self.n_states else "output"
            raise TaskError(
                f"{what} {column - (0 if what == 'state' else self.n_states)} has values that are "
                "NaN or infinite, or too large to be squared",
                expected="finite numbers below 1e150",
                fix="leave rows without a measurement out, or change the unit",
                key="states" if what == "state" else "y",
            )
        np.fill_diagonal(scatter, np.maximum(diagonal, 0.0))
        return Moments(self.n, self.origin, shift, scatter, self.n_states)


def row_moments(
    blocks: RowBlocks, target: NDArray[np.float64], *, precision: Precision = "float64"
) -> Moments:
    """Return the moments of chosen rows of a state matrix and their targets.

    Parameters
    ----------
    blocks : RowBlocks of n rows
    target : (n, O) float64
        Of the chosen rows.

    Raises
    ------
    TaskError
        See `MomentSum.moments`.
    """
    if not len(blocks):
        raise _no_rows()
    step = max(1, len(blocks) // 64)
    scale = None
    with np.errstate(invalid="ignore", over="ignore"):
        sample = np.concatenate([blocks.sample().mean(axis=0), target[::step].mean(axis=0)])
    if precision == "float32":
        spread = np.concatenate([blocks.sample().std(axis=0), target[::step].std(axis=0)])
        scale = np.where(spread > 0, spread, 1.0)
    total = MomentSum(sample, blocks.n_columns, precision=precision, scale=scale)
    for place, states in blocks:
        total.add(states, target[place])
    return total.moments()


def moments_of(
    blocks: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]],
    *,
    precision: Precision = "float64",
) -> Moments:
    """Return the moments of rows that arrive in blocks and are not kept.

    Parameters
    ----------
    blocks : iterable of (states (n, F), target (n,) or (n, O))
        Blocks may differ in length; empty ones are passed over.

    Raises
    ------
    TaskError
        When there is no row at all, or when values are not finite.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> blocks = [(rng.normal(size=(50, 3)), rng.normal(size=50)) for _ in range(4)]
    >>> moments_of(blocks).gxx.shape
    (3, 3)
    """
    whole: Moments | None = None
    for states, target in blocks:
        if not len(states):
            continue
        x = np.asarray(states, dtype=np.float64)
        y = np.asarray(target, dtype=np.float64).reshape(len(x), -1)
        part = row_moments(RowBlocks.all_of(x), y, precision=precision)
        whole = part if whole is None else whole.merge(part)
    if whole is None:
        raise _no_rows()
    return whole


def _no_rows() -> TaskError:
    return TaskError(
        "there are no rows", expected="at least one", fix="check the split", key="states"
    )


def merge_all(parts: Iterable[Moments]) -> Moments | None:
    """Return the moments of all rows of all parts, or None where there is no part."""
    whole: Moments | None = None
    for part in parts:
        whole = part if whole is None else whole.merge(part)
    return whole
