"""How a small difference grows: exponentially, like a power of time, or not at all."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Reals = NDArray[np.float64]

Kind = Literal["exponential", "algebraic", "bounded", "decaying"]
#: A difference that has grown less than this many times is bounded, as far as a run can tell.
BOUNDED = 10.0
#: Exponential growth is only told from other growth where it covers two decades.
TOLD_APART = 100.0
#: Differences above this share of the scale do not grow linearly any more.
LINEAR = 1e-2
_BLOCKS = 24
_PARTS = 4
#: Quarters in which it has to rise: a single burst, as of a snap or an impact, is no law of growth.
_STEADY = 2


@dataclass(frozen=True, kw_only=True)
class Growth:
    """How a difference grew.

    Parameters
    ----------
    kind : {"exponential", "algebraic", "bounded", "decaying"}
        "exponential" where a straight line through the logarithm fits better than
        ``a (1 + b t^p)`` with p = 1 or 2, over two decades at least, and rises in half of its
        quarters or more; "algebraic" where it grew tenfold or more, and not so; "decaying" where
        a tenth or less is left at the end.
    rate, uncertainty : float [1/s]
        Slope of the logarithm over `window`, and the standard error from the scatter of the
        slopes of its quarters.
    factor : float
        Largest difference over the first, within `window`.
    decades : float
        Its decimal logarithm.
    window : (2,) float [s]
        Where it was measured: up to where the difference is no longer small.
    """

    kind: Kind
    rate: float
    uncertainty: float
    factor: float
    decades: float
    window: tuple[float, float]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self) | {"window": list(self.window)}


def measure_growth(times: ArrayLike, differences: ArrayLike) -> Growth | None:
    """Tell how a difference grows.

    Parameters
    ----------
    times : (T,) [s]
        Increasing.
    differences : (T,)
        In shares of the scale of the motion, not negative.

    Returns
    -------
    Growth or None
        None when there are fewer than 24 instants before the difference is 1 % of the scale, or
        when it is 0.

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.compare.chaos.growth import measure_growth
    >>> t = np.linspace(0.0, 10.0, 500)
    >>> growth = measure_growth(t, 1e-9 * np.exp(1.2 * t))
    >>> growth.kind, round(growth.rate, 2)
    ('exponential', 1.2)
    >>> measure_growth(t, 1e-9 * (1.0 + 30.0 * t)).kind
    'algebraic'
    """
    t, d = np.asarray(times, dtype=np.float64), np.asarray(differences, dtype=np.float64)
    usable = np.isfinite(d) & (d > 0.0)
    t, d = t[usable], d[usable]
    large = np.flatnonzero(d > LINEAR)
    if large.size:
        t, d = t[: large[0]], d[: large[0]]
    if len(t) < _BLOCKS:
        return None
    centres, heights = _blocks(t, d)
    slope, offset = np.polyfit(centres, heights, 1)
    uncertainty = _scatter(centres, heights)
    factor = float(np.exp(heights.max() - heights[0]))
    line = float(((heights - offset - slope * centres) ** 2).sum())
    if heights[-1] - heights[0] <= -np.log(BOUNDED):
        kind: Kind = "decaying"
    elif factor < BOUNDED:
        kind = "bounded"
    elif (
        factor >= TOLD_APART
        and _rising_quarters(centres, heights, slope) >= _STEADY
        and all(line < _misfit_of_power(centres, heights, p) for p in (1, 2))
    ):
        kind = "exponential"
    else:
        kind = "algebraic"
    return Growth(
        kind=kind,
        rate=float(slope),
        uncertainty=uncertainty,
        factor=factor,
        decades=float(np.log10(factor)),
        window=(float(t[0]), float(t[-1])),
    )


def _blocks(t: Reals, d: Reals) -> tuple[Reals, Reals]:
    """Return centres of equal stretches of time from the start and the log of the largest there.

    A vibration takes the difference through small values; the largest of a stretch does not.
    """
    edges = np.linspace(t[0], t[-1], _BLOCKS + 1)
    stretch = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, _BLOCKS - 1)
    # Where instants are unevenly spaced, a stretch may hold none.
    filled = np.unique(stretch)
    heights = np.array([np.log(d[stretch == number].max()) for number in filled])
    centres: Reals = 0.5 * (edges[filled] + edges[filled + 1]) - t[0]
    return centres, heights


def _slopes(centres: Reals, heights: Reals) -> list[float]:
    """Return the slopes of quarters."""
    parts = zip(
        np.array_split(centres, _PARTS), np.array_split(heights, _PARTS), strict=True
    )  # neighbouring stretches are not independent: residuals of one fit would say too little
    return [float(np.polyfit(x, y, 1)[0]) for x, y in parts if len(x) > 1]


def _rising_quarters(centres: Reals, heights: Reals, slope: float) -> int:
    return sum(part > 0.25 * slope > 0.0 for part in _slopes(centres, heights))


def _scatter(centres: Reals, heights: Reals) -> float:
    """Return the standard error of the slope."""
    slopes = _slopes(centres, heights)
    return float(np.std(slopes, ddof=1) / np.sqrt(len(slopes))) if len(slopes) > 1 else np.inf


def _misfit_of_power(centres: Reals, heights: Reals, power: int) -> float:
    """Return the squared residuals of ``a (1 + b t^p)`` in the logarithm, b >= 0 at its best."""
    span = centres[-1]
    misfits = []
    # One nonlinear parameter on a grid: the other one follows.
    for b in np.concatenate(([0.0], np.logspace(-3.0, 15.0, 181))):
        shape = np.log1p(b * (centres / span) ** power)
        misfits.append(float(((heights - shape - (heights - shape).mean()) ** 2).sum()))
    return min(misfits)


def time_of_share(times: ArrayLike, differences: ArrayLike, *, share: float) -> float | None:
    """Return when a difference first reaches `share`; None when it does not.

    Parameters
    ----------
    times : (T,) [s]
    differences : (T,)
        In the unit of `share`.
    """
    reached = np.flatnonzero(np.asarray(differences) >= share)
    return float(np.asarray(times)[reached[0]]) if reached.size else None


__all__ = ["BOUNDED", "LINEAR", "TOLD_APART", "Growth", "Kind", "measure_growth", "time_of_share"]
