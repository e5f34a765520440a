"""The position-extended scheme of Forest and Ruth type, of fourth order.

Four kicks between five drifts, composed symmetrically; time, and with it every driven
coordinate, moves with the drifts. Without damping it is symplectic: energy errors stay bounded,
momenta are kept. With damping a kick, ``v' = f(x, v)/m`` at a fixed x, is itself a differential
equation; the classical Runge-Kutta scheme solves it to an order that keeps the fourth of the
whole, at four evaluations a kick instead of one. (With the velocity of the kick's start the
scheme would be of first order in the damping.)

Work and losses belong to the kicks, so the ledger is of fourth order too.

Source: Omelyan, Mryglod & Folk 2002, doi:10.1016/S0010-4655(02)00451-4, Eqs. 19, 20.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types

from openprc.demlat.compiled.aligned import aligned_zeros_like
from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, splat, store
from openprc.demlat.integrators import Settings, stepping
from openprc.demlat.integrators.ledger import book, make_rates
from openprc.demlat.models.barhinge.drive_kernels import place_driven, value_and_rate
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import (
    LEDGER_STRIDE,
    WORK_IN,
    Body,
    PrintedDampers,
    Reals,
)

XI = 0.1786178958448091
LAMBDA = -0.2123418310626054
CHI = -0.06626458266981849
#: Shares of the step that the drifts and kicks take.
DRIFTS = (XI, CHI, 1.0 - 2.0 * (CHI + XI), CHI, XI)
KICKS = (0.5 * (1.0 - 2.0 * LAMBDA), LAMBDA, LAMBDA, 0.5 * (1.0 - 2.0 * LAMBDA))


def is_damped(body: Body) -> bool:
    """Say whether any force depends on velocities."""
    if body.drag is not None and body.drag.any():
        return True
    for group in (*body.bars, *body.hinges, *body.bends):
        if isinstance(group, PrintedDampers):
            return True
        for name in ("damping", "damping_cubic"):
            values = getattr(group, name, None)
            if values is not None and values.any():
                return True
    return False


class PEFRL(NamedTuple):
    """Work arrays.

    Attributes
    ----------
    damped : bool
        Whether kicks are differential equations.
    stage_v, sum_v, force : (dims * stride,)
        Velocity of a stage, sum over stages, force.
    rates : (5 or 6 * LEDGER_STRIDE,) or None
    """

    damped: bool
    stage_v: Reals
    sum_v: Reals
    force: Reals
    rates: Reals | None

    @classmethod
    def for_body(cls, body: Body, settings: Settings) -> PEFRL:
        """Return work arrays for `body`."""
        arrays = (aligned_zeros_like(body.mass) for _ in range(3))
        return cls(is_damped(body), *arrays, make_rates(body, settings))


@jit
def _drift(body: Any, x: Any, v: Any, span: float) -> None:
    lanes = body.lanes
    for at in range(0, x.size, len(lanes)):
        store(lanes, x, at, load(lanes, x, at, 0) + span * load(lanes, v, at, 0))


def add_work_of_gain(drives: Any, rates: Any, body: Any, force: Any, span: float, now: Any) -> None:
    """Book forces times half of what a kick of `span` adds to velocities; `now` is (t, from, to).

    So the power of a constant force is that of the mean velocity of the kick.
    """


@chosen_by_type(add_work_of_gain)
def _add_work_of_gain(drives, rates, body, force, span, now):
    if isinstance(drives, types.NoneType) or isinstance(rates, types.NoneType):
        return lambda drives, rates, body, force, span, now: None

    def add_each(drives, rates, body, force, span, now):
        for d in range(drives.force_at.size):
            at = drives.force_at[d]
            value, _ = value_and_rate(
                drives.signals, drives.force_signal[d], now[0], now[1], now[2]
            )
            gain = 0.5 * span * force[at] * body.inverse_mass[at]
            rates[WORK_IN * LEDGER_STRIDE + drives.force_lane[d]] += value * gain

    return add_each


@jit
def _stage(work: Any, body: Any, v: Any, weight: float, ahead: float) -> None:
    lanes = body.lanes
    for at in range(0, v.size, len(lanes)):
        slope = load(lanes, work.force, at, 0) * load(lanes, body.inverse_mass, at, 0)
        store(lanes, work.sum_v, at, load(lanes, work.sum_v, at, 0) + weight * slope)
        store(lanes, work.stage_v, at, load(lanes, v, at, 0) + ahead * slope)


@jit
def _kick(work: Any, body: Any, state: Any, span: float, now: Any) -> None:
    """Let the forces at the present positions act for `span`; `now` is (t, from, to)."""
    v, lanes = state.v, body.lanes
    zero = splat(lanes, 0.0)
    for at in range(0, v.size, len(lanes)):
        store(lanes, work.stage_v, at, load(lanes, v, at, 0))
        store(lanes, work.sum_v, at, zero)
    stages = 4 if work.damped else 1
    for stage in range(stages):
        evaluate(body, state.x, work.stage_v, work.force, work.rates, now[0], now[1], now[2])
        weight = span
        if work.damped:
            weight = span / 6.0 if stage == 0 or stage == 3 else span / 3.0
        else:
            add_work_of_gain(body.drives, work.rates, body, work.force, span, now)
        book(state.ledger, lanes, work.rates, weight)
        _stage(work, body, v, weight, span if stage == 2 else 0.5 * span)
    for at in range(0, v.size, len(lanes)):
        store(lanes, v, at, load(lanes, v, at, 0) + load(lanes, work.sum_v, at, 0))


@jit
def pefrl_step(work: Any, body: Any, state: Any, t: float, h: float) -> None:
    """Advance `state` in place from `t` to ``t + h``."""
    share = 0.0
    for part in range(5):
        share = 1.0 if part == 4 else share + DRIFTS[part]
        _drift(body, state.x, state.v, DRIFTS[part] * h)
        place_driven(body.drives, state.x, state.v, t + share * h, t, t + h)
        if part < 4:
            _kick(work, body, state, KICKS[part] * h, (t + share * h, t, t + h))


@chosen_by_type(stepping.step)
def _step(scheme, body, state, t, h):
    if scheme.instance_class is not PEFRL:
        return None
    return lambda scheme, body, state, t, h: pefrl_step(scheme, body, state, t, h)
