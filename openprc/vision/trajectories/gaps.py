"""Filling short gaps by interpolation in time; nothing is ever extrapolated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.trajectories.runs import median_step, neighbours, where_present

GapMethod = Literal["linear", "pchip", "cubic"]


@dataclass(frozen=True)
class FilledGaps:
    """What `fill_gaps` made.

    Attributes
    ----------
    positions : (T, N, D)
    sigma : (T, N, D) or None
    filled : (T, N) bool
        Where a position was filled in.
    n_gaps, n_left : int
        Gaps that were filled, and gaps between measurements that were too long.
    """

    positions: NDArray[np.float64]
    sigma: NDArray[np.float64] | None
    filled: NDArray[np.bool_]
    n_gaps: int
    n_left: int


def gap_lengths(present: NDArray[np.bool_], times: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the length of the gap that every missing sample lies in, in frames.

    Parameters
    ----------
    present : (T, N) bool
    times : (T,) [s]

    Returns
    -------
    lengths : (T, N)
        0 where the point is present, -1 before its first and after its last measurement. Frames
        that were dropped inside a gap count as well: the length is the number of median steps
        that fit between the measurements on both sides, less one, where that is more than the
        number of rows.
    """
    n_frames = len(present)
    before, after = neighbours(present)
    lengths = after - before - 1
    inside = ~present & (before >= 0) & (after < n_frames)
    step = median_step(times)
    if inside.any() and step > 0:
        span = times[after[inside]] - times[before[inside]]
        lengths[inside] = np.maximum(lengths[inside], np.rint(span / step).astype(np.intp) - 1)
    lengths[present] = 0
    lengths[~present & ~inside] = -1
    return lengths


def fill_gaps(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    *,
    method: GapMethod = "linear",
    max_gap: int | None = None,
    sigma: NDArray[np.float64] | None = None,
) -> FilledGaps:
    """Fill the gaps between measurements that are no longer than `max_gap` frames.

    Parameters
    ----------
    positions : (T, N, D)
        NaN where a point is missing.
    times : (T,) [s]
        Interpolation runs in time, not in the number of the frame.
    method : {"linear", "pchip", "cubic"}
        ``pchip`` keeps the shape of the data and never overshoots; ``cubic`` is smooth twice.
        Both look at the measurements of one stretch only, up to the next gap that is too long.
    max_gap : int, optional
        None fills every gap between two measurements.
    sigma : (T, N, D), optional
        One-sigma of the measurements.

    Returns
    -------
    FilledGaps
        Measurements are as they were, bit for bit. What lies before the first and after the
        last measurement of a point stays missing. The variance of a filled position, at times
        a and b from the measurements on both sides, is that of the straight line between them
        plus the square of ``alpha a b / 2``, the error of a straight line where the acceleration
        is `alpha`. That is the rms of what lines over spans of the same length would have been
        wrong by, where the point was measured (`rms_acceleration`); NaN where it never was.

    Raises
    ------
    ConfigError
        When `method` is not known or `max_gap` is no whole number of 0 or more.
    """
    if method not in get_args(GapMethod):
        raise ConfigError(
            f"unknown method {method!r}",
            expected="one of " + ", ".join(get_args(GapMethod)),
            fix="linear is safe; nothing else is made up where nothing was measured",
            key="method",
        )
    if max_gap is not None and not (isinstance(max_gap, int | np.integer) and max_gap >= 0):
        raise ConfigError(
            f"max_gap is {max_gap!r}",
            expected="a number of frames, 0 or more, or None for no limit",
            fix="give the longest gap that may be filled",
            key="max_gap",
        )
    present = where_present(positions)
    lengths = gap_lengths(present, times)
    limit = int(lengths.max(initial=0)) if max_gap is None else int(max_gap)
    wanted = (lengths > 0) & (lengths <= limit)
    filled = positions.copy()
    if wanted.any():
        if method == "linear":
            _fill_linear(filled, times, present, wanted)
        else:
            _fill_smooth(filled, times, present, (lengths > limit), wanted, method)
    n_all, n_gaps = _count(lengths > 0), _count(wanted)
    grown = None if sigma is None else _sigma(sigma, positions, times, present, wanted)
    return FilledGaps(filled, grown, wanted, n_gaps, n_all - n_gaps)


def _count(mask: NDArray[np.bool_]) -> int:
    starts = mask.copy()
    starts[1:] &= ~mask[:-1]
    return int(starts.sum())


def _fill_linear(
    filled: NDArray[np.float64],
    times: NDArray[np.float64],
    present: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
) -> None:
    before, after = neighbours(present)
    frame, node = np.nonzero(wanted)
    first, last = before[frame, node], after[frame, node]
    weight = ((times[frame] - times[first]) / (times[last] - times[first]))[:, np.newaxis]
    start, end = filled[first, node], filled[last, node]
    filled[frame, node] = start + weight * (end - start)


def _fill_smooth(
    filled: NDArray[np.float64],
    times: NDArray[np.float64],
    present: NDArray[np.bool_],
    barrier: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    method: GapMethod,
) -> None:
    from scipy.interpolate import CubicSpline, PchipInterpolator

    interpolator = PchipInterpolator if method == "pchip" else CubicSpline
    for node in np.flatnonzero(wanted.any(axis=0)):
        # A gap that stays open ends the stretch: nothing is carried over it.
        stretch = np.cumsum(barrier[:, node])
        for label in np.unique(stretch[wanted[:, node]]):
            inside = (stretch == label) & ~barrier[:, node]
            known = np.flatnonzero(inside & present[:, node])
            holes = np.flatnonzero(inside & wanted[:, node])
            curve = interpolator(times[known], filled[known, node], axis=0)
            filled[holes, node] = curve(times[holes])


def _sigma(
    sigma: NDArray[np.float64],
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    present: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
) -> NDArray[np.float64]:
    grown = np.array(sigma, dtype=np.float64)
    before, after = neighbours(present)
    frame, node = np.nonzero(wanted)
    first, last = before[frame, node], after[frame, node]
    since, until = times[frame] - times[first], times[last] - times[frame]
    weight = (since / (since + until))[:, np.newaxis]
    line = ((1 - weight) * grown[first, node]) ** 2 + (weight * grown[last, node]) ** 2
    half = np.maximum(1, gap_lengths(present, times)[frame, node] + 1) // 2
    for spacing in np.unique(half):
        here = half == spacing
        alpha = rms_acceleration(positions, times, sigma, spacing=max(1, int(spacing)))
        bend = 0.5 * alpha[node[here]] * (since * until)[here, np.newaxis]
        grown[frame[here], node[here]] = np.sqrt(line[here] + bend**2)
    return grown


def rms_acceleration(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    sigma: NDArray[np.float64] | None = None,
    *,
    spacing: int = 1,
) -> NDArray[np.float64]:
    """Return the rms acceleration of every point, (N, D) [unit/s2].

    From second divided differences of measurements that are `spacing` frames apart, so that it is
    the acceleration at that scale of time; what white noise of one-sigma `sigma` adds to their
    mean square is taken off. NaN where a point has no three measurements so far apart.
    """
    n_nodes, n_axes = positions.shape[1:]
    out = np.full((n_nodes, n_axes), np.nan)
    if len(times) < 2 * spacing + 1:
        return out
    first, middle, last = (
        slice(None, -2 * spacing),
        slice(spacing, -spacing),
        slice(2 * spacing, None),
    )
    h1, h2 = times[middle] - times[first], times[last] - times[middle]
    weights = [
        (place, weight[:, np.newaxis, np.newaxis])
        for place, weight in (
            (first, 2 / (h1 * (h1 + h2))),
            (middle, -2 / (h1 * h2)),
            (last, 2 / (h2 * (h1 + h2))),
        )
    ]
    square = np.asarray(sum(weight * positions[place] for place, weight in weights)) ** 2
    if sigma is not None:
        noise = np.nan_to_num(np.asarray(sigma, dtype=np.float64))
        square -= sum((weight * noise[place]) ** 2 for place, weight in weights)
    known = np.isfinite(square)
    count = known.sum(axis=0)
    total = np.where(known, square, 0.0).sum(axis=0)
    np.divide(total, count, out=out, where=count > 0)
    rms: NDArray[np.float64] = np.sqrt(np.maximum(out, 0.0))
    return rms
