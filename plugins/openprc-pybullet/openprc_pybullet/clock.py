"""Time from rounded time stamps.

PyBullet writes ``timeStamp`` as float32 of ``stepCount * dt``, and people print time with six
decimals. Each stamp thus confines dt to an interval; the simplest fraction that lies in all of
them (1/240, 1/1000, ...) is the step, and ``t0 + i dt`` is formed in float64 from it.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData, NonUniformTime

#: Given and recorded steps may differ by this much, relative.
AGREEMENT = 1e-5


def simplest_between(low: float, high: float) -> float:
    """Return the fraction of smallest denominator in ``[low, high]``, 0 < low <= high.

    Continued fractions of both ends, compared term by term (Stern-Brocot tree; Graham, Knuth
    and Patashnik, Concrete Mathematics, section 4.5).
    """
    a, b = Fraction(low), Fraction(high)
    terms: list[int] = []
    while True:
        whole = math.floor(a)
        if whole == a or whole + 1 <= b:
            terms.append(whole if whole == a else whole + 1)
            break
        terms.append(whole)
        a, b = 1 / (b - whole), 1 / (a - whole)
    value = Fraction(terms.pop())
    while terms:
        value = terms.pop() + 1 / value
    return float(value)


def step_of_stamps(
    counts: NDArray[np.int64], stamps: NDArray[np.float32], *, given: float | None, file: str
) -> float:
    """Return dt in s from step counts and their float32 time stamps.

    Parameters
    ----------
    counts, stamps : (R,)
        ``stamps = float32(counts * dt)``.
    given : float or None
        What the user says; must agree, and is needed when no stamp is later than 0.

    Raises
    ------
    MissingData
        When only step 0 was logged and no `given` helps.
    NonUniformTime
        When no single dt explains the stamps: setTimeStep was called while logging.
    ConfigError
        When `given` contradicts the stamps.
    """
    later = counts > 0
    if not later.any():
        if given is None:
            raise MissingData(
                "the log holds one step, so its time stamps do not tell the time step",
                expected="at least two steps, or the option dt",
                fix="say dt=... (PyBullet's default is 1/240 s)",
                file=file,
                key="timeStamp",
            )
        return given
    count = counts[later].astype(np.float64)
    stamp = stamps[later].astype(np.float64)
    # One unit in the last place rather than half: single-precision builds round twice.
    half = np.spacing(np.abs(stamps[later])).astype(np.float64)
    bounds = _intersect((stamp - half) / count, (stamp + half) / count)
    if bounds is None:
        steps = stamp / count
        raise NonUniformTime(
            f"timeStamp / stepCount goes from {steps[0]:.9g} to {steps[-1]:.9g} s: "
            "the time step was changed while logging, or the stamps are damaged",
            expected="one time step in the whole log",
            fix="start a new log after each setTimeStep and import them one by one",
            file=file,
            key="timeStamp",
        )
    dt = simplest_between(*bounds)
    if given is None:
        return dt
    if abs(given - dt) > AGREEMENT * dt:
        raise ConfigError(
            f"dt={given:.9g} s is given and the time stamps are {dt:.9g} s apart",
            expected="the step of the log (with numSubSteps every sub-step is logged)",
            fix="leave dt out",
            file=file,
            key="dt",
        )
    return given


def regular_clock(
    times: NDArray[np.float64], half_width: NDArray[np.float64] | float
) -> NDArray[np.float64] | None:
    """Return ``(k + i) dt`` if such a clock, rounded, gives `times`; else None.

    Parameters
    ----------
    times : (T,) [s]
        As they were printed or stored.
    half_width : (T,) or float [s]
        Half of the last digit that was kept.

    Notes
    -----
    The first instant is taken as a whole number k of steps after zero, which holds for every
    loop that counts its steps. None also when a time is further off than rounding explains.
    """
    n = times.size
    if n < 3 or not np.all(np.diff(times) > 0):
        return None
    mean = float(times[-1] - times[0]) / (n - 1)
    first = round(float(times[0]) / mean)
    index = first + np.arange(n, dtype=np.float64)
    used = index > 0
    half = np.broadcast_to(np.asarray(half_width, dtype=np.float64), times.shape)
    if first < 0 or np.any(np.abs(times[~used]) > half[~used]):
        return None
    bounds = _intersect(
        (times[used] - half[used]) / index[used], (times[used] + half[used]) / index[used]
    )
    if bounds is None:
        return None
    return index * simplest_between(*bounds)


def _intersect(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[float, float] | None:
    least, most = float(low.max()), float(high.min())
    return (least, most) if 0 < least <= most else None


def grid(first: float, dt: float, *, count: int) -> NDArray[np.float64]:
    """Return ``first + i dt`` for `count` frames."""
    return first + np.arange(count, dtype=np.float64) * dt
