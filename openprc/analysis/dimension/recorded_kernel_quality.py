"""Kernel and generalisation rank of a body that was recorded once and cannot be driven again.

A body that forgets is driven by white input as if by a new stream every time its memory is
over: rows that far apart have seen histories that share nothing it still knows, so they are
final states of independent streams. Streams that agree in their last symbols are found among
the rows only where words recur, which takes an input of few values. For an input of
continuous values the generalisation rank cannot be had from one recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dimension.rank_tests import DEFAULT_CUT, MatrixRank, kernel_rank
from openprc.analysis.dimension.spectra import checked_states
from openprc.errors import TaskError


@dataclass(frozen=True)
class RecordedRank:
    """A rank estimated from the rows of one recording.

    Parameters
    ----------
    rank : MatrixRank
    n_streams : int
        Rows that stand for streams, M.
    saturated : bool
        The numerical rank equals M: with more rows it could be higher.
    remark : str
        Empty, or what makes the number a bound only.
    """

    rank: MatrixRank
    n_streams: int
    saturated: bool
    remark: str


def recorded_kernel_rank(
    states: ArrayLike, *, memory: int, cut: float = DEFAULT_CUT, centre: bool = False
) -> RecordedRank:
    """Estimate the kernel rank from rows that are `memory` symbols apart.

    Parameters
    ----------
    states : (K, N)
        One row per symbol of a white input, washout left out.
    memory : int
        Symbols after which the body has forgotten; see
        `openprc.analysis.dynamics.echo_state`.
    cut, centre : float, bool
        As in `kernel_rank`.

    Raises
    ------
    TaskError
        When fewer than two rows are left, or `memory` is below 1.
    """
    values = checked_states(states)
    if memory < 1 or len(values) <= memory:
        raise TaskError(
            f"memory is {memory} and there are {len(values)} rows",
            expected="from 1 symbol on, and at least two rows that far apart",
            fix="record for longer, or correct memory",
            key="memory",
        )
    # Counted back from the end, where the least of the beginning is left.
    return _recorded(values[::-1][::memory], cut=cut, centre=centre)


def recorded_generalisation_rank(
    states: ArrayLike,
    u: ArrayLike,
    *,
    common: int,
    cut: float = DEFAULT_CUT,
    centre: bool = False,
) -> RecordedRank:
    """Estimate the generalisation rank from rows whose last `common` symbols agree.

    The word that recurs most often is taken.

    Parameters
    ----------
    states : (K, N)
        Row k has seen ``u[k]``; washout left out.
    u : (K,) or (K, C)
        Symbols of few values, such as bits.
    common : int
        Length of the word.
    cut, centre : float, bool
        As in `kernel_rank`.

    Raises
    ------
    TaskError
        When no word recurs, as with an input of continuous values.
    """
    values = checked_states(states)
    symbols = np.asarray(u, dtype=np.float64).reshape(len(np.atleast_1d(u)), -1)
    if len(symbols) != len(values) or not 1 <= common < len(values):
        raise TaskError(
            f"there are {len(values)} rows and {len(symbols)} symbols, and common is {common}",
            expected="one symbol per row, and a word shorter than the recording",
            fix="pass the symbols of these rows",
            key="u",
        )
    ends = _rows_of_commonest_word(symbols, common)
    if len(ends) < 2:
        raise TaskError(
            f"no {common} symbols in a row occur twice among {len(symbols)}",
            expected="an input of few values, so that words recur",
            fix="drive the body with few-valued symbols (such as bits), shorten the word, or "
            "drive a body that can be stepped with kernel_quality",
            key="u",
        )
    return _recorded(values[ends], cut=cut, centre=centre)


def _rows_of_commonest_word(symbols: NDArray[np.float64], common: int) -> NDArray[np.intp]:
    letters = np.unique(symbols, axis=0, return_inverse=True)[1].reshape(-1)
    words = np.lib.stride_tricks.sliding_window_view(letters, common)
    _, word, counts = np.unique(words, axis=0, return_inverse=True, return_counts=True)
    return np.flatnonzero(word.reshape(-1) == int(np.argmax(counts))) + common - 1


def _recorded(rows: NDArray[np.float64], *, cut: float, centre: bool) -> RecordedRank:
    rank = kernel_rank(rows, cut=cut, centre=centre)
    saturated = rank.numerical >= len(rows) - int(centre) and len(rows) <= rows.shape[1]
    remark = (
        f"{len(rows)} rows cannot show more than {len(rows)} directions of {rows.shape[1]} "
        "states: a lower bound; record for longer"
        if saturated
        else ""
    )
    return RecordedRank(rank=rank, n_streams=len(rows), saturated=saturated, remark=remark)
