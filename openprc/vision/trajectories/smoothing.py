"""Smoothing inside gap-free runs: moving average and Savitzky-Golay, in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.trajectories.runs import (
    is_uniform,
    median_step,
    run_reach,
    time_holes,
    where_present,
)

SmoothingMethod = Literal["mean", "savgol"]


@dataclass(frozen=True)
class Smoothed:
    """What `smooth` made.

    Attributes
    ----------
    positions : (T, N, D)
    sigma : (T, N, D) or None
    n_short : int
        Runs that are too short for the whole window and got a shorter one, or none.
    """

    positions: NDArray[np.float64]
    sigma: NDArray[np.float64] | None
    n_short: int


def smooth(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    *,
    window: int = 5,
    method: SmoothingMethod = "mean",
    polyorder: int = 2,
    sigma: NDArray[np.float64] | None = None,
) -> Smoothed:
    """Smooth every gap-free run of every point on its own.

    Parameters
    ----------
    positions : (T, N, D)
        NaN where a point is missing; a run ends there, and where frames were dropped.
    times : (T,) [s]
    window : int
        Number of frames, odd.
    method : {"mean", "savgol"}
        A moving average, or the polynomial of order `polyorder` fitted to the window by least
        squares [1]_.
    sigma : (T, N, D), optional
        One-sigma of the positions.

    Returns
    -------
    Smoothed
        Towards the end of a run the average takes as many frames on one side as there are on the
        other, and the polynomial is that of the last whole window, so that neither shifts in
        time. A run shorter than the window gets the longest odd window that fits; one that has
        no more frames than the polynomial has coefficients is left as it is. Where frames are
        not evenly spaced, the weights are those of the fit in time, for the average of a straight
        line; on an even clock they are equal. The variances are summed with the squares of the
        weights: that holds for noise that is independent from frame to frame, and not for the
        part that a template adds, which is the same in all frames that were found with it.

    Raises
    ------
    ConfigError
        When the window is not odd, or not longer than `polyorder`.

    Notes
    -----
    An average of M frames at the rate F passes a sinusoid of frequency f with the gain
    ``sin(pi f M / F) / (M sin(pi f / F))``: 5 frames leave 0.647 of a motion at F/10 and nothing
    at F/5. The polynomial of order 2 over 5 frames leaves 0.987 and 0.836 of them, and 17/35 of
    the variance of white noise where the average leaves 1/5.

    References
    ----------
    .. [1] A. Savitzky, M. J. E. Golay, Analytical Chemistry 36, 1627 (1964),
       doi:10.1021/ac60214a047
    """
    order = _check(window, method, polyorder)
    present = where_present(positions)
    before, after = run_reach(present, time_holes(times))
    half = (window - 1) // 2
    # Each sample has a window [start, start + 2 reach] of its run, evaluated at `at`.
    if method == "mean":
        reach = np.minimum(half, np.minimum(before, after))
        lead = reach
    else:
        reach = np.minimum(half, (before + after) // 2)
        reach = np.where(2 * reach + 1 > order, reach, 0)
        lead = np.clip(before, 0, reach)
        lead = np.maximum(lead, 2 * reach - after)
    smoother = _Windows(times, 1 if method == "mean" else order, uniform=is_uniform(times))
    values, spread = smoother.apply(positions, sigma, present, reach, lead)
    starts = present & (before == 0)
    short = starts & (before + after + 1 < window)
    return Smoothed(values, spread, int(short.sum()))


def _check(window: int, method: str, polyorder: int) -> int:
    if method not in get_args(SmoothingMethod):
        raise ConfigError(
            f"unknown method {method!r}",
            expected="mean or savgol",
            fix="mean suppresses noise most, savgol keeps peaks",
            key="method",
        )
    if not isinstance(window, int | np.integer) or window < 1 or window % 2 == 0:
        raise ConfigError(
            f"a window of {window!r} frames",
            expected="an odd number of 1 or more",
            fix="an even window would shift the motion by half a frame",
            key="window",
        )
    if method == "savgol" and not 0 <= polyorder < window:
        raise ConfigError(
            f"a polynomial of order {polyorder} in a window of {window} frames",
            expected="an order of 0 or more and below the window",
            fix="take a longer window or a lower order",
            key="polyorder",
        )
    return int(polyorder)


class _Windows:
    """Weights of local polynomial fits, shared by all points that have the same window."""

    def __init__(self, times: NDArray[np.float64], order: int, *, uniform: bool) -> None:
        self._times = times
        self._order = order
        self._uniform = uniform
        self._step = median_step(times)

    def apply(
        self,
        positions: NDArray[np.float64],
        sigma: NDArray[np.float64] | None,
        present: NDArray[np.bool_],
        reach: NDArray[np.intp],
        lead: NDArray[np.intp],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        values = positions.copy()
        spread = None if sigma is None else np.array(sigma, dtype=np.float64)
        variance = None if spread is None else spread**2
        moved = present & (reach > 0)
        kinds = np.where(moved, reach * (2 * reach.max(initial=0) + 1) + lead, -1)
        for kind in np.unique(kinds[moved]):
            frame, node = np.nonzero(kinds == kind)
            half, ahead = reach[frame[0], node[0]], lead[frame[0], node[0]]
            weights = self._weights(int(half), int(ahead))
            sums = np.zeros((len(frame), positions.shape[2]))
            squares = np.zeros_like(sums)
            for k in range(2 * half + 1):
                row = frame - ahead + k
                weight = weights[frame, k][:, np.newaxis] if weights.ndim == 2 else weights[k]
                sums += weight * positions[row, node]
                if variance is not None:
                    squares += weight**2 * variance[row, node]
            values[frame, node] = sums
            if spread is not None:
                spread[frame, node] = np.sqrt(squares)
        return values, spread

    def _weights(self, half: int, ahead: int) -> NDArray[np.float64]:
        """Return the weights of a window that begins `ahead` frames before the frame.

        (2 half + 1,) on an even clock, (T, 2 half + 1) otherwise.
        """
        width = 2 * half + 1
        if self._uniform:
            from scipy.signal import savgol_coeffs

            order = min(self._order, width - 1)
            coefficients: NDArray[np.float64] = savgol_coeffs(width, order, pos=ahead, use="dot")
            return coefficients
        n_frames = len(self._times)
        rows = np.arange(n_frames)[:, np.newaxis] - ahead + np.arange(width)
        inside = (rows >= 0) & (rows < n_frames)
        clock = self._times[np.clip(rows, 0, n_frames - 1)] - self._times[:, np.newaxis]
        # Windows that leave the record are never used; any clock does for them.
        clock = np.where(inside.all(axis=1)[:, np.newaxis], clock / self._step, np.arange(width))
        powers = clock[..., np.newaxis] ** np.arange(min(self._order, width - 1) + 1)
        fits: NDArray[np.float64] = np.linalg.pinv(powers)[:, 0]
        return fits
