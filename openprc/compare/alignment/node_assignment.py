"""Nodes without names find each other by where they are."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.compare.alignment.partial_placement import starts_from_distances
from openprc.compare.alignment.rigid_motion import RigidMotion, fit_rigid_motion

Reals = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Above this many nodes, mutual nearest neighbours take the place of the best assignment.
MANY = 2000
#: Up to this many nodes, parts of a body are looked for by distances between nodes.
FEW = 200
#: Rounds of assigning and moving before the placement has to stand still.
ROUNDS = 30
#: A second candidate this near, in units of the limit, might have been the node as well.
RIVAL = 0.25
#: Two placements fit equally well where their deviations differ by less than this share.
ALIKE = 0.05


@dataclass(frozen=True)
class Assignment:
    """Which node is which.

    Parameters
    ----------
    reference, other : (n,) int
    distance : (n,) [unit of the comparison]
        After the motion.
    motion : RigidMotion or None
    ambiguous : (m,) int
        Nodes of the reference with a second candidate within the limit.
    placements : int
        Different ways to lay the body down that fit equally well.
    """

    reference: Indices
    other: Indices
    distance: Reals
    motion: RigidMotion | None
    ambiguous: Indices
    placements: int = 1

    @property
    def rms(self) -> float:
        """Root of the mean squared distance."""
        return float(np.sqrt(np.mean(self.distance**2))) if len(self.distance) else np.inf


def neighbour_distance(places: Reals) -> float:
    """Return the median distance between nearest neighbours; infinite for a single node."""
    if len(places) < 2:
        return np.inf
    distances = _tree(places).query(places, k=2)[0][:, 1]
    apart = distances[distances > 0]
    return float(np.median(apart)) if len(apart) else np.inf


def nearest_distance(x: Reals, y: Reals) -> float:
    """Return the distance of the nearest pair of a place in x and one in y."""
    return float(_tree(x).query(y)[0].min())


def assign(
    x: Reals, y: Reals, *, limit: float, fit: bool, scale: bool, reflect: bool
) -> Assignment:
    """Assign nodes at places y (m, d) to those at x (n, d).

    Up to 2000 nodes get the assignment with the smallest sum of squared distances (Crouse
    2016, doi:10.1109/TAES.2016.140952, as scipy does it), more get mutual nearest neighbours.
    With `fit` the body is moved in turns with that (Besl & McKay 1992, doi:10.1109/34.121791),
    from its place and from every way to lay its principal axes onto those of the reference.

    Parameters
    ----------
    x, y : (n, d), (m, d) [unit of the comparison]
    limit : float
        Pairs farther apart are none.
    fit, scale, reflect : bool
        Whether a rigid motion is part of it, and of what kind.
    """
    if not fit:
        return _assigned(x, y, limit, None)
    tries = [_settle(x, y, limit, s, scale=scale, reflect=reflect) for s in _starts(x, y, scale)]
    smaller = min(len(x), len(y))
    if not scale and max(len(t.reference) for t in tries) < smaller <= max(len(x), len(y)) <= FEW:
        # Principal axes of a part are not those of the whole.
        starts = starts_from_distances(x, y, limit)
        tries += [_settle(x, y, limit, s, scale=False, reflect=reflect, near=True) for s in starts]
    tries = [t for t in tries if reflect or t.motion is None or not t.motion.reflected]
    best = max(tries, key=lambda t: (len(t.reference), -t.rms))
    slack = ALIKE * best.rms + 1e-9 * float(np.ptp(x))
    equal = [
        t for t in tries if len(t.reference) == len(best.reference) and t.rms <= best.rms + slack
    ]
    alike = {tuple(t.other[np.argsort(t.reference)].tolist()) for t in equal}
    # The one that leaves the body most as it lies comes first.
    best = equal[0]
    return Assignment(
        best.reference, best.other, best.distance, best.motion, best.ambiguous, len(alike)
    )


def _settle(
    x: Reals,
    y: Reals,
    limit: float,
    start: RigidMotion | None,
    *,
    scale: bool,
    reflect: bool,
    near: bool = False,
) -> Assignment:
    motion, before = start, None
    for _ in range(ROUNDS):
        # Far from its place the body's nodes are not within the limit yet.
        found = _assigned(x, y, limit if near or before is not None else np.inf, motion)
        pairs = (found.reference.tobytes(), found.other.tobytes())
        if pairs == before or len(found.reference) == 0:
            break
        before = pairs
        motion = fit_rigid_motion(
            [(x[np.newaxis, found.reference], y[np.newaxis, found.other])],
            scale=scale,
            reflect=reflect,
        )
    return _assigned(x, y, limit, motion)


def _starts(x: Reals, y: Reals, scale: bool) -> Iterator[RigidMotion | None]:
    """Yield the place as it is, and every way to lay principal axes onto each other."""
    yield None
    d = x.shape[1]
    middles = [places.mean(axis=0) for places in (x, y)]
    # Rows are the principal axes, widest first; the moments are small, whatever the nodes.
    axes = [np.linalg.svd((p - m).T @ (p - m))[2] for p, m in zip((x, y), middles, strict=True)]
    size = [
        float(np.sqrt(((p - m) ** 2).sum(axis=1).mean()))
        for p, m in zip((x, y), middles, strict=True)
    ]
    factor = size[0] / size[1] if scale and size[1] > 0 else 1.0
    for signs in itertools.product((1.0, -1.0), repeat=d):
        turn = axes[0].T @ np.diag(signs) @ axes[1]
        if np.linalg.det(turn) > 0:
            yield RigidMotion(turn, middles[0] - factor * turn @ middles[1], factor)


def _assigned(x: Reals, y: Reals, limit: float, motion: RigidMotion | None) -> Assignment:
    at = y if motion is None else motion.apply(y[np.newaxis])[0]
    if max(len(x), len(y)) <= MANY:
        i, j = _best(x, at, limit)
    else:
        i, j = _mutual(x, at)
    distance = np.sqrt(((x[i] - at[j]) ** 2).sum(axis=1))
    near = distance <= limit
    i, j, distance = i[near], j[near], distance[near]
    return Assignment(i, j, distance, motion, _ambiguous(x[i], at, i, distance, limit))


def _best(x: Reals, y: Reals, limit: float) -> tuple[Indices, Indices]:
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    squares = cdist(x, y, "sqeuclidean")
    if np.isfinite(limit):
        # Beyond the limit all are equally bad: one stray node then displaces no other.
        squares = np.minimum(squares, 4.0 * limit**2)
    i, j = linear_sum_assignment(squares)
    return i, j


def _mutual(x: Reals, y: Reals) -> tuple[Indices, Indices]:
    to_y = _tree(y).query(x)[1]
    to_x = _tree(x).query(y)[1]
    i = np.flatnonzero(to_x[to_y] == np.arange(len(x)))
    return i, to_y[i]


def _ambiguous(x: Reals, y: Reals, i: Indices, distance: Reals, limit: float) -> Indices:
    """Return the nodes whose second candidate is hardly farther than the one they got."""
    if len(y) < 2 or not len(i) or not np.isfinite(limit):
        return np.empty(0, dtype=np.intp)
    second = _tree(y).query(x, k=2)[0][:, 1]
    return i[(second <= limit) & (second <= np.maximum(2.0 * distance, RIVAL * limit))]


def _tree(places: Reals) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(places)


__all__ = ["MANY", "Assignment", "assign", "nearest_distance", "neighbour_distance"]
