"""Signals as one table that compiled code can look values up in.

Linear and held signals need their samples only. "cubic" is the C2 spline with not-a-knot
ends (`scipy.interpolate.CubicSpline`), stored as samples and slopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from openprc.demlat.models.barhinge.laws import CUBIC, HOLD, LINEAR, SAMPLE_SLACK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Signal

KINDS = {"linear": LINEAR, "hold": HOLD, "cubic": CUBIC}


class SignalTable(NamedTuple):
    """S signals of altogether R samples.

    Attributes
    ----------
    kind : (S,) i8
        `LINEAR`, `HOLD` or `CUBIC`.
    start, count : (S,) i8
        Rows of `values` that belong to a signal.
    dt : (S,) [s]
    values : (R, 3) [m, N or m/s]
        A signal with one column has it three times.
    slopes : (R, 3) or (0, 3) [unit of values per segment]
        Derivatives at the samples times `dt`; there only when some signal is cubic.
    """

    kind: NDArray[np.int64]
    start: NDArray[np.int64]
    count: NDArray[np.int64]
    dt: NDArray[np.float64]
    values: NDArray[np.float64]
    slopes: NDArray[np.float64]


def signal_table(signals: Sequence[Signal]) -> SignalTable:
    """Put signals into one table, in the given order."""
    counts = np.array([len(signal.values) for signal in signals], dtype=np.int64)
    starts = np.cumsum(counts) - counts
    total = int(counts.sum())
    values = np.empty((total, 3))
    cubic = any(signal.interpolation == "cubic" for signal in signals)
    slopes = np.zeros((total if cubic else 0, 3))
    for signal, start, count in zip(signals, starts, counts, strict=True):
        rows = slice(int(start), int(start + count))
        values[rows] = signal.values
        if signal.interpolation == "cubic":
            slopes[rows] = _spline_slopes(signal)
    return SignalTable(
        kind=np.array([KINDS[signal.interpolation] for signal in signals], dtype=np.int64),
        start=starts.astype(np.int64),
        count=counts,
        dt=np.array([signal.dt for signal in signals], dtype=np.float64),
        values=values,
        slopes=slopes,
    )


def _spline_slopes(signal: Signal) -> NDArray[np.float64]:
    # scipy is imported for cubic signals only.
    from scipy.interpolate import CubicSpline

    samples = np.arange(len(signal.values), dtype=np.float64)
    slopes: NDArray[np.float64] = CubicSpline(samples, signal.values)(samples, 1)
    return slopes


def sample_signal(signal: Signal, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a signal says at `times`: (T, d) [unit of the signal].

    A held signal has its new value from the sample's own time on; after the last sample its
    value stays.
    """
    values, position = signal.values, np.asarray(times) / signal.dt
    if signal.interpolation == "hold":
        index = np.floor(position + SAMPLE_SLACK).astype(np.int64)
        return values[np.clip(index, 0, len(values) - 1)]
    samples = np.arange(len(values), dtype=np.float64)
    position = np.clip(position, 0.0, len(values) - 1.0)
    if signal.interpolation == "cubic":
        from scipy.interpolate import CubicSpline

        result: NDArray[np.float64] = CubicSpline(samples, values)(position)
        return result
    return np.stack([np.interp(position, samples, column) for column in values.T], axis=1)
