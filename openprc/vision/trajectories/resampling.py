"""Trajectories on another clock, usually an even one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.vision.trajectories.gaps import rms_acceleration
from openprc.vision.trajectories.runs import time_holes

ResamplingMethod = Literal["cubic", "pchip", "linear"]
#: Instants this near to a frame, in steps, are that frame.
_SAME = 1e-6


@dataclass(frozen=True)
class Resampled:
    """Positions on a new clock.

    Attributes
    ----------
    positions : (S, N, D)
        NaN before the first and after the last measurement of a point, and inside its gaps.
    observed : (S, N)
        0 missing; 1 between two frames that follow each other and were both measured, or at
        one; 2 where one of them was filled in, or where frames were dropped in between.
    source : (S,)
        The frame at or before each instant.
    sigma : (S, N, D) or None
    """

    positions: NDArray[np.float64]
    observed: NDArray[np.uint8]
    source: NDArray[np.intp]
    sigma: NDArray[np.float64] | None


def even_clock(times: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Return instants ``t0 + i / rate`` up to the last frame, (S,) [s].

    Raises
    ------
    ConfigError
        When the rate is not a positive number, or the record is shorter than one step.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise ConfigError(
            f"a rate of {rate} Hz", expected="a positive number", fix="correct it", key="rate"
        )
    slack = _SAME * np.median(np.diff(times)) if len(times) > 1 else 0.0
    count = int(np.floor((times[-1] - times[0] + slack) * rate)) + 1
    if count < 2:
        raise ConfigError(
            f"at {rate:g} Hz the record of {times[-1] - times[0]:g} s has {count} instant",
            expected="at least two",
            fix="choose a higher rate",
            key="rate",
        )
    return np.asarray(times[0] + np.arange(count) / rate)


def resample(
    positions: NDArray[np.float64],
    observed: NDArray[np.uint8],
    times: NDArray[np.float64],
    instants: ArrayLike,
    *,
    method: ResamplingMethod = "cubic",
    sigma: NDArray[np.float64] | None = None,
) -> Resampled:
    """Interpolate gap-free runs in time to new instants.

    Parameters
    ----------
    positions : (T, N, D)
    observed : (T, N)
        0 missing, 1 measured, 2 filled in.
    times : (T,) [s]
    instants : (S,) [s]
        Increasing, inside the record: nothing is extrapolated.
    method : {"cubic", "pchip", "linear"}
        Cubic splines through the measurements of one run; ``pchip`` does not overshoot.
    sigma : (T, N, D), optional
        Interpolated between the neighbouring frames as variances of a straight line.

    Raises
    ------
    ConfigError
        When the instants do not increase or leave the record, or the method is not known.
    """
    new = _checked(instants, times, method)
    step = np.median(np.diff(times)) if len(times) > 1 else 1.0
    left = np.clip(np.searchsorted(times, new + _SAME * step, side="right") - 1, 0, None)
    at_frame = np.abs(new - times[left]) <= _SAME * step
    right = np.where(at_frame, left, np.minimum(left + 1, len(times) - 1))
    marks = np.where(
        (observed[left] == 0) | (observed[right] == 0),
        0,
        np.maximum(observed[left], observed[right]),
    ).astype(np.uint8)
    holes = np.append(time_holes(times), False)
    marks[(marks == 1) & (holes[left] & ~at_frame)[:, np.newaxis]] = 2
    out = np.full((len(new), *positions.shape[1:]), np.nan)
    for node in range(positions.shape[1]):
        _runs(out, positions, observed, times, new, node, marks[:, node] > 0, method)
    out[at_frame] = positions[left[at_frame]]
    spread = None
    if sigma is not None:
        spread = _spread(np.asarray(sigma, float), positions, times, new, left, right)
        spread[marks == 0] = np.nan
    return Resampled(out, marks, left, spread)


def _runs(
    out: NDArray[np.float64],
    positions: NDArray[np.float64],
    observed: NDArray[np.uint8],
    times: NDArray[np.float64],
    new: NDArray[np.float64],
    node: int,
    wanted: NDArray[np.bool_],
    method: ResamplingMethod,
) -> None:
    from scipy.interpolate import CubicSpline, PchipInterpolator

    present = observed[:, node] > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], present, [False]])))
    for start, stop in edges.reshape(-1, 2):
        known = slice(start, stop)
        low, high = (
            np.searchsorted(new, times[start]),
            np.searchsorted(new, times[stop - 1], "right"),
        )
        inside = low + np.flatnonzero(wanted[low:high])
        if stop - start < 2 or not len(inside):
            continue
        values = positions[known, node]
        if method == "linear":
            for axis in range(values.shape[1]):
                out[inside, node, axis] = np.interp(new[inside], times[known], values[:, axis])
            continue
        curve = (CubicSpline if method == "cubic" else PchipInterpolator)(times[known], values)
        out[inside, node] = curve(new[inside])


def _spread(
    sigma: NDArray[np.float64],
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    new: NDArray[np.float64],
    left: NDArray[np.intp],
    right: NDArray[np.intp],
) -> NDArray[np.float64]:
    # At a frame, that of the frame; in between, the larger one at both sides bounds the noise
    # of any of the methods, and half the acceleration times both distances what is not known.
    same = left == right
    until, since = times[right] - new, new - times[left]
    product = np.where(same, 0.0, np.maximum(until, 0) * np.maximum(since, 0))
    largest = np.fmax(sigma[left], sigma[right])
    bend = 0.5 * rms_acceleration(positions, times, sigma)
    grown = np.sqrt(largest**2 + (bend * product[:, np.newaxis, np.newaxis]) ** 2)
    spread: NDArray[np.float64] = np.where(same[:, np.newaxis, np.newaxis], sigma[left], grown)
    return spread


def _checked(instants: ArrayLike, times: NDArray[np.float64], method: str) -> NDArray[np.float64]:
    if method not in get_args(ResamplingMethod):
        raise ConfigError(
            f"unknown method {method!r}",
            expected="one of " + ", ".join(get_args(ResamplingMethod)),
            fix="cubic follows smooth motion best, linear is safest",
            key="method",
        )
    new = np.asarray(instants, dtype=np.float64)
    if new.ndim != 1 or not len(new) or not np.isfinite(new).all() or (np.diff(new) <= 0).any():
        raise ConfigError(
            f"instants of shape {new.shape} that do not increase, or are not finite",
            expected="(S,) increasing seconds",
            fix="sort them",
            key="times",
        )
    slack = _SAME * (np.median(np.diff(times)) if len(times) > 1 else 1.0)
    if new[0] < times[0] - slack or new[-1] > times[-1] + slack:
        raise ConfigError(
            f"instants from {new[0]:g} to {new[-1]:g} s",
            expected=f"{times[0]:g} to {times[-1]:g} s, which were recorded",
            fix="leave out the others: nothing is extrapolated",
            key="times",
        )
    return new
