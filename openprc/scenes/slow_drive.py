"""A drive that goes from one value to another so slowly that a body can follow in balance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Samples of a path; the cubic spline through them is its polynomial to 1e-9 of its height.
SAMPLES = 401


@dataclass(frozen=True, kw_only=True, eq=False)
class SlowPath:
    """Samples of ``begin + (end - begin) s^3 (10 - 15 s + 6 s^2)``, s = t / duration.

    Parameters
    ----------
    begin, end : float
    duration : float [s]
    values : (SAMPLES,)
    """

    begin: float
    end: float
    duration: float
    values: Reals

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return self.duration / (SAMPLES - 1)

    def at(self, times: Reals) -> Reals:
        """Return the values at `times` (T,) [s]; the last one stays."""
        s = np.clip(times / self.duration, 0.0, 1.0)
        path: Reals = self.begin + (self.end - self.begin) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return path


def smooth_path(begin: float, end: float, *, duration: float) -> SlowPath:
    """Return a path without speed and acceleration at both ends; its top speed is 15/8 of even."""
    path = SlowPath(begin=begin, end=end, duration=duration, values=np.zeros(0))
    values = path.at(np.linspace(0.0, duration, SAMPLES))
    return SlowPath(begin=begin, end=end, duration=duration, values=values)
