"""Chosen rows of a state matrix, handed out in blocks that fit into the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A block of this size stays in the second-level cache while it is centred and multiplied;
# products of fewer rows than _FEWEST spend their time on loading and storing the result.
_BLOCK_BYTES = 1 << 19
_FEWEST, _MOST = 256, 4096
# Rows from all over the matrix whose mean serves as a provisional origin.
_SAMPLED = 64


def rows_per_block(n_columns: int) -> int:
    """Return how many rows of `n_columns` float64 values make a block."""
    return int(np.clip(_BLOCK_BYTES // (8 * max(1, n_columns)), _FEWEST, _MOST))


@dataclass(frozen=True)
class RowBlocks:
    """Rows of a state matrix that is never copied as a whole.

    Parameters
    ----------
    states : (R, F) float64
    rows : (n,) int
        Numbers of the rows that count, rising. Where they are consecutive, blocks are views.
    """

    states: NDArray[np.float64]
    rows: NDArray[np.intp]

    @classmethod
    def all_of(cls, states: NDArray[np.float64]) -> RowBlocks:
        """Return all rows of a matrix."""
        return cls(states, np.arange(len(states)))

    def __len__(self) -> int:
        """Return the number of rows, n."""
        return len(self.rows)

    @property
    def n_columns(self) -> int:
        """Number of columns, F."""
        return self.states.shape[1]

    @property
    def consecutive(self) -> bool:
        """Whether no row between the first and the last is left out."""
        return len(self) == 0 or int(self.rows[-1]) - int(self.rows[0]) + 1 == len(self)

    def take(self, start: int, stop: int) -> NDArray[np.float64]:
        """Return the chosen rows from `start` to `stop`, counted among the chosen ones."""
        rows = self.rows[start:stop]
        if len(rows) and int(rows[-1]) - int(rows[0]) + 1 == len(rows):
            return self.states[int(rows[0]) : int(rows[-1]) + 1]
        return self.states[rows]

    def part(self, start: int, stop: int) -> RowBlocks:
        """Return the chosen rows from `start` to `stop` as blocks of their own."""
        return RowBlocks(self.states, self.rows[start:stop])

    def matrix(self) -> NDArray[np.float64]:
        """Return all chosen rows, (n, F): a view where they are consecutive."""
        return self.take(0, len(self))

    def sample(self) -> NDArray[np.float64]:
        """Return a few rows spread over all chosen ones."""
        step = max(1, len(self) // _SAMPLED)
        return self.states[self.rows[::step][:_SAMPLED]]

    def __iter__(self) -> Iterator[tuple[slice, NDArray[np.float64]]]:
        """Yield each block with its place among the chosen rows."""
        step = rows_per_block(self.n_columns)
        for start in range(0, len(self), step):
            stop = min(start + step, len(self))
            yield slice(start, stop), self.take(start, stop)
