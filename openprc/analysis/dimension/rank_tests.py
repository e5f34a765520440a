"""Kernel quality and generalisation: how many input histories the states can tell apart.

Legenstein and Maass 2007, doi:10.1016/j.neunet.2007.04.017. The kernel rank counts the
directions that the final states take under independent input streams, and should be high. The
generalisation rank counts them under streams that ought to be taken for the same, because they
agree in their last symbols or differ by a little noise, and should be low. The difference is
the computational power of that paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dimension.spectra import checked_cut, checked_states
from openprc.errors import TaskError

#: Share of the largest singular value below which a direction of measured states is noise.
DEFAULT_CUT = 0.01


class Body(Protocol):
    """What can be driven from rest, one symbol after the other."""

    n_states: int

    def reset(self) -> None:
        """Return to rest."""

    def step(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take one symbol (C,) in and return the states (N,)."""


@dataclass(frozen=True)
class MatrixRank:
    """Rank of a matrix of final states, by two rules.

    Parameters
    ----------
    numerical : int
        Singular values above ``max(M, N) eps`` times the largest.
    relative : int
        Singular values above `cut` times the largest.
    cut : float
    singular_values : (min(M, N),) float64
        In descending order.
    """

    numerical: int
    relative: int
    cut: float
    singular_values: NDArray[np.float64]


@dataclass(frozen=True)
class KernelQuality:
    """Kernel rank, generalisation rank, and their difference.

    Parameters
    ----------
    kernel, generalisation : MatrixRank
    similarity : str
        What the streams of the generalisation rank have in common, in words.
    """

    kernel: MatrixRank
    generalisation: MatrixRank
    similarity: str

    @property
    def computational_power(self) -> int:
        """Kernel rank less generalisation rank, both numerical."""
        return self.kernel.numerical - self.generalisation.numerical

    @property
    def relative_computational_power(self) -> int:
        """Kernel rank less generalisation rank, both by the relative cut."""
        return self.kernel.relative - self.generalisation.relative


def kernel_rank(states: ArrayLike, *, cut: float = DEFAULT_CUT, centre: bool = False) -> MatrixRank:
    """Return the rank of final states, one row per input stream.

    The generalisation rank is the same function of the states that similar streams led to.

    Parameters
    ----------
    states : (M, N)
        Row m is the state at one instant after stream m. M should exceed N.
    cut : float
        Of the relative rule.
    centre : bool
        Subtract the mean over streams. The definition does not; a body whose states are
        positions far from the origin needs it, lest the offset be the largest direction by
        far. It lowers the rank of states that share a constant part by one.

    Raises
    ------
    TaskError
        When `states` is no matrix of finite numbers with two rows, or the cut is not in [0, 1).
    """
    values = checked_states(states)
    cut = checked_cut(cut)
    if centre:
        # Rounding of the mean is what a constant column would otherwise leave behind.
        size = np.abs(values).max()
        values = values - values.mean(axis=0)
        values[np.abs(values) <= 8.0 * np.finfo(np.float64).eps * size] = 0.0
    singular = np.linalg.svd(values, compute_uv=False)
    largest = float(singular[0])
    floor = largest * max(values.shape) * float(np.finfo(np.float64).eps)
    return MatrixRank(
        numerical=int(np.count_nonzero(singular > floor)),
        relative=int(np.count_nonzero(singular > max(floor, cut * largest))),
        cut=cut,
        singular_values=singular,
    )


def final_states(body: Any, streams: ArrayLike) -> NDArray[np.float64]:
    """Return the states of a body after each of several streams, each from rest, (M, N).

    Parameters
    ----------
    body : Body
        With `reset` and `step`; a method ``drive(u)`` that starts from rest and returns the
        states after every symbol is used where there is one, because it is faster.
    streams : (M, L) or (M, L, C)
    """
    values = checked_streams(streams)
    rows = []
    for stream in values:
        if callable(getattr(body, "drive", None)):
            rows.append(np.asarray(body.drive(stream), dtype=np.float64)[-1])
            continue
        body.reset()
        for symbol in stream:
            state = body.step(symbol)
        rows.append(np.array(state, dtype=np.float64))
    return np.stack(rows)


def kernel_quality(
    body: Any,
    *,
    n_streams: int,
    length: int,
    common: int | None = None,
    jitter: float | None = None,
    low: float = -1.0,
    high: float = 1.0,
    n_inputs: int = 1,
    cut: float = DEFAULT_CUT,
    centre: bool = False,
    seed: int | np.random.Generator,
) -> KernelQuality:
    """Measure kernel rank and generalisation rank of a body that can be driven at will.

    Parameters
    ----------
    body : Body
        As in `final_states`.
    n_streams, length : int
        M streams of L symbols each, uniform on [low, high]. M should exceed the number of
        states, and L the memory of the body.
    common : int, optional
        The generalisation rank is that of streams whose last `common` symbols agree.
    jitter : float, optional
        Or that of one stream plus independent uniform noise on [-jitter, jitter].
    n_inputs : int
        C.
    cut, centre : float, bool
        As in `kernel_rank`.
    seed : int or numpy.random.Generator

    Raises
    ------
    TaskError
        Unless exactly one of `common` and `jitter` is given, and counts and range make sense.

    Examples
    --------
    >>> from openprc.reservoir.networks import DelayLine
    >>> found = kernel_quality(DelayLine(20), n_streams=60, length=40, common=5, seed=0)
    >>> found.kernel.numerical, found.generalisation.numerical, found.computational_power
    (20, 16, 4)
    """
    if (common is None) == (jitter is None):
        raise TaskError(
            "both common and jitter are given"
            if common is not None
            else "neither common nor jitter is given",
            expected="one of them: it says which streams ought to be taken for the same",
            fix="pass common=k (the last k symbols agree) or jitter=e (one stream plus noise)",
            key="common",
        )
    if n_streams < 2 or length < 1 or not low < high:
        raise TaskError(
            f"n_streams is {n_streams}, length is {length}, the range is [{low}, {high}]",
            expected="two streams or more, of one symbol or more, on a range that is not empty",
            fix="correct these",
            key="n_streams",
        )
    rng = np.random.default_rng(seed)
    shape = (n_streams, length, n_inputs)
    streams = rng.uniform(low, high, shape)
    kernel = kernel_rank(final_states(body, streams), cut=cut, centre=centre)
    if common is not None:
        similar = similar_by_end(streams, common)
        similarity = f"the last {common} of {length} symbols agree"
    else:
        similar = similar_by_jitter(streams[0], float(jitter or 0.0), n_streams=n_streams, rng=rng)
        similarity = f"one stream plus uniform noise of at most {jitter:g}"
    return KernelQuality(
        kernel=kernel,
        generalisation=kernel_rank(final_states(body, similar), cut=cut, centre=centre),
        similarity=similarity,
    )


def similar_by_end(streams: NDArray[np.float64], common: int) -> NDArray[np.float64]:
    """Return `streams` (M, L, C) with their last `common` symbols replaced by those of the first.

    Raises
    ------
    TaskError
        When `common` is not from 1 to L.
    """
    if not 1 <= common <= streams.shape[1]:
        raise TaskError(
            f"common is {common} and a stream has {streams.shape[1]} symbols",
            expected=f"from 1 to {streams.shape[1]}",
            fix="let fewer symbols agree, or lengthen the streams",
            key="common",
        )
    similar = streams.copy()
    similar[:, -common:] = streams[0, -common:]
    return similar


def similar_by_jitter(
    stream: NDArray[np.float64], jitter: float, *, n_streams: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return (M, L, C) copies of `stream` (L, C) with uniform noise on [-jitter, jitter] added.

    Raises
    ------
    TaskError
        When `jitter` is not a positive number.
    """
    if not (np.isfinite(jitter) and jitter > 0.0):
        raise TaskError(
            f"jitter is {jitter!r}",
            expected="a positive number, in the unit of the input",
            fix="pass the size of the differences that should not count",
            key="jitter",
        )
    return stream + rng.uniform(-jitter, jitter, (n_streams, *stream.shape))


def checked_streams(streams: ArrayLike) -> NDArray[np.float64]:
    """Return streams as (M, L, C).

    Raises
    ------
    TaskError
        When they are not of that shape.
    """
    values = np.asarray(streams, dtype=np.float64)
    values = values[:, :, None] if values.ndim == 2 else values
    if values.ndim != 3 or not values.size:
        raise TaskError(
            f"streams has shape {np.shape(streams)}",
            expected="(M, L) or (M, L, C): M streams of L symbols",
            fix="pass one row per stream",
            key="streams",
        )
    return values
