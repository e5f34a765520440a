"""Numbers of long recordings, computed a stretch of frames at a time.

A block that fits into the cache is read from memory once, whatever is computed of it; arrays of
the size of the whole recording would each be written to memory and read again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

#: Bytes of positions in a block.
BLOCK_BYTES = 256 << 10


def blocks(array: NDArray[np.float64], *, overlap: int = 0) -> Iterator[tuple[int, int]]:
    """Yield the first and the last + 1 frame of every block; each begins `overlap` early."""
    rows = max(1, BLOCK_BYTES // max(1, array[:1].nbytes))
    for start in range(0, len(array), rows):
        yield max(0, start - overlap), min(len(array), start + rows)


def is_finite(array: NDArray[np.float64]) -> bool:
    """Whether every number is finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        # A finite sum has finite terms; only the sum of a sound array can be too large.
        return bool(np.isfinite(array.sum())) or bool(np.isfinite(array).all())


def norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors: (..., D) to (...)."""
    squares = vectors * vectors
    total: NDArray[np.float64] = squares[..., 0] + squares[..., 1]
    for axis in range(2, vectors.shape[-1]):
        total += squares[..., axis]
    return np.sqrt(total, out=total)


def element_lengths(positions: NDArray[np.float64], bars: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the lengths of bars in every frame: (T, N, D) to (T, E)."""
    chain = len(bars) and np.array_equal(bars, np.arange(len(bars))[:, np.newaxis] + [0, 1])
    lengths = np.empty((len(positions), len(bars)))
    for start, stop in blocks(positions):
        block = positions[start:stop]
        if chain:  # neighbours in memory: no need to look them up
            arms = block[:, 1 : len(bars) + 1] - block[:, : len(bars)]
        else:
            arms = block[:, bars[:, 1]] - block[:, bars[:, 0]]
        lengths[start:stop] = norms(arms)
    return lengths


def largest_moves(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the quickest node moved from each frame to the next: (T - 1,)."""
    moves = np.empty(max(0, len(positions) - 1))
    for start, stop in blocks(positions, overlap=1):
        if stop - start > 1:
            moves[start : stop - 1] = norms(np.diff(positions[start:stop], axis=0)).max(axis=1)
    return moves


def largest_norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length of the longest vector of each frame: (T, N, D) to (T,)."""
    longest = np.empty(len(vectors))
    for start, stop in blocks(vectors):
        longest[start:stop] = norms(vectors[start:stop]).max(axis=1)
    return longest
