"""From the error on a pilot to that of the whole run, and whether the motion is unstable.

Errors of a conservative motion grow at least with time: a wrong frequency is a growing phase. A
scheme that takes energy makes the frequency drift, and the phase grows with the square of time.
Damping forgets errors, so that they stay bounded. In a chaotic motion they grow exponentially,
which a second run with slightly other masses shows: its distance would else grow with time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Over the second half of a pilot the twin's distance doubles in a steady motion; more than this
#: is exponential growth, if it was there in the second quarter as well.
BLOW_UP, BLOW_UP_BEFORE = 6.0, 3.0
#: Share of the displacement at which a twin is lost, so that its distance grows no more.
LOST = 0.03
#: Growth is never taken for more than this: beyond it there is nothing to aim at.
MOST_GROWTH = 1e3


@dataclass(frozen=True, kw_only=True)
class Stability:
    """How the distance of two neighbouring motions grows.

    Attributes
    ----------
    rate : float [1/s]
        Of exponential growth; 0 where it grows no faster than a power of time.
    """

    rate: float = 0.0

    @property
    def unstable(self) -> bool:
        """Whether errors grow exponentially."""
        return self.rate > 0.0


def judge_twin(distance: Reals, times: Reals) -> Stability:
    """Judge the distance of a run from one with slightly other masses.

    Parameters
    ----------
    distance : (F,) [1]
        Relative to the displacement.
    times : (F,) [s]
    """
    reached = np.maximum.accumulate(distance)
    lost = np.flatnonzero(reached > LOST)
    last = int(lost[0]) if len(lost) else len(times) - 1
    if last < 8 or reached[last // 4] == 0.0:
        return Stability()
    whole, half, quarter = (float(reached[part]) for part in (last, last // 2, last // 4))
    if whole < BLOW_UP * half or half < BLOW_UP_BEFORE * quarter:
        return Stability()
    return Stability(rate=math.log(whole / half) / float(times[last] - times[last // 2]))


def grown(curve: Reals, share: float, *, damped: bool, rate_time: float = 0.0) -> float:
    """Return the error to be expected at the end of the run.

    Parameters
    ----------
    curve : (F,) [1]
        Error of the frames of the pilot.
    share : float
        Duration of the run over that of the pilot, at least 1.
    damped : bool
        Whether the motion forgets.
    rate_time : float
        Rate of exponential growth times the rest of the run; 0 if there is none.
    """
    reached = np.maximum.accumulate(curve)
    end, half = float(reached[-1]), float(reached[len(reached) // 2])
    if share <= 1.0 + 1e-9 or end == 0.0 or not math.isfinite(end):
        return end
    if rate_time > 0.0:
        return end * min(math.exp(min(rate_time, 700.0)), MOST_GROWTH)
    if damped:
        exponent = min(math.log2(end / half), 1.0) if half > 0.0 else 1.0
        return float(end * share**exponent)
    if end <= 2.0 * half:
        return end * share
    # a t + b t^2 through both, with no negative part.
    square = min(2.0 * (end - 2.0 * half), end)
    return (end - square) * share + square * share**2
