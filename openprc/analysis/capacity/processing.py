"""`information_processing_capacity`: which functions of its past input a body holds."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from openprc.analysis.capacity.capacities import Capacities, Estimator
from openprc.analysis.capacity.drive import CapacityWarning, Coloured, Correlated
from openprc.analysis.capacity.measurement import measure
from openprc.analysis.capacity.polynomials import Basis
from openprc.analysis.capacity.settings import Excess, Null, Orthonormalize, Settings
from openprc.analysis.capacity.terms import Factor, Terms
from openprc.analysis.capacity.thresholds import Correction
from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit


def information_processing_capacity(
    states: NDArray[np.floating],
    u: ArrayLike,
    *,
    delays: Mapping[int, int] | None = None,
    terms: Sequence[Sequence[Factor]] | Terms | None = None,
    delay_step: int = 1,
    first_delay: int = 0,
    washout: int = 0,
    split: RowSplit | None = None,
    usable: NDArray[np.bool_] | None = None,
    basis: Basis = "empirical",
    estimator: Estimator = "insample",
    ridge: float = 1e-6,
    eps: float | None = None,
    alpha: float = 0.01,
    correction: Correction = "bonferroni",
    null: Null = "beta",
    n_surrogates: int = 99,
    orthonormalize: Orthonormalize = "average",
    coloured: Coloured = "adapt",
    correlated: Correlated = "refuse",
    excess: Excess = "raise",
    rank_tolerance: float | None = None,
    dtype: DTypeLike = np.float64,
    seed: int = 0,
    blas_threads: int | None = None,
) -> Capacities:
    """Measure how well linear readouts of the states give products of past inputs.

    Targets are products of orthonormal polynomials of the input at different delays. With an
    independent input and fading memory their capacities add up to the number of independent
    states, and never to more (Dambre et al. 2012, doi:10.1038/srep00514).

    Parameters
    ----------
    states : (T, N)
        Row t has seen ``u[t]``. One row per symbol of the input.
    u : (T,) or (T, C)
        Input; with C columns, products run across inputs.
    delays : mapping
        Largest delay for each total degree, in steps: ``{1: 100, 2: 30, 3: 10}``.
    terms : sequence, optional
        Targets one by one instead; see `Terms.of`.
    delay_step : int [rows]
        Rows from one delay to the next.
    first_delay : int
        Smallest delay, in steps; 0 is the present input.
    washout : int
        Rows at the start that do not count, unless there is a `split`.
    split : RowSplit, optional
        In-sample capacities use its training and test rows together.
    usable : (T,) bool, optional
        Rows that were measured completely.
    basis : {"empirical", "legendre", "hermite"}
        Polynomials orthonormal under the distribution of the input itself, or under the
        uniform or the normal one; see `polynomial_rows`.
    estimator : {"insample", "heldout"}
        ``insample``: ``C = |Q^T z|^2 / |z|^2``, Q an orthonormal basis of the centred states.
        ``heldout``: 1 - NMSE of a ridge readout on the test rows of `split`.
    ridge : float
        Penalty of the held-out readout, relative to the variance of a state.
    eps : float, optional
        Threshold that is used as it is, in place of one from the distribution of chance.
    alpha : float
        Probability that any capacity of chance counts (for ``benjamini-hochberg``, fraction
        of those that count which are chance).
    correction : {"bonferroni", "benjamini-hochberg", "none"}
        For K targets under ``null="beta"``. Surrogates take the largest of each degree.
    null : {"beta", "circular", "shuffle"}
        The exact distribution of chance for a white input, or that of surrogates; see
        `surrogate_thresholds`.
    n_surrogates : int
    orthonormalize : {"average", "exact"}
        Targets that are orthonormal on average, or made so over these rows, each without what
        earlier ones hold (lower degrees first). Exact ones sum to the rank at most.
    coloured : {"adapt", "refuse", "ignore"}
        When the drive is not white: ``adapt`` takes exactly orthonormal targets and thresholds
        of circular shifts, and warns; ``refuse`` raises; ``ignore`` goes on.
    correlated : {"refuse", "whiten"}
        What to do with inputs that are correlated with each other.
    excess : {"raise", "report"}
        What to do when capacities sum to more than the rank.
    rank_tolerance : float, optional
        Directions of the states below this fraction of the largest singular value do not
        count. By default the limit is that of rounding.
    dtype : {float64, float32}
        Precision of the products of targets and states.
    seed : int
        Of the surrogates.
    blas_threads : int, optional
        Threads of the matrix products; by default as many as BLAS would use. 1 where several
        processes measure side by side.

    Raises
    ------
    TaskError
        When states or input are unfit, the sum exceeds the rank, or a choice cannot be met.

    Warns
    -----
    CapacityWarning
        When the drive is not white, or the sum exceeds the rank and that is to be reported.

    Examples
    --------
    Three delayed copies of the input, of which the first is the input itself:

    >>> import numpy as np
    >>> u = np.random.default_rng(0).uniform(-1, 1, 2000)
    >>> states = np.stack([np.roll(u, k) for k in range(3)], axis=1)
    >>> found = information_processing_capacity(states, u, delays={1: 10, 2: 5}, washout=10)
    >>> round(found.total, 6), found.rank, round(found.memory_capacity, 6)
    (3.0, 3, 2.0)
    """
    settings = Settings(
        basis=basis,
        estimator=estimator,
        ridge=ridge,
        eps=eps,
        alpha=alpha,
        correction=correction,
        null=null,
        n_surrogates=n_surrogates,
        orthonormalize=orthonormalize,
        coloured=coloured,
        correlated=correlated,
        excess=excess,
        rank_tolerance=rank_tolerance,
        dtype=dtype,
        seed=seed,
        blas_threads=blas_threads,
    )
    n_inputs = 1 if np.ndim(u) < 2 else np.shape(u)[1]
    chosen = chosen_terms(
        delays, terms, n_inputs=n_inputs, delay_step=delay_step, first_delay=first_delay
    )
    found = measure(
        states, u, chosen, settings=settings, washout=washout, split=split, usable=usable
    )
    _warn(found)
    return found


def memory_capacity(
    states: NDArray[np.floating], u: ArrayLike, *, max_delay: int, **choices: Any
) -> Capacities:
    """Measure how well linear readouts of the states give the input of k rows before.

    ``result.memory_capacity`` is the sum over k from 1 to `max_delay`; ``result.linear`` holds
    k = 0, the present input, as well.

    Parameters
    ----------
    states : (T, N)
    u : (T,) or (T, C)
    max_delay : int
        Largest k, in steps.
    **choices
        As for `information_processing_capacity`.

    Raises
    ------
    TaskError
        As `information_processing_capacity`.
    """
    return information_processing_capacity(states, u, delays={1: max_delay}, **choices)


def _warn(found: Capacities) -> None:
    """Warn whoever called into this module, through however many of its functions."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals is globals():
        level, frame = level + 1, frame.f_back
    for sentence in found.warnings:
        warnings.warn(sentence, CapacityWarning, stacklevel=level)


def chosen_terms(
    delays: Mapping[int, int] | None,
    terms: Sequence[Sequence[Factor]] | Terms | None,
    *,
    n_inputs: int,
    delay_step: int = 1,
    first_delay: int = 0,
) -> Terms:
    """Return the targets of a budget, or those that were given.

    Raises
    ------
    TaskError
        When there is neither, or both.
    """
    if (delays is None) == (terms is None):
        raise TaskError(
            "neither delays nor terms were given" if delays is None else "both were given",
            expected="delays, a budget such as {1: 100, 2: 30}, or terms, a list of targets",
            fix="give one of them",
            key="delays",
        )
    if isinstance(terms, Terms):
        return terms
    if terms is not None:
        return Terms.of(terms, n_inputs=n_inputs)
    return Terms.within(
        delays or {}, n_inputs=n_inputs, delay_step=delay_step, first_delay=first_delay
    )
