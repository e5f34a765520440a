"""Choosing a penalty on rows that follow each other in time: blocks, gaps, no shuffling.

Neighbouring rows of a body that remembers are nearly copies of each other. Folds of shuffled
rows, and leaving out single rows, test on what was trained on and prefer penalties that are too
small. Here a fold is a stretch of time, and rows within a gap of it are not trained on (blocked
cross-validation: Bergmeir & Benítez 2012, doi:10.1016/j.ins.2011.12.028; with a gap, Racine 2000,
doi:10.1016/S0304-4076(00)00030-0).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError
from openprc.reservoir.training.moments import Moments, merge_all, row_moments
from openprc.reservoir.training.row_blocks import RowBlocks
from openprc.reservoir.training.scores import varying
from openprc.reservoir.training.standardizer import Standardizer

Reals = NDArray[np.float64]
Scheme = Literal["blocked", "forward"]

#: Thirteen penalties, a decade apart: on states of unit variance, from none to nearly all.
DEFAULT_PENALTIES = tuple(10.0**k for k in range(-8, 5))


@dataclass(frozen=True)
class Fold:
    """One stretch of time to test on, and what is trained on before and after it.

    Parameters
    ----------
    test : slice
        Places among the chosen rows.
    before, after : int
        Training is ``[:before]`` and ``[after:]``.
    """

    test: slice
    before: int
    after: int

    def train(self, n: int) -> NDArray[np.intp]:
        """Return the places of the training rows among n chosen ones."""
        return np.concatenate([np.arange(self.before), np.arange(min(self.after, n), n)])


@dataclass(frozen=True)
class CrossValidation:
    """Errors of every penalty on rows that were not trained on.

    Parameters
    ----------
    penalties : (P,) float64
    nmse : (P, O) float64
        Squared errors of all folds together, over the variance of the target on all tested rows.
    fold_nmse : (K, P, O) float64
        Mean squared error of each fold over the same variance.
    folds : tuple of Fold
    best : (O,) float64
        Penalty with the least error, one for each output.
    moments : Moments
        Of all rows.
    """

    penalties: Reals
    nmse: Reals
    fold_nmse: Reals
    folds: tuple[Fold, ...]
    best: Reals
    moments: Moments

    @property
    def best_overall(self) -> float:
        """The penalty whose error, mean over outputs, is least."""
        return float(self.penalties[self.nmse.mean(axis=1).argmin()])

    @property
    def at_edge(self) -> bool:
        """Whether a best penalty is the smallest or largest that was tried."""
        return bool(np.isin(self.best, [self.penalties.min(), self.penalties.max()]).any())


def temporal_folds(
    rows: NDArray[np.intp], *, n_folds: int, gap: int, scheme: Scheme = "blocked"
) -> tuple[Fold, ...]:
    """Divide rising row numbers (n,) into folds of consecutive rows.

    Parameters
    ----------
    n_folds : int
        Folds to test on. ``forward`` needs one more stretch of time, which is trained on only.
    gap : int
        Rows of the clock that are left out on either side of a tested fold.
    scheme : {"blocked", "forward"}
        Train on what comes before and after a fold, or only on what comes before.

    Raises
    ------
    TaskError
        When there are fewer than two folds, or rows do not suffice for them and the gaps.
    """
    if scheme not in ("blocked", "forward"):
        raise TaskError(
            f"scheme is {scheme!r}",
            expected="blocked or forward",
            fix="choose one of these",
            key="scheme",
        )
    if n_folds < (2 if scheme == "blocked" else 1) or gap < 0:
        raise TaskError(
            f"n_folds is {n_folds} and gap is {gap}",
            expected="at least 2 folds and a gap of 0 or more rows",
            fix="choose such numbers",
            key="n_folds",
        )
    n, forward = len(rows), scheme == "forward"
    edges = np.rint(np.linspace(0, n, n_folds + 1 + forward)).astype(int)
    folds = []
    for first, stop in zip(edges[forward:-1], edges[1 + forward :], strict=True):
        # The gap counts rows of the clock, some of which may not have been measured.
        before = int(np.searchsorted(rows, rows[min(first, n - 1)] - gap))
        after = int(np.searchsorted(rows, rows[stop - 1] + gap, side="right"))
        after = n if forward else max(after, stop)
        if first == stop or before + n - after < 2:
            raise TaskError(
                f"{n} rows in {n_folds} folds with gaps of {gap} leave nothing to train on",
                expected="folds longer than the gap",
                fix="use fewer folds, a shorter gap, or a longer training span",
                key="n_folds",
            )
        folds.append(Fold(slice(int(first), int(stop)), min(before, int(first)), after))
    return tuple(folds)


def choose_regularization(
    states: ArrayLike,
    target: ArrayLike,
    *,
    gap: int,
    penalties: ArrayLike = DEFAULT_PENALTIES,
    n_folds: int = 5,
    scheme: Scheme = "blocked",
    standardize: bool = True,
) -> CrossValidation:
    """Find the penalty of ridge regression with the least error on folds of time.

    States are read once, for the second moments of the stretches between the edges of folds and
    gaps. Those of every training set are sums of them, and one eigendecomposition of each
    gives the weights for all penalties: what refitting would give, but for rounding.

    Parameters
    ----------
    states : (n, F), rows in order of time
    target : (n,) or (n, O)
    gap : int
        Rows left out on either side of a tested fold: at least as many as the body remembers.
    penalties : (P,)
        On weights of standardised states.
    n_folds, scheme
        See `temporal_folds`.
    standardize : bool
        Bring the states of each training set to zero mean and unit variance.

    Raises
    ------
    TaskError
        When rows do not suffice, shapes differ, or a penalty is negative.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> x = rng.normal(size=(400, 3))
    >>> choose_regularization(x, x[:, 0], gap=5).best
    array([1.e-08])
    """
    x = np.asarray(states, dtype=np.float64)
    y = np.asarray(target, dtype=np.float64)
    if x.ndim != 2 or y.ndim not in (1, 2) or len(x) != len(y):
        raise TaskError(
            f"states have shape {x.shape} and the target has {y.shape}",
            expected="(n, F) and (n,) or (n, O)",
            fix="pass one target row for each row of states",
            key="states",
        )
    return cross_validate(
        RowBlocks.all_of(x),
        y.reshape(len(x), -1),
        penalties=np.asarray(penalties, dtype=np.float64),
        folds=temporal_folds(np.arange(len(x)), n_folds=n_folds, gap=gap, scheme=scheme),
        standardize=standardize,
    )


def cross_validate(
    blocks: RowBlocks,
    target: Reals,
    *,
    penalties: Reals,
    folds: tuple[Fold, ...],
    standardize: bool = True,
) -> CrossValidation:
    """Score penalties on given folds of chosen rows; see `choose_regularization`."""
    if penalties.ndim != 1 or not len(penalties) or not (penalties >= 0).all():
        raise TaskError(
            f"penalties are {penalties.tolist()}",
            expected="numbers of at least 0",
            fix="correct them",
            key="penalties",
        )
    n, n_outputs = len(blocks), target.shape[1]
    cuts = sorted({0, n, *(f.before for f in folds), *(f.after for f in folds),
                   *(f.test.start for f in folds), *(f.test.stop for f in folds)})  # fmt: skip
    pieces = [row_moments(blocks.part(a, b), target[a:b]) for a, b in pairwise(cuts)]
    whole = merge_all(pieces)
    errors = np.empty((len(folds), len(penalties), n_outputs))
    for k, (fold, moments) in enumerate(zip(folds, _training(pieces, cuts, folds), strict=True)):
        weights, mean_x = _all_weights(moments, penalties, standardize=standardize)
        errors[k] = _squared_errors(
            blocks.part(fold.test.start, fold.test.stop),
            target[fold.test] - moments.mean_y,
            weights=weights,
            mean_x=mean_x,
        )
    tested = np.concatenate([np.arange(f.test.start, f.test.stop) for f in folds])
    variance = varying(target[tested])
    sizes = np.array([f.test.stop - f.test.start for f in folds])[:, None, None]
    fold_nmse = errors / sizes / variance
    nmse = errors.sum(axis=0) / len(tested) / variance
    best = penalties[nmse.argmin(axis=0)]
    return CrossValidation(penalties, nmse, fold_nmse, folds, best, whole)


def _training(pieces: list[Moments], cuts: list[int], folds: tuple[Fold, ...]) -> Iterator[Moments]:
    """Yield the moments of each fold's training rows: of all before it, and of all after it."""
    place = {cut: index for index, cut in enumerate(cuts)}
    wanted_before = {place[f.before] for f in folds}
    wanted_after = {place[min(f.after, cuts[-1])] for f in folds}
    before: dict[int, Moments | None] = {0: None}
    running: Moments | None = None
    for index, piece in enumerate(pieces, start=1):
        running = piece if running is None else running.merge(piece)
        if index in wanted_before:
            before[index] = running
    after: dict[int, Moments | None] = {len(pieces): None}
    running = None
    for index in range(len(pieces) - 1, 0, -1):
        running = pieces[index] if running is None else pieces[index].merge(running)
        if index in wanted_after:
            after[index] = running
    for fold in folds:
        sides = (before[place[fold.before]], after[place[min(fold.after, cuts[-1])]])
        merged = merge_all(side for side in sides if side is not None)
        if merged is not None:
            yield merged


def _all_weights(moments: Moments, penalties: Reals, *, standardize: bool) -> tuple[Reals, Reals]:
    """Return the weights (F, P O) on raw centred states for every penalty, and their means."""
    standardizer = Standardizer.from_moments(moments, scaled=standardize)
    active = np.flatnonzero(~standardizer.constant)
    scale = standardizer.scale[active]
    gram = moments.gxx[np.ix_(active, active)] / scale[:, None] / scale
    values, vectors = np.linalg.eigh(gram)
    largest = values[-1] if len(values) else 0.0
    products = vectors.T @ (moments.gxy[active] / scale[:, None])
    damped = np.maximum(values, 0.0)[:, None] + penalties
    # Where there is no penalty, directions that are rounding errors of the largest are left out.
    kept = damped > len(values) * np.finfo(np.float64).eps * largest
    inverse = np.where(kept, 1.0 / np.where(kept, damped, 1.0), 0.0)
    solved = vectors @ (inverse[:, :, None] * products[:, None, :]).reshape(len(values), -1)
    weights = np.zeros((moments.n_states, solved.shape[1]))
    weights[active] = solved / scale[:, None]
    return weights, moments.mean_x


def _squared_errors(blocks: RowBlocks, target: Reals, *, weights: Reals, mean_x: Reals) -> Reals:
    """Return sums of squared errors (P, O) for centred targets (n, O), one weight per column."""
    n_outputs = target.shape[1]
    total = np.zeros((weights.shape[1] // n_outputs, n_outputs))
    for place, states in blocks:
        predicted = (states - mean_x) @ weights
        predicted = predicted.reshape(len(states), -1, n_outputs)
        predicted -= target[place][:, None, :]
        total += np.einsum("npo,npo->po", predicted, predicted)
    return total
