"""Equilibria at given positions of driven axes and given loads, one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.errors import NotConverged
from openprc_merlin.equilibrium_path import Balance, PathPoint, StepFailed, gave_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Unstable = Literal["follow", "settle", "stop"]


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
    unstable : {"follow", "settle", "stop"}
        What happens where the equilibrium found is unstable under what is imposed: it is kept;
        the body snaps, to the minimum of energy downhill from there; or the path ends.

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
        x, iterations, n_negative = _reach(balance, x, here, station, number=number)
        if unstable == "settle" and n_negative:
            x, n_negative = _settled(balance, x, station), 0
        here = station
        yield _at(balance, station).point(x, 1.0, iterations=iterations, n_negative=n_negative)
        if unstable == "stop" and n_negative:
            return


def _reach(
    balance: Balance, x: Floats, begin: Station, end: Station, *, number: int
) -> tuple[Floats, int, int | None]:
    done, part = 0.0, 1.0
    iterations, n_negative = 0, None
    while done < 1.0:
        share = min(done + part, 1.0)
        way = Station(
            positions=begin.positions + share * (end.positions - begin.positions),
            loads=begin.loads + share * (end.loads - begin.loads),
        )
        if share == 1.0:
            way = end
        try:
            x, iterations, n_negative = newton(_at(balance, way), x, way.positions)
        except (StepFailed, NotConverged) as failed:  # an element may have collapsed, too
            part *= 0.5
            if part >= balance.settings.least_step:
                continue
            reason = failed.found if isinstance(failed, NotConverged) else str(failed)
            raise gave_up(
                f"increment {number}",
                reason,
                step=f"the way is cut down to {part:.1g} of an increment",
                fix="loads beyond a limit point have no equilibrium nearby: use"
                " control=arc-length, or unstable=settle to let the body snap",
            ) from None
        done, part = share, 2.0 * part
    return x, iterations, n_negative


def _at(balance: Balance, station: Station) -> Balance:
    """Return the balance under the loads of a station."""
    other = Balance(balance.problem, station.loads, settings=balance.settings)
    return other


def newton(
    balance: Balance, x: Floats, positions: Floats
) -> tuple[Floats, int, int | None]:
    """Return the equilibrium near `x`, held axes as in `positions`, under the reference load.

    Returns
    -------
    positions, iterations, n_negative

    Raises
    ------
    StepFailed
        When the iterations allowed are not enough, or go astray.
    NotConverged
        When an element collapses on the way.
    """
    problem, allowed = balance.problem, balance.settings.max_iterations
    placed = np.where(problem.held, positions, x)
    for iteration in range(1, allowed + 1):
        tangent = balance.factors(placed)
        step = tangent.solve(balance.out_of_balance(placed, 1.0))
        share = balance.allowed_share(step)
        placed = balance.moved(placed, share * step)
        if share * float(np.linalg.norm(step)) < balance.least:
            break
    else:
        raise StepFailed(f"{allowed} iterations were not enough")
    # What the tangent at hand still improves costs no factorisation.
    placed = balance.moved(placed, tangent.solve(balance.out_of_balance(placed, 1.0)))
    return placed, iteration, tangent.n_negative


def _settled(balance: Balance, x: Floats, station: Station) -> Floats:
    """Return the minimum of energy downhill from the unstable equilibrium `x`."""
    from openprc.demlat.statics import find_equilibrium  # noqa: PLC0415 - loads scipy

    still = replace(
        balance.problem,
        loads=balance.problem.loads + station.loads,
        positions=np.where(balance.problem.held, station.positions, balance.problem.positions),
    )
    found: Floats = find_equilibrium(still, x, kind="minimum").positions
    return found
