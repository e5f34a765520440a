"""Noticing that a simulation blew up.

PyElastica's explicit steps diverge without an exception when the time step is too long: the
numbers stay finite for a while and are then absurd. Its own Timoshenko example does so for the
second rod at the time step that it prints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    velocities: NDArray[np.float64] | None,
    *,
    bars: NDArray[np.int64],
) -> Divergence | None:
    """Return the first frame that is not finite or not plausible.

    Parameters
    ----------
    time : (T,) [s]
    positions : (T, N, 3) [m]
    velocities : (T, N, 3) [m/s], optional
    bars : (E, 2)
        Pairs of neighbouring nodes.

    Notes
    -----
    Two scales come from the record itself: the element lengths of the first frame, and a
    speed, the largest of the first tenth of the frames or one rod length a frame, whichever
    is more.
    """
    bad = ~np.isfinite(positions).all(axis=(1, 2))
    if velocities is not None:
        bad |= ~np.isfinite(velocities).all(axis=(1, 2))
    sound = int(np.argmax(bad)) if bad.any() else len(time)
    candidates: list[Divergence] = []
    if bad.any():
        candidates.append(Divergence(sound, "numbers that are not finite"))
    if sound:
        with np.errstate(over="ignore", invalid="ignore"):
            for check in (_stretch, _speed):
                hit = check(
                    time[:sound],
                    positions[:sound],
                    None if velocities is None else velocities[:sound],
                    bars,
                )
                if hit:
                    candidates.append(hit)
    return min(candidates, key=lambda item: item.frame) if candidates else None


def _stretch(
    _time: NDArray[np.float64],
    positions: NDArray[np.float64],
    _velocities: NDArray[np.float64] | None,
    bars: NDArray[np.int64],
) -> Divergence | None:
    if not len(bars):
        return None
    lengths = np.linalg.norm(positions[:, bars[:, 1]] - positions[:, bars[:, 0]], axis=2)
    if not lengths[0].max() > 0.0:
        return None
    stretch = lengths.max(axis=1) / lengths[0].max()
    hits = np.flatnonzero(~(stretch <= MAX_STRETCH))
    if not len(hits):
        return None
    return Divergence(int(hits[0]), f"an element {stretch[hits[0]]:.3g} times as long as at first")


def _speed(
    time: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64] | None,
    bars: NDArray[np.int64],
) -> Divergence | None:
    if len(time) < 2:
        return None
    steps = np.diff(time)
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1) / steps
    speed = np.concatenate([moved[:1], moved])
    if velocities is not None:
        speed = np.maximum(speed, np.linalg.norm(velocities, axis=2).max(axis=1))
    start = max(2, len(time) // 10)
    length = 0.0
    if len(bars):
        length = float(
            np.linalg.norm(positions[0, bars[:, 1]] - positions[0, bars[:, 0]], axis=1).sum()
        )
    scale = max(float(speed[:start].max()), length / float(np.median(steps)))
    if not scale > 0.0:
        return None  # a point that rests at first sets no scale
    hits = np.flatnonzero(~(speed <= MAX_SPEED_JUMP * scale))
    if not len(hits):
        return None
    ratio = speed[hits[0]] / scale
    return Divergence(int(hits[0]), f"a node {ratio:.3g} times faster than the scale of the run")
