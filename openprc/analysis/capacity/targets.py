"""Targets in chunks: the matrix of all targets is never held at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from openprc.analysis.capacity.terms import Terms

#: Targets a chunk at most, and samples a block: so many numbers stay near the processor, and
#: a matrix product of that size runs at full speed.
CHUNK_TERMS = 192
BLOCK_ROWS = 8192


@dataclass(frozen=True)
class RowSpan:
    """Consecutive rows, of which some may be unusable.

    Parameters
    ----------
    start, stop : int
    usable : (stop - start,) bool or None
        None when all are.
    """

    start: int
    stop: int
    usable: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, rows: NDArray[np.intp]) -> RowSpan:
        """Return the span that holds the given rows (increasing)."""
        start, stop = int(rows[0]), int(rows[-1]) + 1
        if stop - start == len(rows):
            return cls(start, stop)
        usable = np.zeros(stop - start, dtype=bool)
        usable[rows - start] = True
        return cls(start, stop, usable)

    @property
    def n_usable(self) -> int:
        """Rows that count."""
        return self.stop - self.start if self.usable is None else int(self.usable.sum())

    def blocks(self, length: int = BLOCK_ROWS) -> Iterator[RowSpan]:
        """Yield the span in pieces."""
        for start in range(self.start, self.stop, length):
            stop = min(start + length, self.stop)
            part = slice(start - self.start, stop - self.start)
            yield RowSpan(start, stop, None if self.usable is None else self.usable[part])


class TargetRows:
    """Rows of targets, computed where they are needed.

    Parameters
    ----------
    terms : Terms
    tables : sequence of (M, T)
        Polynomials of each input column; see `polynomial_rows`.
    dtype : dtype
    """

    def __init__(
        self,
        terms: Terms,
        tables: Sequence[NDArray[np.float64]],
        *,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self.terms = terms
        self.dtype = np.dtype(dtype)
        self._tables = [np.ascontiguousarray(table, dtype=self.dtype) for table in tables]
        # Few different factors make many targets: each factor is sliced once a block.
        codes = np.stack([terms.inputs, terms.degrees, terms.delays]).reshape(3, -1)
        sizes = tuple((codes.max(axis=1, initial=0) + 1).tolist())
        found, place = np.unique(np.ravel_multi_index(tuple(codes), sizes), return_inverse=True)
        self._factors = list(
            zip(*(axis.tolist() for axis in np.unravel_index(found, sizes)), strict=True)
        )
        self._members = np.where(terms.degrees > 0, place.reshape(terms.degrees.shape), -1)

    def __len__(self) -> int:
        return len(self.terms)

    def buffer(self, span: RowSpan, *, n_terms: int | None = None) -> NDArray[np.floating]:
        """Return room for one chunk of targets over one block of rows."""
        wanted = min(CHUNK_TERMS, len(self)) if n_terms is None else n_terms
        return np.empty((wanted, min(BLOCK_ROWS, span.stop - span.start)), dtype=self.dtype)

    def fill(self, chunk: range, span: RowSpan, out: NDArray[np.floating]) -> NDArray[np.floating]:
        """Write the targets of `chunk` at the rows of `span` into `out`, and return that part.

        Unusable rows are zero, so that they add nothing to any sum.
        """
        part = out[: len(chunk), : span.stop - span.start]
        views = [
            self._tables[c][d - 1, span.start - lag : span.stop - lag] if d else None
            for c, d, lag in self._factors
        ]
        for row, members in zip(
            part, self._members[chunk.start : chunk.stop].tolist(), strict=True
        ):
            if len(members) == 1 or members[1] < 0:
                row[:] = views[members[0]]
                continue
            np.multiply(views[members[0]], views[members[1]], row)
            for other in members[2:]:
                if other >= 0:
                    row *= views[other]
        if span.usable is not None:
            part *= span.usable
        return part

    def whole(self, span: RowSpan) -> NDArray[np.floating]:
        """Return all targets at the usable rows, (K, n): for few targets only."""
        out = np.empty((len(self), span.stop - span.start), dtype=self.dtype)
        self.fill(range(len(self)), span, out)
        return out if span.usable is None else out[:, span.usable]


def chunks(n_terms: int, size: int = CHUNK_TERMS) -> Iterator[range]:
    """Yield consecutive ranges of targets of nearly equal length, `size` at most."""
    count = -(-n_terms // size)
    for k in range(count):
        yield range(k * n_terms // count, (k + 1) * n_terms // count)
