"""Gap-free runs: stretches of frames in which a point is there without interruption."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: A step of more than this many median steps is a hole in time: frames were dropped.
HOLE = 1.5


def where_present(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell where points are there, (T, N), from positions (T, N, D) that are NaN elsewhere."""
    present: NDArray[np.bool_] = np.asarray(np.isfinite(positions).all(axis=2))
    return present


def median_step(times: NDArray[np.float64]) -> float:
    """Return the usual time between frames [s], NaN for a single frame."""
    return float(np.median(np.diff(times))) if len(times) > 1 else float("nan")


def time_holes(times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell for every step between frames, (T - 1,), whether frames are missing in it."""
    steps = np.diff(times)
    if not len(steps):
        return np.zeros(0, dtype=bool)
    holes: NDArray[np.bool_] = steps > HOLE * np.median(steps)
    return holes


def is_uniform(times: NDArray[np.float64], *, tolerance: float = 1e-3) -> bool:
    """Tell whether every step that is no hole is the median step to within `tolerance` of it."""
    steps = np.diff(times)
    kept = steps[~time_holes(times)]
    if not len(kept):
        return True
    usual = np.median(steps)
    return bool(np.abs(kept - usual).max() <= tolerance * usual)


def neighbours(present: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return, for every frame and point, the last frame before and the first after that has it.

    Parameters
    ----------
    present : (T, N) bool

    Returns
    -------
    before, after : (T, N)
        The frame itself where the point is present; -1 and T where there is none.
    """
    n_frames = len(present)
    frame = np.arange(n_frames)[:, np.newaxis]
    before = np.maximum.accumulate(np.where(present, frame, -1), axis=0)
    after = np.minimum.accumulate(np.where(present, frame, n_frames)[::-1], axis=0)[::-1]
    return before, after


def run_reach(
    present: NDArray[np.bool_], breaks: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return how many samples of the same run lie before and after each sample.

    Parameters
    ----------
    present : (T, N) bool
    breaks : (T - 1,) bool, optional
        Steps between frames that end a run although the point is present on both sides.

    Returns
    -------
    before, after : (T, N)
        0 at the ends of a run, and where the point is missing.
    """
    n_frames = len(present)
    frame = np.arange(n_frames)[:, np.newaxis]
    first = np.maximum.accumulate(np.where(present, 0, frame + 1), axis=0)
    last = np.minimum.accumulate(np.where(present, n_frames - 1, frame - 1)[::-1], axis=0)[::-1]
    if breaks is not None and len(breaks):
        starts = np.zeros(n_frames, dtype=np.intp)
        starts[1:] = np.where(breaks, np.arange(1, n_frames), 0)
        ends = np.full(n_frames, n_frames - 1, dtype=np.intp)
        ends[:-1] = np.where(breaks, np.arange(n_frames - 1), n_frames - 1)
        first = np.maximum(first, np.maximum.accumulate(starts)[:, np.newaxis])
        last = np.minimum(last, np.minimum.accumulate(ends[::-1])[::-1][:, np.newaxis])
    before, after = frame - first, last - frame
    return np.where(present, before, 0), np.where(present, after, 0)
