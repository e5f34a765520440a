"""Two cameras on one clock: interpolation of one onto the other, and the offset between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from openprc.errors import CalibrationError
from openprc.vision.calibration.mapping import Array, finite

# Times closer than this share of a frame are the same.
_SAME = 1e-3
# A step of time longer than this many median steps is a hole, across which nothing is guessed.
_HOLE = 1.5
# Correlations as high as this share of the highest make the offset ambiguous.
_RIVAL = 0.95


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How much later the right camera's clock reads zero.

    Attributes
    ----------
    seconds : float [s]
        To be added to the right camera's times.
    sigma : float [s]
        One-sigma, from how sharply the correlation peaks.
    correlation : float
        Of the two motions at that offset, 0..1.
    notes : tuple of str
    """

    seconds: float
    sigma: float
    correlation: float
    notes: tuple[str, ...] = ()


def on_clock(times: Array, values: Array, clock: Array) -> Array:
    """Interpolate series to other times.

    Through four samples where they are there (the cubic through them, third order in time), through
    two otherwise. Nothing is extrapolated; next to a missing sample and inside a hole of the time
    axis the result is NaN.

    Parameters
    ----------
    times : (T,) [s]
        Increasing.
    values : (T, ...)
    clock : (S,) [s]

    Returns
    -------
    (S, ...)
    """
    out = np.full((len(clock), *values.shape[1:]), np.nan)
    if len(times) == 0:
        return out
    step = np.median(np.diff(times)) if len(times) > 1 else 1.0
    nearest = np.clip(np.searchsorted(times, clock), 1, max(1, len(times) - 1))
    for index, now in enumerate(clock):
        k = nearest[index]
        same = [i for i in (k - 1, k) if i < len(times) and abs(times[i] - now) <= _SAME * step]
        if same:
            out[index] = values[same[0]]
            continue
        if k >= len(times) or not times[k - 1] < now < times[k]:
            continue
        if times[k] - times[k - 1] > _HOLE * step:
            continue
        share = (now - times[k - 1]) / (times[k] - times[k - 1])
        out[index] = (1.0 - share) * values[k - 1] + share * values[k]
        if k >= 2 and k + 1 < len(times) and times[k + 1] - times[k - 2] < 3.0 * _HOLE * step:
            four = np.array([_lagrange(times[k - 2 : k + 2], i, now) for i in range(4)])
            cubic = np.tensordot(four, values[k - 2 : k + 2], axes=1)
            good = np.isfinite(cubic)
            out[index][good] = cubic[good]
    return out


def _lagrange(nodes: Array, i: int, now: float) -> float:
    others = np.delete(nodes, i)
    return float(np.prod((now - others) / (nodes[i] - others)))


def estimate_time_offset(left: Any, right: Any, *, max_offset: float | None = None) -> TimeOffset:
    """Find the offset between two recordings of one motion, from the motion itself.

    The strongest common pattern of motion of each camera (the first principal component of the
    displacements) is compared at all offsets; the peak of the correlation is refined by a parabola.

    Parameters
    ----------
    left, right : TrackingResult or TrajectorySet
        Of the same object; the points need not be the same.
    max_offset : float, optional [s]
        Largest offset that is tried; by default half of the shorter recording.

    Raises
    ------
    CalibrationError
        When there is no motion, no overlap, or the motions do not agree.
    """
    series = [_motion(item, side) for item, side in ((left, "left"), (right, "right"))]
    steps = [np.median(np.diff(times)) for times, _ in series]
    spans = [times[-1] - times[0] for times, _ in series]
    limit = (
        0.5 * min(spans) if max_offset is None else finite(max_offset, key="max_offset", above=0)
    )
    step = float(min(steps)) / 4.0
    grids = [np.arange(times[0], times[-1], step) for times, _ in series]
    waves = [
        np.interp(grid, times, wave) for grid, (times, wave) in zip(grids, series, strict=True)
    ]
    n = int(limit / step)
    start = grids[0][0] - grids[1][0]
    lags = np.arange(-n, n + 1)
    scores = np.array([_correlation(*_overlap(waves, lag)) for lag in lags - round(start / step)])
    rest = start - step * round(start / step)
    if not np.isfinite(scores).any() or np.nanmax(np.abs(scores)) < 0.5:
        raise CalibrationError(
            "the motions in the two recordings do not agree at any offset up to "
            f"{limit:g} s (highest correlation "
            f"{np.nanmax(np.abs(scores), initial=0.0):.2f})",
            expected="two recordings of one motion that overlap",
            fix="pass time_offset as measured from a flash, or a larger max_offset",
            key="time_offset",
        )
    size = np.nan_to_num(np.abs(scores))
    best = int(np.argmax(size))
    peak, bend = float(best), 0.0
    if 0 < best < len(size) - 1:
        bend = size[best - 1] - 2.0 * size[best] + size[best + 1]
        if bend < 0.0:
            peak += 0.5 * (size[best - 1] - size[best + 1]) / bend
    notes = []
    humps = [
        i for i in range(1, len(size) - 1)
        if size[i] >= size[i - 1] and size[i] >= size[i + 1] and abs(i - best) > 8
        and size[i] > _RIVAL * size[best]
    ]  # fmt: skip
    if humps:
        others = ", ".join(f"{(lags[i]) * step + rest:.4g}" for i in humps[:3])
        notes.append(
            f"the motion repeats itself: offsets of {others} s fit nearly as well; say max_offset"
        )
    if best in (0, len(size) - 1):
        notes.append("the best offset is at the end of the range that was tried")
    # Variance of the maximum of a sampled correlation: what is left over the curvature, over the
    # number of independent samples.
    samples = min(spans) / max(steps)
    left_over = max(1.0 - size[best] ** 2, 1e-12)
    sigma = step * np.sqrt(left_over / (2.0 * max(-bend, 1e-12) * max(samples, 1.0)))
    return TimeOffset(
        float((peak - n) * step + rest), float(sigma), float(size[best]), tuple(notes)
    )


def _motion(item: Any, side: str) -> tuple[Array, Array]:
    """Times, and the first principal component of the displacements of points seen throughout."""
    times = np.asarray(item.timestamps, np.float64)
    positions = np.asarray(item.positions, np.float64)
    kept = np.isfinite(positions).all(axis=(0, 2))
    if len(times) < 8 or not kept.any():
        raise CalibrationError(
            f"the {side} recording has {len(times)} frames and {int(kept.sum())} points that are "
            "seen in all of them",
            expected="at least 8 frames, and a point without gaps",
            fix="fill the gaps first, or pass time_offset",
            key=side,
        )
    moved = positions[:, kept].reshape(len(times), -1)
    moved = moved - moved.mean(axis=0)
    u, s, _ = np.linalg.svd(moved, full_matrices=False)
    if s[0] < 1e-9 * max(1.0, np.abs(positions[:, kept]).max()):
        raise CalibrationError(
            f"nothing moves in the {side} recording",
            expected="a motion that both cameras see",
            fix="pass time_offset as measured from a flash",
            key=side,
        )
    return times, u[:, 0]


def _overlap(waves: list[Array], lag: int) -> tuple[Array, Array]:
    """The parts of both that are there at once, when the right one is `lag` samples later."""
    a, b = waves
    first, last = max(0, lag), min(len(a), len(b) + lag)
    return a[first:last], b[first - lag : last - lag]


def _correlation(a: Array, b: Array) -> float:
    if len(a) < 16:
        return float("nan")
    a, b = a - a.mean(), b - b.mean()
    norm = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / norm) if norm > 0.0 else float("nan")
