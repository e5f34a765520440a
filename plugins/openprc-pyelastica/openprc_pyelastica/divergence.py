"""Noticing that a simulation blew up.

PyElastica's explicit steps diverge without an exception when the time step is too long: the
numbers stay finite for a while and are then absurd. Its own Timoshenko example does so for the
second rod at the time step that it prints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from openprc_pyelastica.long_runs import is_finite, largest_moves, largest_norms

#: An element this many times longer than at the start is no rod any more.
MAX_STRETCH = 10.0
#: A node this many times faster than everything before is no motion any more.
MAX_SPEED_JUMP = 1e3


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first frame that cannot be true, and why."""

    frame: int
    reason: str


def find(
    time: NDArray[np.float64],
    positions: NDArray[np.float64],
    *,
    velocities: NDArray[np.float64] | None,
    lengths: NDArray[np.float64],
) -> Divergence | None:
    """Return the first frame that is not finite or not plausible.

    Parameters
    ----------
    time : (T,) [s]
    positions : (T, N, D) [m]
    velocities : (T, N, D) [m/s], optional
    lengths : (T, E) [m]
        Of the elements.

    Notes
    -----
    Two scales come from the record itself: the element lengths of the first frame, and a
    speed, the largest of the first tenth of the frames or one rod length a frame, whichever
    is more.
    """
    bad = np.zeros(len(time), dtype=bool)
    for values in (positions, velocities):
        if values is not None and not is_finite(values):
            bad |= ~np.isfinite(values).all(axis=(1, 2))
    sound = int(np.argmax(bad)) if bad.any() else len(time)
    candidates: list[Divergence | None] = []
    if bad.any():
        candidates.append(Divergence(sound, "numbers that are not finite"))
    if sound:
        with np.errstate(over="ignore", invalid="ignore"):
            candidates.append(_stretch(lengths[:sound]))
            speed = _speeds(time[:sound], positions[:sound])
            if velocities is not None:
                speed = np.maximum(speed, largest_norms(velocities[:sound]))
            if sound > 1:
                pace = float(lengths[0].sum()) / float(np.median(np.diff(time[:sound])))
                candidates.append(_jump(speed, pace))
    found = [candidate for candidate in candidates if candidate is not None]
    return min(found, key=lambda item: item.frame) if found else None


def _stretch(lengths: NDArray[np.float64]) -> Divergence | None:
    if not lengths.shape[1] or not lengths[0].max() > 0.0:
        return None
    stretch = lengths.max(axis=1) / lengths[0].max()
    hits = np.flatnonzero(~(stretch <= MAX_STRETCH))
    if not len(hits):
        return None
    return Divergence(int(hits[0]), f"an element {stretch[hits[0]]:.3g} times as long as at first")


def _speeds(time: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the speed of the quickest node at each frame: (T,)."""
    if len(time) < 2:
        return np.zeros(len(time))
    moved = largest_moves(positions) / np.diff(time)
    return np.concatenate([moved[:1], moved])


def _jump(speed: NDArray[np.float64], pace: float) -> Divergence | None:
    scale = max(float(speed[: max(2, len(speed) // 10)].max()), pace)
    if not scale > 0.0:
        return None  # a point that rests at first sets no scale
    hits = np.flatnonzero(~(speed <= MAX_SPEED_JUMP * scale))
    if not len(hits):
        return None
    ratio = speed[hits[0]] / scale
    return Divergence(int(hits[0]), f"a node {ratio:.3g} times faster than the scale of the run")
