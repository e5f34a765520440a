"""Signals as piecewise polynomials in one table that compiled code can look values up in.

Every interpolant is a polynomial between two samples: constant when held, a line, or a cubic
(the C2 spline with not-a-knot ends). A prescribed velocity becomes a prescribed position by
integrating its polynomials, so that it is followed exactly as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Signal

#: Slack, in samples, within which a time counts as lying on a sample of a signal.
SAMPLE_SLACK = 1e-6


class SignalTable(NamedTuple):
    """C columns, each one function of time.

    Attributes
    ----------
    first, count : (C,) i8
        Rows of `coefficients` that belong to a column; the last one never ends.
    dt : (C,) [s]
    steps : (C,) bool
        Whether the value jumps from one segment to the next.
    knots : (C,) bool
        Whether some derivative below the fourth jumps there.
    coefficients : (R, n)
        Of powers of the time since the segment began, in segments.
    """

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    dt: NDArray[np.float64]
    steps: NDArray[np.bool_]
    knots: NDArray[np.bool_]
    coefficients: NDArray[np.float64]


class Column(NamedTuple):
    """One function of time before it is put into a table."""

    dt: float
    steps: bool
    knots: bool
    coefficients: NDArray[np.float64]


def columns_of(signal: Signal, *, integrated: bool = False) -> tuple[Column, ...]:
    """Return the columns of a signal: one, or x, y and z.

    Parameters
    ----------
    signal : Signal
    integrated : bool
        The time integral from 0 instead, which is how a velocity is prescribed.
    """
    columns = []
    for values in signal.values.T:
        rows = _polynomials(values, signal.interpolation)
        held = signal.interpolation == "hold"
        if integrated:
            rows = _integral(rows, signal.dt)
        smooth = signal.interpolation == "cubic"
        columns.append(Column(signal.dt, held and not integrated, not smooth, rows))
    return tuple(columns)


def _polynomials(values: NDArray[np.float64], interpolation: str) -> NDArray[np.float64]:
    last = np.zeros(len(values))
    if interpolation == "hold":
        return values[:, np.newaxis].copy()
    rows = np.zeros((len(values), 4 if interpolation == "cubic" else 2))
    rows[:, 0] = values
    if interpolation == "cubic":
        # scipy is imported for cubic signals only.
        from scipy.interpolate import CubicSpline

        rows[:-1] = CubicSpline(np.arange(len(values)), values).c[::-1].T
    else:
        last[:-1] = np.diff(values)
        rows[:, 1] = last
    return rows


def _integral(rows: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    integral = np.zeros((len(rows), rows.shape[1] + 1))
    integral[:, 1:] = dt * rows / np.arange(1, rows.shape[1] + 1)
    integral[1:, 0] = np.cumsum(integral[:-1, 1:].sum(axis=1))
    return integral


def signal_table(columns: Sequence[Column]) -> SignalTable:
    """Put columns into one table, in the given order."""
    counts = np.array([len(column.coefficients) for column in columns], dtype=np.int64)
    width = max((column.coefficients.shape[1] for column in columns), default=1)
    rows = np.zeros((int(counts.sum()), max(width, 2)))
    firsts = (np.cumsum(counts) - counts).astype(np.int64)
    for column, first, count in zip(columns, firsts, counts, strict=True):
        rows[first : first + count, : column.coefficients.shape[1]] = column.coefficients
    return SignalTable(
        first=firsts,
        count=counts,
        dt=np.array([column.dt for column in columns], dtype=np.float64),
        steps=np.array([column.steps for column in columns], dtype=np.bool_),
        knots=np.array([column.knots for column in columns], dtype=np.bool_),
        coefficients=rows,
    )


def sample_signal(signal: Signal, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a signal says at `times`: (T, d) [unit of the signal].

    A held signal has its new value from the sample's own time on; after the last sample its
    value stays.
    """
    position = np.asarray(times, dtype=np.float64) / signal.dt
    last = len(signal.values) - 1
    segment = np.clip(np.floor(position + SAMPLE_SLACK), 0, last).astype(np.int64)
    s = np.maximum(position - segment, 0.0)
    result = np.zeros((len(position), signal.values.shape[1]))
    for number, column in enumerate(columns_of(signal)):
        for power in range(column.coefficients.shape[1] - 1, -1, -1):
            result[:, number] = result[:, number] * s + column.coefficients[segment, power]
    return result
