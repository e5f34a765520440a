"""Where a part of a body belongs: two or three of its nodes are looked for by their distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.compare.alignment.rigid_motion import RigidMotion, fit_rigid_motion

Reals = NDArray[np.float64]

#: Placements that are tried, and kept.
TRIED, KEPT = 4000, 6
#: How far distances may differ, in units of the limit.
LOOSE = 0.5


def starts_from_distances(x: Reals, y: Reals, limit: float) -> list[RigidMotion]:
    """Return the motions that lay most places y onto places x, best first.

    The farthest two nodes of the smaller set, in space with the one farthest from their line,
    are looked for among those of the larger one by the distances between them (Fischler &
    Bolles 1981, doi:10.1145/358669.358692, with all samples instead of random ones).

    Parameters
    ----------
    x, y : (n, d), (m, d)
    limit : float
        How far apart two nodes may be and still be the same.
    """
    from scipy.spatial import cKDTree
    from scipy.spatial.distance import cdist

    d = x.shape[1]
    part, whole = (y, x) if len(y) <= len(x) else (x, y)
    if len(part) < d or not np.isfinite(limit):
        return []
    between, distances = cdist(part, part), cdist(whole, whole)
    base = [int(k) for k in np.unravel_index(np.argmax(between), between.shape)]
    slack = LOOSE * limit
    found = np.argwhere(np.abs(distances - between[base[0], base[1]]) <= slack)
    if d == 3:
        along = (part[base[1]] - part[base[0]]) / between[base[0], base[1]]
        arm = part - part[base[0]]
        away = np.linalg.norm(arm - np.outer(arm @ along, along), axis=1)
        base.append(int(np.argmax(away)))
        near = [np.abs(distances - between[base[k], base[2]]) <= slack for k in (0, 1)]
        found = np.array(
            [(a, b, c) for a, b in found for c in np.flatnonzero(near[0][a] & near[1][b])]
        ).reshape(-1, 3)
    tree, scored = cKDTree(x), []
    for candidate in found[:TRIED]:
        points = part[base][np.newaxis], whole[candidate][np.newaxis]
        motion = fit_rigid_motion([points if part is x else points[::-1]])
        near_by = tree.query(motion.apply(y[np.newaxis])[0])[0] <= limit
        scored.append((int(near_by.sum()), motion))
    scored.sort(key=lambda item: -item[0])
    return [motion for _, motion in scored[:KEPT]]


__all__ = ["starts_from_distances"]
