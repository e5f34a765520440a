"""The pattern of a sparse factorisation: elimination order, tree and fill, found once.

Symmetric matrices are described by one triangle; which one does not matter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

Reals = NDArray[np.float64]
#: Unsigned, so that compiled code need not ask whether an index counts from the end.
Index = NDArray[np.uint32]
Integers = NDArray[np.int64]


class Factor(NamedTuple):
    """A symmetric matrix A of order n and its factors ``P A P^T = L D L^T``.

    Attributes
    ----------
    order : (n,)
        Unknown that is eliminated at each place.
    start : (n + 1,), row : (nnz,), values : (nnz,)
        Upper triangle of ``P A P^T`` by columns, the diagonal always present. `values` is what
        the caller fills, at the positions that `analyse` returned.
    l_start : (n + 1,), l_row : (nnz_l,), l_values : (nnz_l,)
        L by columns without its unit diagonal, rows ascending.
    row_start : (n + 1,), row_column : (nnz_l,), row_position : (nnz_l,)
        L by rows: the column of each entry, ascending, and its place in `l_values`.
    inverse_pivot : (n,)
        ``1 / D``; 0 where the pivot vanished.
    relative_pivot : (n,) [1]
        Size of each pivot against the terms that it is the difference of.
    column, vector, residual : (n,)
        Scratch.
    """

    order: Index
    start: Integers
    row: Index
    values: Reals
    l_start: Integers
    l_row: Index
    l_values: Reals
    row_start: Integers
    row_column: Index
    row_position: Integers
    inverse_pivot: Reals
    relative_pivot: Reals
    column: Reals
    vector: Reals
    residual: Reals


def analyse(
    rows: ArrayLike, columns: ArrayLike, *, n: int, block: int = 1
) -> tuple[Factor, Integers]:
    """Return the factor's pattern, and where each contribution goes in ``Factor.values``.

    Parameters
    ----------
    rows, columns : (C,) [unknown]
        Entry of A that each contribution adds to. Repeated entries add up. An entry off the
        diagonal is given once, as ``(i, j)`` or as ``(j, i)``, not as both.
    n : int
        Number of unknowns.
    block : int, default 1
        Unknowns ``b * block ... b * block + block - 1`` belong together (the axes of a node):
        they are ordered as one, which is faster and as good.

    Returns
    -------
    factor : Factor
    position : (C,)

    Notes
    -----
    The order is minimum degree or reverse Cuthill-McKee or the natural one, whichever leads to
    the least fill. Each column of L has the pattern of A's column joined with those of its
    children in the elimination tree (Davis 2006, Direct Methods for Sparse Linear Systems,
    ch. 4, doi:10.1137/1.9780898718881).
    """
    rows, columns = np.asarray(rows, dtype=np.int64), np.asarray(columns, dtype=np.int64)
    place, below = _best_order(rows, columns, n=n, block=block)

    low = np.minimum(place[rows], place[columns])
    high = np.maximum(place[rows], place[columns])
    diagonal = np.arange(n) * (n + 1)
    keys, position = np.unique(
        np.concatenate([high * n + low, diagonal]), return_inverse=True
    )  # by column, then by row
    l_start = _starts(np.array([len(part) for part in below], dtype=np.int64))
    l_row = np.concatenate([*below, np.zeros(0, dtype=np.int64)])
    by_row = np.argsort(l_row, kind="stable")
    l_column = np.repeat(np.arange(n), np.diff(l_start))
    order = np.empty(n, dtype=np.int64)
    order[place] = np.arange(n)
    factor = Factor(
        order=order.astype(np.uint32),
        start=np.searchsorted(keys, np.arange(n + 1) * n),
        row=(keys % max(n, 1)).astype(np.uint32),
        values=np.zeros(len(keys)),
        l_start=l_start,
        l_row=l_row.astype(np.uint32),
        l_values=np.zeros(len(l_row)),
        row_start=_starts(np.bincount(l_row, minlength=n)),
        row_column=l_column[by_row].astype(np.uint32),
        row_position=by_row.astype(np.int64),
        inverse_pivot=np.zeros(n),
        relative_pivot=np.zeros(n),
        column=np.zeros(n),
        vector=np.zeros(n),
        residual=np.zeros(n),
    )
    return factor, position[: len(rows)].astype(np.int64)


def _starts(counts: NDArray[np.int64]) -> Integers:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _best_order(
    rows: Integers, columns: Integers, *, n: int, block: int
) -> tuple[Integers, list[Integers]]:
    """Return the place of each unknown (n,), and the pattern of L's columns."""
    n_blocks = -(-n // block)
    graph = _graph(rows // block, columns // block, n_blocks)
    best, fill = np.arange(n_blocks), None
    for place in _candidates(graph):
        count = _fill(rows // block, columns // block, place, limit=fill)
        if count is not None:
            best, fill = place, count
    places = (best[:, np.newaxis] * block + np.arange(block)).ravel()[:n]
    if block > 1:  # the last block may be a partial one
        places = np.argsort(np.argsort(places))
    below = _columns_of_l(rows, columns, places, limit=None)
    assert below is not None  # noqa: S101 - without a limit nothing is given up
    return places, below


def _graph(rows: Integers, columns: Integers, n: int) -> csc_array:
    """Return a diagonally dominant matrix of the pattern: (n, n)."""
    ends = np.concatenate([rows, columns]), np.concatenate([columns, rows])
    off = ends[0] != ends[1]
    matrix = csc_array((np.ones(int(off.sum())), (ends[0][off], ends[1][off])), shape=(n, n))
    matrix.data[:] = -1.0  # repeated entries had been summed
    degree = np.diff(matrix.indptr)
    return csc_array(matrix + csc_array((degree + 1.0, (np.arange(n), np.arange(n))), shape=(n, n)))


def _candidates(graph: csc_array) -> list[Integers]:
    """Return orders to try, the likely winner first, as the place of each unknown."""
    n = graph.shape[0]
    if n < 3:
        return [np.arange(n)]
    degree = splu(
        graph,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    ).perm_c
    banded = np.empty(n, dtype=np.int64)
    banded[reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True)] = np.arange(n)
    return [degree.astype(np.int64), np.arange(n), banded]


def _fill(rows: Integers, columns: Integers, place: Integers, *, limit: int | None) -> int | None:
    """Return the number of entries of L, or None where that is `limit` or more."""
    below = _columns_of_l(rows, columns, place, limit=limit)
    return None if below is None else sum(len(part) for part in below)


def _columns_of_l(
    rows: Integers, columns: Integers, place: Integers, *, limit: int | None
) -> list[Integers] | None:
    """Return the rows below the diagonal of each column of L, ascending."""
    n = len(place)
    low, high = (
        np.minimum(place[rows], place[columns]),
        np.maximum(place[rows], place[columns]),
    )
    keys = np.unique(low * max(n, 1) + high)
    low, high = keys // max(n, 1), keys % max(n, 1)
    low, high = low[low != high], high[low != high]
    bounds = np.searchsorted(low, np.arange(n + 1))
    children: list[list[Integers]] = [[] for _ in range(n)]
    below: list[Integers] = []
    total = 0
    for k in range(n):
        parts = [high[bounds[k] : bounds[k + 1]], *children[k]]
        children[k] = []
        parts = [part for part in parts if len(part)]
        column = parts[0] if len(parts) == 1 else _union(parts)
        below.append(column)
        total += len(column)
        if limit is not None and total >= limit:
            return None
        if len(column):
            children[column[0]].append(column[1:])
    return below


def _union(parts: list[Integers]) -> Integers:
    return np.unique(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)
