"""Equilibria at given positions of driven axes and given loads, one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.errors import NotConverged
from openprc_merlin.equilibrium_path import (
    Balance,
    PathPoint,
    StepFailed,
    gave_up,
    lowest_nearby,
    newton,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Unstable = Literal["follow", "settle"]


#: Share of work and energy that may be missing because a step was long.
_MISSING = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class Station:
    """What is imposed at one increment.

    Attributes
    ----------
    positions : (N, 3) [m]
        Read where axes are held.
    loads : (N, 3) [N]
    """

    positions: Floats
    loads: Floats


def controlled_path(
    balance: Balance,
    start: Floats,
    stations: Iterable[Station],
    *,
    begin: Station,
    unstable: Unstable = "follow",
) -> Iterator[PathPoint]:
    """Follow the equilibria through `stations` by Newton's method.

    Held axes are put where they belong and the others find their balance from where they were.
    Where that fails the way to the station is halved, again and again; parts that succeed
    double the next one.

    Parameters
    ----------
    balance : Balance
        Its reference load has no part in this.
    start : (N, 3) [m]
        An equilibrium at `begin`.
    stations : iterable of Station
    unstable : {"follow", "settle"}
        What happens where the equilibrium found is unstable under what is imposed: it is kept,
        or the body snaps to the minimum of energy downhill from there.

    Yields
    ------
    PathPoint
        One a station.

    Raises
    ------
    NotConverged
        When no part of the way down to `PathSettings.least_step` leads on.
    """
    x, here = start, begin
    for number, station in enumerate(stations, 1):
        loaded = balance.under(station.loads)
        if unstable == "settle":
            x, iterations, n_negative = _settle(
                loaded, np.where(balance.problem.held, station.positions, x)
            )
        else:
            x, iterations, n_negative = _reach(balance, x, here, station, number=number)
        here = station
        yield loaded.point(x, 1.0, iterations=iterations, n_negative=n_negative)


def jump(balance: Balance, before: PathPoint, after: PathPoint) -> float:
    """Return the energy [J] that is released between two points, 0 where a path joins them.

    Along a path the energy grows by the work of loads and drives, which the mean of their
    forces at both ends gives to the third order in the step. Where a large part of it is
    missing the body has jumped.
    """
    way = after.positions - before.positions
    # Work as if the forces of either end had acted all the way.
    works = [float(((p.reactions + p.loads) * way).sum()) for p in (before, after)]
    problem = balance.problem
    gained = problem.energy(after.positions) - problem.energy(before.positions)
    missing = 0.5 * sum(works) - gained
    # Where the forces pass through zero their mean says nothing of the sizes involved.
    return missing if missing > _MISSING * (max(map(abs, works)) + abs(gained)) else 0.0


def _settle(balance: Balance, x: Floats) -> tuple[Floats, int, int | None]:
    """Return the equilibrium near `x` where it is stable, else the one downhill from there."""
    try:
        found, iterations, n_negative = newton(balance, x)
        if not n_negative:
            return found, iterations, n_negative
        x = found
    except (StepFailed, NotConverged):  # there is none nearby; an element may have collapsed
        iterations = balance.settings.max_iterations
    return lowest_nearby(balance, x), iterations, 0


def _reach(
    balance: Balance, x: Floats, begin: Station, end: Station, *, number: int
) -> tuple[Floats, int, int | None]:
    done, part = 0.0, 1.0
    held = balance.problem.held
    while True:
        share = min(done + part, 1.0)
        # The end itself, not what rounding makes of it.
        way = end if share == 1.0 else _between(begin, end, share)
        try:
            found, iterations, n_negative = newton(
                balance.under(way.loads), np.where(held, way.positions, x)
            )
        except (StepFailed, NotConverged) as failed:  # an element may have collapsed, too
            part *= 0.5
            if part >= balance.settings.least_step:
                continue
            raise gave_up(
                f"increment {number}",
                failed,
                step=f"the way is cut down to {part:.1g} of an increment",
                fix="beyond a limit point there is no equilibrium nearby: use"
                " control=arc-length for forces, or unstable=settle to let the body snap",
            ) from None
        if share == 1.0:
            return found, iterations, n_negative
        x, done, part = found, share, 2.0 * part


def _between(begin: Station, end: Station, share: float) -> Station:
    return Station(
        positions=begin.positions + share * (end.positions - begin.positions),
        loads=begin.loads + share * (end.loads - begin.loads),
    )
