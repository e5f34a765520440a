"""Is there a constant rate behind rounded time stamps?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Rates that cameras and broadcasters use [Hz].
_USUAL = np.array(
    [
        *(n * 1000 / 1001 for n in (24, 30, 48, 60, 120, 240)),
        *(10, 12, 12.5, 15, 20, 24, 25, 30, 48, 50, 60, 90, 100, 120, 125),
        *(200, 240, 250, 300, 400, 480, 500, 600, 960, 1000),
    ]
)
#: Units in which containers count time [s]: Matroska and ASF, QuickTime, MPEG.
_UNITS = (1e-3, 1 / 600, 1 / 12800, 1 / 15360, 1 / 30000, 1 / 60000, 1 / 90000, 1e-6, 1e-7)


@dataclass(frozen=True)
class Grid:
    """Stamps on a regular grid: ``stamp = start + place * dt`` to within their resolution.

    Attributes
    ----------
    dt : float [s]
    places : (T,) float64
        Whole numbers, strictly increasing from 0; a hole in the recording is a jump.
    rounded : bool
        The stamps deviate from the grid by more than floating point does.
    """

    dt: float
    places: NDArray[np.float64]
    rounded: bool

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return 1.0 / self.dt


def plausible_rate(fps: float) -> float | None:
    """Return the declared rate if it can be one: finite, positive, below a megahertz."""
    return float(fps) if np.isfinite(fps) and 0 < fps < 1e6 else None


def resolution(stamps: NDArray[np.float64]) -> float:
    """Return the coarsest of the usual units that all stamps are multiples of [s]."""
    last_place = _last_place(stamps)
    for unit in _UNITS:
        counts = stamps / unit
        tolerance = 1e-4 + last_place / unit
        if tolerance < 0.05 and bool(np.all(np.abs(counts - np.rint(counts)) < tolerance)):
            return unit
    return 1e-9


def _last_place(stamps: NDArray[np.float64]) -> float:
    """Return what floating point cannot tell in the stamps [s]; seconds since 1970 are large."""
    return 4.0 * float(np.spacing(np.abs(stamps).max()))


def fit_grid(stamps: NDArray[np.float64], declared: float | None) -> Grid | None:
    """Find the constant rate of `stamps` (T,) [s], or return None when there is none.

    The declared rate is tried first, then the usual ones, then the rate that fits best. A
    rate is accepted when every stamp lies on its grid to within the unit that the stamps are
    counted in, and most steps are one place long: stamps in whole milliseconds lie on the
    grid of 1000 Hz whatever the rate was.
    """
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    unit = resolution(stamps)
    span = float(stamps[-1] - stamps[0])
    if usual < 0 or span <= 0:
        return None
    rates = [] if declared is None else [declared]
    if usual > 0:
        near = np.abs(1.0 / _USUAL - usual) <= unit * 1.001
        rates += list(_USUAL[near][np.argsort(np.abs(1.0 / _USUAL[near] - usual))])
        rates.append(_best_rate(stamps, usual))
    for rate in rates:
        grid = _on_grid(stamps, 1.0 / float(rate), unit)
        if grid is not None:
            return grid
    return None


def _best_rate(stamps: NDArray[np.float64], usual: float) -> float:
    """Return the least-squares rate [Hz], holes counted in usual steps."""
    places = np.concatenate([[0.0], np.cumsum(np.maximum(1, np.rint(np.diff(stamps) / usual)))])
    slope = np.polyfit(places, stamps, 1)[0]
    return 1.0 / float(slope)


def _on_grid(stamps: NDArray[np.float64], dt: float, unit: float) -> Grid | None:
    exact = (stamps - stamps[0]) / dt
    if unit > dt * 1.001:
        # Coarser than the rate: only an unbroken count can be told.
        places = np.arange(len(stamps), dtype=np.float64)
    else:
        # The first stamp is rounded as well: take the phase of all of them.
        phase = float(np.median(exact - np.rint(exact))) if unit < 0.45 * dt else 0.0
        places = np.rint(exact - phase)
        places -= places[0]
    off = (stamps - stamps[0]) - places * dt
    slack = 1e-6 * dt + 1e-9 + _last_place(stamps)
    if float(np.ptp(off)) > unit + slack or not bool(np.all(np.diff(places) > 0)):
        return None
    if np.mean(np.diff(places) == 1) < 0.5:
        return None
    return Grid(dt, places, rounded=bool(np.ptp(off) > slack))
