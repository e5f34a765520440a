"""Stiff bars in an inner loop, soft hinges and bends around it: a multiple-time-step scheme.

An outer step is half a kick by the hinges, n steps of velocity Verlet with bars, weight, drag
and actuators, and half a kick by the hinges again, evaluated once. It is of second order, and
without damping reversible and symplectic. It pays when hinges cost more than bars and the
fastest bar is several times faster than the fastest hinge; the time step of the experiment is
the outer one. Dampers act through predicted velocities, as in `openprc.demlat.integrators.verlet`,
in whichever loop their element is in.

The outer step has to stay clear of half a period of the *bars* as well, around which hinges
pump energy into them (the resonance of Biesiadecki & Skeel 1993, doi:10.1006/jcph.1993.1220):
damped bars are not affected.

Source: Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137, Sec. II.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from openprc.demlat.compiled.aligned import aligned_zeros_like
from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.copying import copy
from openprc.demlat.integrators.knots import must_renew
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.integrators.pefrl import is_damped
from openprc.demlat.integrators.verlet import Verlet, half_kick, kick_and_drift
from openprc.demlat.models.barhinge.bend_kernels import add_all_bends
from openprc.demlat.models.barhinge.drive_kernels import actuate, place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import (
    add_all_bars,
    add_all_hinges,
    clear,
    start_forces,
)
from openprc.demlat.models.barhinge.tables import (
    LEDGER_STRIDE,
    WORK_IN,
    Body,
    PrintedDampers,
    Reals,
)
from openprc.errors import ConfigError

#: Inner steps are at most this share of what is stable by an estimate on the safe side.
INNER_SHARE = 0.8


class RESPA(NamedTuple):
    """Work arrays.

    Attributes
    ----------
    inner : int
        Inner steps in an outer one.
    renews : bool
        Whether the kick by the hinges changes forces or powers of the inner loop.
    fast : Verlet
        Of the inner loop.
    predicted, force : (dims * stride,)
        Velocity predicted for the end of the outer step, and the force of the hinges there.
    rates : (5 or 6 * LEDGER_STRIDE,) or None
        What the hinges lose, and what actuators do against them.
    """

    inner: int
    renews: bool
    fast: Verlet
    predicted: Reals
    force: Reals
    rates: Reals | None

    @classmethod
    def for_body(cls, body: Body, settings: Settings, *, inner: int | None = None) -> RESPA:
        """Return work arrays for `body`.

        Parameters
        ----------
        body, settings
        inner : int, optional
            Inner steps in an outer one; by default as many as the bars need to be stable.

        Raises
        ------
        ConfigError
            When `inner` is not positive.
        """
        if inner is not None and inner < 1:
            raise ConfigError(f"{inner} inner steps", expected="at least 1", key="inner")
        count = inner or inner_steps(body, settings.h)
        fast = Verlet.for_body(body, settings)
        pushed = body.drives is not None and len(body.drives.force_at) > 0
        renews = pushed or is_damped(body._replace(hinges=(), bends=()))
        arrays = aligned_zeros_like(body.mass), aligned_zeros_like(body.mass)
        return cls(count, renews, fast, *arrays, make_rates(body, settings))


def inner_steps(body: Body, h: float) -> int:
    """Return how many inner steps an outer step `h` takes for the bars to be stable.

    No mode is faster than the fastest bar vibrating between shares of its end masses; with
    shares in proportion to the stiffness of the bars at a node that is
    ``omega^2 = max (S_i / m_i + S_j / m_j)``, S being the sums of stiffnesses at the nodes
    (Irons & Treharne 1971, the element bound). It needs no geometry, holds throughout the run
    and is 1.3 to 1.5 times too fast for lattices and tessellations.
    """
    omega, rate = math.sqrt(_element_bound(body, "stiffness")), _element_bound(body, "damping")
    if body.drag is not None:
        rate += float((body.drag * body.inverse_mass).max())
    if omega == 0.0:
        return 1
    zeta = 0.5 * rate / omega
    limit = 2.0 * (math.sqrt(1.0 + 4.0 * zeta * zeta) - 2.0 * zeta) / omega
    return max(1, math.ceil(h / (INNER_SHARE * limit)))


def _element_bound(body: Body, name: str) -> float:
    """Return max over bars of the sum over its ends of (sum of the parameter) / mass."""
    sums, ends = np.zeros(body.stride), []
    for group in body.bars:
        if isinstance(group, PrintedDampers):
            values = np.maximum(group.drag_i, group.drag_j) if name == "damping" else None
        else:
            values = getattr(group, name)
        if values is None:
            continue
        i, j = (_of_lanes(places, len(group.lanes)) for places in (group.i, group.j))
        np.add.at(sums, i, values)
        np.add.at(sums, j, values)
        ends.append((i[values > 0.0], j[values > 0.0]))
    # Fixed along one axis or all: the lightest axis counts.
    mobility = body.inverse_mass.reshape(-1, body.stride).max(axis=0) * sums
    return max((float((mobility[i] + mobility[j]).max(initial=0.0)) for i, j in ends), default=0.0)


def _of_lanes(places: NDArray[np.int32], width: int) -> NDArray[np.int64]:
    """Return the place of every lane: runs of neighbours are kept by their first one."""
    if places.ndim == 2:
        return places.ravel().astype(np.int64)
    return (places[:, np.newaxis].astype(np.int64) + np.arange(width)).ravel()


def add_work_on_driven(drives: Any, rates: Any, force: Any, v: Any) -> None:
    """Book the power with which driven coordinates are moved against `force`."""


@chosen_by_type(add_work_on_driven)
def _add_work_on_driven(drives, rates, force, v):
    if isinstance(drives, types.NoneType) or isinstance(rates, types.NoneType):
        return lambda drives, rates, force, v: None

    def add_each(drives, rates, force, v):
        for d in range(drives.motion_at.size):
            at = drives.motion_at[d]
            rates[WORK_IN * LEDGER_STRIDE + drives.motion_lane[d]] -= force[at] * v[at]

    return add_each


@jit
def _evaluate_hinges(work: Any, body: Any, x: Any, v: Any) -> None:
    clear(body, work.rates)
    work.force[:] = 0.0
    add_all_hinges(body.hinges, body, x, v, work.force, work.rates)
    add_all_bends(body.bends, body, x, v, work.force, work.rates)
    add_work_on_driven(body.drives, work.rates, work.force, v)


@jit
def _evaluate_rest(
    work: Any, body: Any, x: Any, v: Any, t: float, t_from: float, t_to: float
) -> None:
    """Set the force of the inner loop to everything but hinges and bends."""
    fast = work.fast
    clear(body, fast.rates)
    start_forces(body, v, fast.force, fast.rates)
    add_all_bars(body.bars, body, x, v, fast.force, fast.rates)
    actuate(body.drives, v, fast.force, fast.rates, t, t_from, t_to)


@jit
def respa_step(work: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    x, v, lanes, fast = state.x, state.v, body.lanes, work.fast
    if must_renew(fast.clock, body.drives, t, h):
        _evaluate_hinges(work, body, x, v)
        if not work.renews:
            _evaluate_rest(work, body, x, v, t, t, t + h)
    book(state.ledger, lanes, work.rates, 0.5 * h)
    half_kick(body, v, work.force, h)
    if work.renews:
        _evaluate_rest(work, body, x, v, t, t, t + h)
    short = h / work.inner
    for number in range(work.inner):
        now = t + h if number == work.inner - 1 else t + (number + 1) * short
        book(state.ledger, lanes, fast.rates, 0.5 * short)
        kick_and_drift(fast, body, x, v, short)
        place_driven(body.drives, x, fast.predicted, now, t, t + h)
        _evaluate_rest(work, body, x, fast.predicted, now, t, t + h)
        book(state.ledger, lanes, fast.rates, 0.5 * short)
        half_kick(body, v, fast.force, short)
        place_driven(body.drives, x, v, now, t, t + h)
    # The velocity at the end, as far as the last force of the hinges tells.
    copy(lanes, work.predicted, v)
    half_kick(body, work.predicted, work.force, h)
    _evaluate_hinges(work, body, x, work.predicted)
    book(state.ledger, lanes, work.rates, 0.5 * h)
    half_kick(body, v, work.force, h)


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not RESPA:
        return None
    return lambda scheme, body, state, t, h: respa_step(scheme, body, state, t, h)
