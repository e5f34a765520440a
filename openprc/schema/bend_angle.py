"""The angle between the two arms of a bend, as every file of the contract means it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bend_angles(
    positions: NDArray[np.float64], indices: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return angles between arms in [0, pi]: (T, B) [rad]; pi is straight.

    ``atan2(|u x v|, u . v)`` for the arms u and v from the vertex: unlike the arc cosine it
    loses no digits where the arms are nearly parallel (Kahan 2006, "How futile are mindless
    assessments of roundoff in floating-point computation?", section 12).

    Parameters
    ----------
    positions : (T, N, 3)
        T frames.
    indices : (B, 3)
        End, vertex, end: /topology/bends/indices.
    """
    first, vertex, last = (positions[:, indices[:, corner]] for corner in range(3))
    u, v = first - vertex, last - vertex
    # u + v is small where the arms are nearly opposite, so its product keeps the digits.
    normal = np.cross(u, u + v)
    sine = np.sqrt(np.einsum("tbx,tbx->tb", normal, normal))
    angles: NDArray[np.float64] = np.arctan2(sine, np.einsum("tbx,tbx->tb", u, v))
    return angles
