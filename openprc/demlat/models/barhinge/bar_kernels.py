"""Forces, energies and observables of bars, for any number of lanes."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import add, load, place, scatter, splat
from openprc.demlat.models.barhinge import laws
from openprc.demlat.models.barhinge.tables import (
    BARS,
    LEDGER_STRIDE,
    Cables,
    CubicBars,
    LinearBars,
    OgdenBars,
    PrintedDampers,
    Struts,
)

linear_tension = jit(laws.linear_tension)
linear_energy = jit(laws.linear_energy)
cubic_tension = jit(laws.cubic_tension)
cubic_energy = jit(laws.cubic_energy)
ogden_tension = jit(laws.ogden_tension)
ogden_energy = jit(laws.ogden_energy)
taut = jit(laws.taut)
pressed = jit(laws.pressed)
engaged = jit(laws.engaged)
TINY = laws.TINY


# --- what a group is decides, when compiling, what is called ----------------------------------


def keep(lanes: Any, rates: Any, row: int, value: Any) -> None:
    """Add `value` to a row of the ledger's powers, if there is a ledger."""


@chosen_by_type(keep)
def _keep(lanes: Any, rates: Any, row: int, value: Any) -> Any:
    if isinstance(rates, types.NoneType):
        return lambda lanes, rates, row, value: None
    return lambda lanes, rates, row, value: add(lanes, rates, row, 0, value)


def damp(lanes: Any, damping: Any, p: int, rate: Any) -> Any:
    """Return force and lost power of a dashpot; zeros, at no cost, where there is none."""


@chosen_by_type(damp)
def _damp(lanes: Any, damping: Any, p: int, rate: Any) -> Any:
    if isinstance(damping, types.NoneType):
        return lambda lanes, damping, p, rate: (splat(lanes, 0.0), splat(lanes, 0.0))

    def dashpot(lanes, damping, p, rate):
        force = load(lanes, damping, p, 0) * rate
        return force, force * rate

    return dashpot


def fetch(lanes: Any, values: Any, p: int) -> Any:
    """Return a parameter of block `p`: lane by lane, or one number for all lanes (2-D)."""


@chosen_by_type(fetch)
def _fetch(lanes: Any, values: Any, p: int) -> Any:
    if values.ndim == 2:
        return lambda lanes, values, p: splat(lanes, values[p // len(lanes), 0])
    return lambda lanes, values, p: load(lanes, values, p, 0)


def measure_bar(group: Any, p: int, dx: Any, dy: Any, dz: Any) -> Any:
    """Return stretch, length and the vector from i to j."""


@chosen_by_type(measure_bar)
def _measure_bar(group: Any, p: int, dx: Any, dy: Any, dz: Any) -> Any:
    if isinstance(group.types[group.fields.index("offset")], types.NoneType):

        def absolute(group, p, dx, dy, dz):
            length = math.sqrt(dx * dx + dy * dy + dz * dz + TINY)
            return length - load(group.lanes, group.relaxed, p, 0), length, dx, dy, dz

        return absolute

    def displaced(group, p, dx, dy, dz):
        lanes = group.lanes
        ox, oy, oz = group.offset[0], group.offset[1], group.offset[2]
        rx, ry, rz = fetch(lanes, ox, p), fetch(lanes, oy, p), fetch(lanes, oz, p)
        ex, ey, ez = rx + dx, ry + dy, rz + dz
        length = math.sqrt(ex * ex + ey * ey + ez * ez + TINY)
        # l^2 - relaxed^2 without the cancellation of two nearly equal squares.
        squares = fetch(lanes, group.offset[3], p) + (
            dx * (rx + ex) + dy * (ry + ey) + dz * (rz + ez)
        )
        return squares / (length + load(lanes, group.relaxed, p, 0)), length, ex, ey, ez

    return displaced


def _linear(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    force, loss = damp(group.lanes, group.damping, p, rate)
    return linear_tension(stretch, load(group.lanes, group.stiffness, p, 0)) + force, loss


def _cubic(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    lanes = group.lanes
    force, loss = damp(lanes, group.damping, p, rate)
    spring = cubic_tension(
        stretch, load(lanes, group.stiffness, p, 0), load(lanes, group.stiffness_cubic, p, 0)
    )
    more = load(lanes, group.damping_cubic, p, 0) * rate * rate * rate
    return spring + force + more, loss + more * rate


def _cable(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    force, loss = damp(group.lanes, group.damping, p, rate)
    on = engaged(stretch)
    spring = linear_tension(taut(stretch), load(group.lanes, group.stiffness, p, 0))
    return spring + on * force, on * loss


def _strut(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    force, loss = damp(group.lanes, group.damping, p, rate)
    on = engaged(-stretch)
    spring = linear_tension(pressed(stretch), load(group.lanes, group.stiffness, p, 0))
    return spring + on * force, on * loss


def _ogden(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    force, loss = damp(group.lanes, group.damping, p, rate)
    spring = ogden_tension(
        stretch, load(group.lanes, group.stiffness, p, 0), load(group.lanes, group.relaxed, p, 0)
    )
    return spring + force, loss


def _linear_energy(group: Any, p: int, stretch: Any) -> Any:
    return linear_energy(stretch, load(group.lanes, group.stiffness, p, 0))


def _cubic_energy(group: Any, p: int, stretch: Any) -> Any:
    lanes = group.lanes
    return cubic_energy(
        stretch, load(lanes, group.stiffness, p, 0), load(lanes, group.stiffness_cubic, p, 0)
    )


def _cable_energy(group: Any, p: int, stretch: Any) -> Any:
    return linear_energy(taut(stretch), load(group.lanes, group.stiffness, p, 0))


def _strut_energy(group: Any, p: int, stretch: Any) -> Any:
    return linear_energy(pressed(stretch), load(group.lanes, group.stiffness, p, 0))


def _ogden_energy(group: Any, p: int, stretch: Any) -> Any:
    return ogden_energy(
        stretch, load(group.lanes, group.stiffness, p, 0), load(group.lanes, group.relaxed, p, 0)
    )


_TENSION = {
    LinearBars: _linear,
    CubicBars: _cubic,
    Cables: _cable,
    Struts: _strut,
    OgdenBars: _ogden,
}
_ENERGY = {
    LinearBars: _linear_energy,
    CubicBars: _cubic_energy,
    Cables: _cable_energy,
    Struts: _strut_energy,
    OgdenBars: _ogden_energy,
}


def tension_and_loss(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    """Return the tension [N] and the power lost [W] of block `p` by the group's law."""


@chosen_by_type(tension_and_loss)
def _tension_and_loss(group: Any, p: int, stretch: Any, rate: Any) -> Any:
    return _TENSION[group.instance_class]


def stored_energy(group: Any, p: int, stretch: Any) -> Any:
    """Return the elastic energy [J] of block `p` by the group's law."""


@chosen_by_type(stored_energy)
def _stored_energy(group: Any, p: int, stretch: Any) -> Any:
    return _ENERGY[group.instance_class]


# --- loops --------------------------------------------------------------------------------


@jit
def difference(lanes: Any, space: Any, values: Any, stride: int, i: Any, j: Any) -> Any:
    """Return ``values[j] - values[i]`` along x, y, z; 0 along an axis that does not exist."""
    dx = load(lanes, values, j, 0) - load(lanes, values, i, 0)
    dy = load(lanes, values, j, stride) - load(lanes, values, i, stride)
    dz = splat(lanes, 0.0)
    if len(space) == 3:
        dz = load(lanes, values, j, 2 * stride) - load(lanes, values, i, 2 * stride)
    return dx, dy, dz


@jit
def push(
    lanes: Any, space: Any, force: Any, stride: int, at: Any, fx: Any, fy: Any, fz: Any
) -> None:
    """Add a force to the nodes at place `at`."""
    add(lanes, force, at, 0, fx)
    add(lanes, force, at, stride, fy)
    if len(space) == 3:
        add(lanes, force, at, 2 * stride, fz)


def add_springs(
    group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any
) -> None:
    """Add the forces of a group of bars, and what they lose to `rates`."""
    lanes = group.lanes
    width = len(lanes)
    lost = splat(lanes, 0.0)
    for b in range(group.i.shape[0]):
        i, j = place(lanes, group.i, b), place(lanes, group.j, b)
        dx, dy, dz = difference(lanes, space, x, stride, i, j)
        stretch, length, ex, ey, ez = measure_bar(group, b * width, dx, dy, dz)
        ux, uy, uz = difference(lanes, space, v, stride, i, j)
        inverse = 1.0 / length
        rate = (ex * ux + ey * uy + ez * uz) * inverse
        tension, loss = tension_and_loss(group, b * width, stretch, rate)
        scale = tension * inverse
        lost += loss
        push(lanes, space, force, stride, i, scale * ex, scale * ey, scale * ez)
        push(lanes, space, force, stride, j, -scale * ex, -scale * ey, -scale * ez)
    keep(lanes, rates, BARS * LEDGER_STRIDE, lost)


def add_printed_dampers(
    group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any
) -> None:
    """Add ``-c_i (v_i - v_j)`` to one end and ``-c_j (v_j - v_i)`` to the other."""
    lanes = group.lanes
    width = len(lanes)
    lost = splat(lanes, 0.0)
    for b in range(group.i.shape[0]):
        i, j = place(lanes, group.i, b), place(lanes, group.j, b)
        ci, cj = load(lanes, group.drag_i, b * width, 0), load(lanes, group.drag_j, b * width, 0)
        ux, uy, uz = difference(lanes, space, v, stride, i, j)
        push(lanes, space, force, stride, i, ci * ux, ci * uy, ci * uz)
        push(lanes, space, force, stride, j, -cj * ux, -cj * uy, -cj * uz)
        lost += (cj * load(lanes, v, j, 0) - ci * load(lanes, v, i, 0)) * ux
        lost += (cj * load(lanes, v, j, stride) - ci * load(lanes, v, i, stride)) * uy
        if len(space) == 3:
            at = 2 * stride
            lost += (cj * load(lanes, v, j, at) - ci * load(lanes, v, i, at)) * uz
    keep(lanes, rates, BARS * LEDGER_STRIDE, lost)


def add_bars(group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any) -> None:
    """Add the forces of any group of bars."""


@chosen_by_type(add_bars)
def _add_bars(group: Any, space: Any, stride: int, x: Any, v: Any, force: Any, rates: Any) -> Any:
    return add_printed_dampers if group.instance_class is PrintedDampers else add_springs


@jit
def observe_springs(
    group: Any, space: Any, stride: int, x: Any, v: Any, lengths: Any, tensions: Any
) -> Any:
    """Write lengths and tensions of the group's bars; return their elastic energy by lane."""
    lanes = group.lanes
    width = len(lanes)
    energy = splat(lanes, 0.0)
    for b in range(group.i.shape[0]):
        i, j = place(lanes, group.i, b), place(lanes, group.j, b)
        dx, dy, dz = difference(lanes, space, x, stride, i, j)
        stretch, length, ex, ey, ez = measure_bar(group, b * width, dx, dy, dz)
        ux, uy, uz = difference(lanes, space, v, stride, i, j)
        rate = (ex * ux + ey * uy + ez * uz) / length
        tension, _ = tension_and_loss(group, b * width, stretch, rate)
        energy += stored_energy(group, b * width, stretch)
        scatter(lanes, lengths, group.element, b * width, length)
        scatter(lanes, tensions, group.element, b * width, tension)
    return energy
