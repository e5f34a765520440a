"""All forces of a body at an instant, and its energies."""

from __future__ import annotations

from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, splat, store
from openprc.demlat.models.barhinge.bar_kernels import add_bars, keep, observe_springs
from openprc.demlat.models.barhinge.bend_kernels import add_all_bends, observe_bends
from openprc.demlat.models.barhinge.drive_kernels import actuate
from openprc.demlat.models.barhinge.hinge_kernels import add_hinges, observe_hinges
from openprc.demlat.models.barhinge.tables import (
    BEND_ENERGY,
    DRAG,
    LEDGER_STRIDE,
    PrintedDampers,
)


def first_force(body: Any, at: int, u: Any) -> Any:
    """Return weight minus drag of one vector of coordinates, and what drag loses."""


@chosen_by_type(first_force)
def _first_force(body, at, u):
    kinds = dict(zip(body.fields, body.types, strict=True))
    no_weight = isinstance(kinds["weight"], types.NoneType)
    if isinstance(kinds["drag"], types.NoneType):
        if no_weight:
            return lambda body, at, u: (splat(body.lanes, 0.0), splat(body.lanes, 0.0))
        return lambda body, at, u: (load(body.lanes, body.weight, at, 0), splat(body.lanes, 0.0))

    def dragged(body, at, u):
        resistance = load(body.lanes, body.drag, at, 0) * u
        return -resistance, resistance * u

    def both(body, at, u):
        resistance = load(body.lanes, body.drag, at, 0) * u
        return load(body.lanes, body.weight, at, 0) - resistance, resistance * u

    return dragged if no_weight else both


@jit
def start_forces(body: Any, v: Any, force: Any, rates: Any) -> None:
    """Set `force` to weight minus drag, and book what drag loses."""
    lanes = body.lanes
    lost = splat(lanes, 0.0)
    for at in range(0, force.size, len(lanes)):
        begun, loss = first_force(body, at, load(lanes, v, at, 0))
        store(lanes, force, at, begun)
        lost += loss
    keep(lanes, rates, DRAG * LEDGER_STRIDE, lost)


def add_all_bars(groups: Any, body: Any, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces of every group of bars."""


@chosen_by_type(add_all_bars)
def _add_all_bars(groups, body, x, v, force, rates):
    if len(groups) == 0:
        return lambda groups, body, x, v, force, rates: None

    def one_by_one(groups, body, x, v, force, rates):
        add_bars(groups[0], body.space, body.stride, x, v, force, rates)
        add_all_bars(groups[1:], body, x, v, force, rates)

    return one_by_one


def add_all_hinges(groups: Any, body: Any, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces of every group of hinges."""


@chosen_by_type(add_all_hinges)
def _add_all_hinges(groups, body, x, v, force, rates):
    if len(groups) == 0:
        return lambda groups, body, x, v, force, rates: None

    def one_by_one(groups, body, x, v, force, rates):
        add_hinges(groups[0], body.space, body.stride, x, v, force, rates)
        add_all_hinges(groups[1:], body, x, v, force, rates)

    return one_by_one


@jit
def evaluate(
    body: Any, x: Any, v: Any, force: Any, rates: Any, t: float, t_from: float, t_to: float
) -> None:
    """Set `force` [N] to all forces at `t`, and `rates` [W] to the powers of the ledger.

    Driven coordinates must have been placed. `rates` may be None.
    """
    clear(body, rates)
    start_forces(body, v, force, rates)
    add_forces(body, x, v, force, rates, t, t_from, t_to)


@jit
def add_forces(
    body: Any, x: Any, v: Any, force: Any, rates: Any, t: float, t_from: float, t_to: float
) -> None:
    """Add all forces but weight and drag, and their powers."""
    add_all_bars(body.bars, body, x, v, force, rates)
    add_all_hinges(body.hinges, body, x, v, force, rates)
    add_all_bends(body.bends, body, x, v, force, rates)
    actuate(body.drives, v, force, rates, t, t_from, t_to)


def clear(body: Any, rates: Any) -> None:
    """Set the powers of the ledger to 0."""


@chosen_by_type(clear)
def _clear(body, rates):
    if isinstance(rates, types.NoneType):
        return lambda body, rates: None

    def zero(body, rates):
        nothing = splat(body.lanes, 0.0)
        for at in range(0, rates.size, len(body.lanes)):
            store(body.lanes, rates, at, nothing)

    return zero


def observe_all_bars(groups: Any, body: Any, x: Any, v: Any, energy: Any) -> None:
    """Write lengths and tensions to the body's scratch; add elastic energies to `energy`."""


@chosen_by_type(observe_all_bars)
def _observe_all_bars(groups, body, x, v, energy):
    if len(groups) == 0:
        return lambda groups, body, x, v, energy: None
    if groups.types[0].instance_class is PrintedDampers:
        return lambda groups, body, x, v, energy: observe_all_bars(groups[1:], body, x, v, energy)

    def one_by_one(groups, body, x, v, energy):
        share = observe_springs(
            groups[0], body.space, body.stride, x, v, body.scratch[0], body.scratch[1]
        )
        keep(groups[0].lanes, energy, LEDGER_STRIDE, share)
        observe_all_bars(groups[1:], body, x, v, energy)

    return one_by_one


def observe_all_hinges(groups: Any, body: Any, x: Any, v: Any, energy: Any) -> None:
    """Write angles (minus rest) and moments to the body's scratch; add energies to `energy`."""


@chosen_by_type(observe_all_hinges)
def _observe_all_hinges(groups, body, x, v, energy):
    if len(groups) == 0:
        return lambda groups, body, x, v, energy: None

    def one_by_one(groups, body, x, v, energy):
        share = observe_hinges(
            groups[0], body.space, body.stride, x, v, body.scratch[2], body.scratch[3]
        )
        keep(groups[0].lanes, energy, 2 * LEDGER_STRIDE, share)
        observe_all_hinges(groups[1:], body, x, v, energy)

    return one_by_one


def observe_all_bends(groups: Any, body: Any, x: Any, v: Any, energy: Any) -> None:
    """Write turns and moments to the body's scratch; add elastic energies to `energy`."""


@chosen_by_type(observe_all_bends)
def _observe_all_bends(groups, body, x, v, energy):
    if len(groups) == 0:
        return lambda groups, body, x, v, energy: None

    def one_by_one(groups, body, x, v, energy):
        share = observe_bends(
            groups[0], body.space, body.stride, x, v, body.scratch[5], body.scratch[6]
        )
        keep(groups[0].lanes, energy, BEND_ENERGY * LEDGER_STRIDE, share)
        observe_all_bends(groups[1:], body, x, v, energy)

    return one_by_one


@jit
def observe(body: Any, x: Any, v: Any, energy: Any) -> None:
    """Set `energy` (`ENERGY_ROWS` of the ledger's stride) [J].

    Lengths, tensions, angles minus rest angles, turns and moments go to the body's scratch.
    """
    energy[:] = 0.0
    lanes = body.lanes
    kinetic, falling = splat(lanes, 0.0), splat(lanes, 0.0)
    for at in range(0, v.size, len(lanes)):
        u = load(lanes, v, at, 0)
        kinetic += load(lanes, body.mass, at, 0) * u * u
        falling += load(lanes, body.full_weight, at, 0) * load(lanes, x, at, 0)
    keep(lanes, energy, 0, 0.5 * kinetic)
    keep(lanes, energy, 3 * LEDGER_STRIDE, -falling)
    observe_all_bars(body.bars, body, x, v, energy)
    observe_all_hinges(body.hinges, body, x, v, energy)
    observe_all_bends(body.bends, body, x, v, energy)
