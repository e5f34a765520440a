"""Which points move as their surroundings do not.

A pattern that repeats itself, as the cells of a folded sheet do, matches one cell further as
well, and no correlation with a template can tell. The neighbours can. But a body that moves on its
own departs from its neighbours rightly; therefore a point is only called into question here,
and the image decides: the tracker looks where the neighbours lead to, and the point has gone
astray only if it is found there too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.local_motion import MAD_TO_SIGMA, local_motion, masked_median

#: A point is out of line from this many robust deviations of its neighbours on.
DEVIATIONS = 3.0
#: Distance [px] from its place among its neighbours that is always allowed to a point.
_ALLOWANCE = 0.7
#: Neighbours without whose agreement nothing is held against, or for, a point.
_SUPPORT = 5
#: Robust deviation of neighbours [px] from which on they agree on nothing.
_SCATTER = 1.5
#: Distance that is allowed to another point as led to by a point's own deformation, beyond
#: that and for each pixel between them.
_BENDING = 0.1


def out_of_line(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    found: NDArray[np.bool_],
    neighbours: NDArray[np.intp],
    *,
    allowance: float,
) -> NDArray[np.intp]:
    """Return the points (n,) whose step departs from the steps of their neighbours.

    Parameters
    ----------
    before, after : (N, 2) [px]
        In two successive frames.
    found : (N,)
        Points that count, in both.
    neighbours : (N, k)
        The neighbours of each point.
    allowance : float [px]
        A departure below this is never called into question.
    """
    if neighbours.shape[1] < 3 or np.count_nonzero(found) < 4:
        return np.zeros(0, np.intp)
    moved = np.where(found[:, None], after - before, 0.0)
    valid = found[neighbours]
    theirs = moved[neighbours]
    middle = np.stack([masked_median(theirs[..., c], valid) for c in (0, 1)], axis=1)
    own = np.linalg.norm(moved - middle, axis=1)
    suspects = np.flatnonzero(found & (valid.sum(axis=1) >= 3) & (own > allowance))
    if not len(suspects):
        return suspects
    around = np.linalg.norm(theirs[suspects] - middle[suspects, None], axis=2)
    spread = MAD_TO_SIGMA * masked_median(around, valid[suspects])
    return suspects[own[suspects] > DEVIATIONS * spread]


def out_of_place(
    points: NDArray[np.intp],
    reference: NDArray[np.float64],
    positions: NDArray[np.float64],
    deformation: NDArray[np.float64],
    found: NDArray[np.bool_],
    neighbours: NDArray[np.intp],
    *,
    doubtful: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return which of `points` (n,) are not where their neighbours were deformed to.

    A point is left alone if two of the neighbours that depart from the rest move as it does:
    they are on a body of their own.

    Parameters
    ----------
    points : (n,)
        Rows of the table of neighbours.
    reference, positions : (N, 2) [px]
        In the reference frame and now.
    deformation : (n, 2, 2)
        Deformation gradient at `points`.
    found : (N,)
    neighbours : (N, k)
    doubtful : (n,)
        Points that need five neighbours in agreement to be believed.
    """
    table = neighbours[points]
    if table.shape[1] < _SUPPORT:
        return np.zeros(len(points), bool)
    valid = found[table]
    at = reference[points]
    place = local_motion(reference[table], positions[table], valid, at)
    away = np.linalg.norm(positions[points] - place.positions, axis=1)
    limit = np.maximum(DEVIATIONS * place.spread, _ALLOWANCE)
    with np.errstate(invalid="ignore"):
        enough = valid.sum(axis=1) >= _SUPPORT
        alone = doubtful & (~enough | (place.spread > _SCATTER))
        off = (away > limit) & enough & ~alone
    if off.any():
        offset = reference[table] - at[:, None]
        led = positions[points][:, None] + np.einsum("nij,nkj->nki", deformation, offset)
        apart = np.linalg.norm(positions[table] - led, axis=2)
        near = apart < _ALLOWANCE + _BENDING * np.linalg.norm(offset, axis=2)
        apart_from_rest = place.residuals > limit[:, None]
        off &= (valid & near & apart_from_rest).sum(axis=1) < 2
    return off | alone
