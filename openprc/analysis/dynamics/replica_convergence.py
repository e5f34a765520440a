"""How fast two replicas approach each other: the rate, and the time until they agree.

Works on recordings: two runs under the same drive from different initial states. Nothing needs
to be known about the body, but the initial states have to be far enough apart to show a decay
above the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.analysis.dynamics.replica_consistency import checked_replicas
from openprc.errors import TaskError

_FLOOR_MARGIN = 10.0
_LEAST_ROWS = 5


@dataclass(frozen=True)
class Convergence:
    """Distance between two replicas, row by row, and what follows from it.

    Parameters
    ----------
    distance : (T,) float64
        Euclidean distance over all standardised columns, in units of the distance between two
        independent responses: 1 means that the replicas have nothing in common, 0 that they
        agree.
    time : (T,) float64
        Of the rows, from the first one on, in `unit`.
    unit : str
        ``"symbols"``, ``"frames"``, ``"s"`` or ``"load steps"``.
    floor : float
        Median distance over the last tenth of the record: the noise, or the rest of a
        convergence that is not over.
    rate : float
        Slope of the logarithm of the distance per `unit`: an estimate of the largest
        conditional Lyapunov exponent. Negative where replicas approach, ``-inf`` where they
        agree exactly from one row to the next.
    fit : tuple of int
        First row and one past the last row of the fit.
    r_squared : float
        Of the straight line through the logarithm; 0 where nothing was fitted.
    converged : bool
        Whether the distance fell to `floor` below 1/e of where it began.
    remark : str
    """

    distance: NDArray[np.float64]
    time: NDArray[np.float64]
    unit: str
    floor: float
    rate: float
    fit: tuple[int, int]
    r_squared: float
    converged: bool
    remark: str

    def time_to(self, tolerance: float = 1.0 / np.e) -> float:
        """Return the time until the distance stays below `tolerance` times the first one.

        Between two rows the logarithm of the distance is interpolated by a straight line.
        Infinite where the record ends before that; `remark` says why.

        Raises
        ------
        TaskError
            When `tolerance` is not between 0 and 1.
        """
        if not 0.0 < tolerance < 1.0:
            raise TaskError(
                f"the tolerance is {tolerance!r}",
                expected="a fraction of the first distance, between 0 and 1",
                fix="pass such a fraction, such as 0.01",
                key="tolerance",
            )
        return time_below(self.distance, self.time, tolerance * float(self.distance[0]))


def convergence(
    first: ArrayLike,
    second: ArrayLike,
    *,
    step: float = 1.0,
    unit: str = "symbols",
    scale: ArrayLike | None = None,
    fit: tuple[int, int] | None = None,
) -> Convergence:
    """Measure how two runs under the same drive approach each other.

    Parameters
    ----------
    first, second : (T, N)
        Row by row the response to the same symbol or instant; no washout.
    step : float
        Time from row to row, in `unit`.
    unit : str
    scale : (N,), optional
        Standard deviation of each column in the driven steady state, in the unit of the
        column. By default that over the second half of both runs.
    fit : (int, int), optional
        First row and one past the last row of the straight line. By default from the first row
        until the distance comes within a factor of ten of where it ends, or of rounding.

    Raises
    ------
    TaskError
        When the shapes differ, there are fewer than five rows, the replicas begin in the same
        state, or no column changes in the steady state.
    """
    a, b = checked_replicas([first, second])
    if len(a) < _LEAST_ROWS:
        raise TaskError(
            f"there are {len(a)} rows",
            expected=f"at least {_LEAST_ROWS}",
            fix="record for longer",
            key="replicas",
        )
    distance, rounding = _distance(a, b, scale)
    if not distance[0] > 0.0:
        raise TaskError(
            "the replicas begin in the same state",
            expected="two runs from different initial states",
            fix="start the second run elsewhere; to compare repeated measurements use consistency",
            key="replicas",
        )
    floor = float(np.median(distance[-max(len(distance) // 10, 2) :]))
    converged = floor < distance[0] / np.e
    time = step * np.arange(len(distance))
    chosen = fit or _straight_part(distance, max(floor, rounding))
    rate, r_squared = _slope(distance, time, chosen)
    return Convergence(
        distance=distance,
        time=time,
        unit=unit,
        floor=floor,
        rate=rate,
        fit=chosen,
        r_squared=r_squared,
        converged=bool(converged),
        remark=_remark(distance, floor, chosen),
    )


def _distance(
    a: NDArray[np.float64], b: NDArray[np.float64], scale: ArrayLike | None
) -> tuple[NDArray[np.float64], float]:
    """Return the distance of each row, and what rounding of the states makes of it."""
    steady = slice(len(a) // 2, None)
    size = np.maximum(np.abs(a).max(axis=0), np.abs(b).max(axis=0))
    if scale is None:
        spread = np.sqrt(0.5 * (a[steady].var(axis=0) + b[steady].var(axis=0)))
        # A column that only remembers the initial state has no scale of its own.
        used = spread > 1e-12 * size
    else:
        spread = np.asarray(scale, dtype=np.float64)
        used = np.ones(a.shape[1], dtype=bool)
        if spread.shape != used.shape or not (np.isfinite(spread) & (spread > 0.0)).all():
            raise TaskError(
                f"scale has shape {spread.shape}",
                expected=f"({a.shape[1]},), positive numbers",
                fix="pass one standard deviation per column",
                key="scale",
            )
    if not used.any():
        raise TaskError(
            "no column changes in the second half of the runs",
            expected="states that are driven",
            fix="drive the body, or pass scale=... to measure free decay",
            key="replicas",
        )
    difference = (a[:, used] - b[:, used]) / spread[used]
    # Independent responses differ by twice the variance in every column.
    norm = np.sqrt(2.0 * np.count_nonzero(used))
    rounding = float(np.finfo(np.float64).eps * np.linalg.norm(size[used] / spread[used]) / norm)
    return np.linalg.norm(difference, axis=1) / norm, rounding


def _straight_part(distance: NDArray[np.float64], floor: float) -> tuple[int, int]:
    """Return the rows from the first one until the distance comes near where it ends."""
    if floor > distance[0] * np.e:
        near = np.flatnonzero(distance >= floor / _FLOOR_MARGIN)
    elif floor < distance[0] / np.e:
        near = np.flatnonzero(distance <= _FLOOR_MARGIN * floor)
    else:
        return 0, len(distance)
    # Two rows at least: where the first step goes all the way, its rate is a bound.
    return 0, max(int(near[0]) if len(near) else len(distance), 2)


def _slope(
    distance: NDArray[np.float64], time: NDArray[np.float64], rows: tuple[int, int]
) -> tuple[float, float]:
    """Return slope and r^2 of the logarithm of the distance over time."""
    first, stop = rows
    if not (0 <= first < stop - 1 < len(distance)):
        raise TaskError(
            f"the fit runs from row {first} to {stop} of {len(distance)}",
            expected="two rows or more of the record",
            fix="correct fit",
            key="fit",
        )
    y, t = distance[first:stop], time[first:stop]
    if not (y > 0.0).all():
        return float("-inf"), 0.0
    log = np.log(y)
    centred, dt = log - log.mean(), t - t.mean()
    slope = float(dt @ centred / (dt @ dt))
    total = float(centred @ centred)
    rest = float(np.sum((centred - slope * dt) ** 2))
    return slope, max(0.0, 1.0 - rest / total) if total > 0.0 and len(y) > 2 else 0.0


def _remark(distance: NDArray[np.float64], floor: float, fit: tuple[int, int]) -> str:
    ends = f"their distance is {distance[0]:.3g} at first and {floor:.3g} in the end"
    if floor > distance[0] * np.e:
        return f"the replicas diverge: {ends}, so the response depends on how the body began"
    if not floor < distance[0] / np.e:
        return (
            f"the replicas do not converge: {ends}, so the initial state is not forgotten within "
            "this record"
        )
    if fit[1] - fit[0] < _LEAST_ROWS:
        return (
            f"the distance falls to its floor within {fit[1] - fit[0]} rows: the rate is rough; "
            "save the states more often, or start further apart"
        )
    return ""


def time_below(values: NDArray[np.float64], time: NDArray[np.float64], level: float) -> float:
    """Return the time from which `values` (T,) stay at or below `level`; inf if they do not.

    Between the last row above and the first row below the logarithm is interpolated.
    """
    above = np.flatnonzero(values > level * (1.0 + 1e-12))
    if not len(above):
        return float(time[0])
    last = int(above[-1])
    if last == len(values) - 1:
        return float("inf")
    upper, lower = values[last], values[last + 1]
    if lower <= 0.0:
        return float(time[last + 1])
    share = np.log(upper / level) / np.log(upper / lower)
    return float(time[last] + share * (time[last + 1] - time[last]))
