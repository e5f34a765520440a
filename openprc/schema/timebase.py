"""The clock of a file: explicit instants, and a checked claim that they are evenly spaced."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: A frame may stand this far, in units of dt, from where a uniform clock has it.
UNIFORM_TOLERANCE = 1e-6


def describe_time(time: NDArray[np.float64]) -> dict[str, Any]:
    """Return ``uniform``, and when it is 1 also ``t0`` and ``dt``.

    Parameters
    ----------
    time : (T,)

    Notes
    -----
    The step is the mean one, ``(t[-1] - t[0]) / (T - 1)``: it has the smallest rounding error
    of all estimates from the ends, and the claim is then checked against every frame.
    """
    if len(time) < 2:
        return {"uniform": np.int64(0)}
    t0 = float(time[0])
    dt = float((time[-1] - time[0]) / (len(time) - 1))
    dt = _nearby_decimal(dt, time)
    if max_deviation(time, t0, dt) <= UNIFORM_TOLERANCE:
        return {"uniform": np.int64(1), "t0": t0, "dt": dt}
    return {"uniform": np.int64(0)}


def max_deviation(time: NDArray[np.float64], t0: float, dt: float) -> float:
    """Return ``max |t_i - (t0 + i dt)| / dt``."""
    if not dt > 0:
        return float("inf")
    return float(np.max(np.abs(time - (t0 + np.arange(len(time)) * dt))) / dt)


def _nearby_decimal(dt: float, time: NDArray[np.float64]) -> float:
    # 0.01 comes out of the mean as 0.010000000000000002; the short number is what was meant,
    # when it explains the frames no worse than rounding does.
    for digits in range(1, 13):
        short = float(f"{dt:.{digits}g}")
        if abs(short - dt) <= 4e-16 * max(abs(float(time[-1])), abs(dt)):
            return short
    return dt
