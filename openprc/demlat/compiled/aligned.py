"""Arrays that begin on a cache line, so that a vector of eight numbers is in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import DTypeLike, NDArray

LINE_BYTES = 64


def aligned_zeros(size: int, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return zeros: (size,)."""
    kind = np.dtype(dtype)
    room = np.zeros(size * kind.itemsize + LINE_BYTES, dtype=np.uint8)
    start = -room.ctypes.data % LINE_BYTES
    return room[start : start + size * kind.itemsize].view(kind)


def aligned_zeros_like(values: NDArray[Any]) -> NDArray[Any]:
    """Return zeros with the size and type of a flat array."""
    return aligned_zeros(values.size, values.dtype)


def aligned_copy(values: NDArray[Any], dtype: DTypeLike) -> NDArray[Any]:
    """Return the values, flat."""
    copy = aligned_zeros(values.size, dtype)
    copy[...] = values.reshape(-1)
    return copy
