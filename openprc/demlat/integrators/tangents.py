"""The tangent matrix of soft bars, hinges and bends, assembled inside the time loop.

For a step with coefficients `by_x` and `by_v` the matrix is ``M + by_v C + by_x K``, over the
coordinates that are not held: ``K = dF/dx`` with the geometric parts (of the force that acts,
dashpots included), ``C = dF/dv``, each with its sign turned. How a dashpot's rate depends on
positions is left out: it is small against C for small steps, and would not be symmetric.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import place
from openprc.demlat.integrators.bend_tangents import BEND_PAIRS, add_bend_tangents
from openprc.demlat.linear.symbolic import Factor, analyse
from openprc.demlat.models.barhinge import laws
from openprc.demlat.models.barhinge.bar_kernels import tension_and_loss
from openprc.demlat.models.barhinge.bend_second import PAIRS, bend_second, edge, pair_second
from openprc.demlat.models.barhinge.hinge_kernels import frame, moment_of
from openprc.demlat.models.barhinge.tables import (
    Body,
    Cables,
    CubicBars,
    LinearBars,
    LinearBends,
    LinearHinges,
    OgdenBars,
    PrintedDampers,
    Reals,
    Struts,
    WalledHinges,
)

cubic_tangent = jit(laws.cubic_tangent)
ogden_tangent = jit(laws.ogden_tangent)
wall_tangent = jit(laws.wall_tangent)


class Tangent(NamedTuple):
    """The matrix, and where contributions of elements go in it.

    Attributes
    ----------
    factor : Factor
        Its values have one place more than the matrix, for what belongs to held coordinates.
    free : (n,) i8
        Flat coordinates of the unknowns.
    diagonal : (n,) i8
        Places of the diagonal.
    bars : tuple of (B, 3, 3, 3) i8
        For each group: blocks of the pairs (i, i), (j, j), (i, j).
    hinges : tuple of (B, 10, 3, 3) i8
        For each group: blocks of `PAIRS`.
    bends : tuple of (B, 6, 3, 3) i8
        For each group: blocks of `BEND_PAIRS`.
    right : (n,)
    gradient : (4, 3), second : (5, 3, 3)
        Scratch of one hinge or bend.
    """

    factor: Factor
    free: NDArray[np.int64]
    diagonal: NDArray[np.int64]
    bars: tuple[NDArray[np.int64], ...]
    hinges: tuple[NDArray[np.int64], ...]
    bends: tuple[NDArray[np.int64], ...]
    right: Reals
    gradient: Reals
    second: Reals

    @classmethod
    def for_body(cls, body: Body) -> Tangent:
        """Return the pattern for a body whose elements are stepped one by one."""
        dims, stride = len(body.space), body.stride
        # Node by node, so that the axes of a node are neighbours.
        free = np.flatnonzero(body.inverse_mass.reshape(dims, stride).T.ravel() > 0.0)
        free = free % dims * stride + free // dims
        unknown = np.full(dims * stride, -1)
        unknown[free] = np.arange(len(free))
        bar_pairs = [((g.i, g.i), (g.j, g.j), (g.i, g.j)) for g in body.bars]
        hinge_pairs = [
            tuple(((g.j, g.k, g.i, g.l)[p], (g.j, g.k, g.i, g.l)[q]) for p, q in PAIRS)
            for g in body.hinges
        ]
        bend_pairs = [
            tuple(((g.i, g.j, g.k)[p], (g.i, g.j, g.k)[q]) for p, q in BEND_PAIRS)
            for g in body.bends
        ]
        rows, columns, shapes = [], [], []
        for pairs in (*bar_pairs, *hinge_pairs, *bend_pairs):
            first, second = (np.stack([p[side] for p in pairs], axis=1) for side in (0, 1))
            axes = stride * np.arange(dims)
            row = unknown[first[:, :, None, None] + axes[:, None]]
            column = unknown[second[:, :, None, None] + axes]
            row, column = np.broadcast_arrays(row, column)
            # Of a block on the diagonal, each entry off its diagonal is given once.
            twice = (first == second)[:, :, None, None] & (axes[:, None] < axes)
            rows.append(np.where(twice, -1, row).ravel())
            columns.append(np.where(twice, -1, column).ravel())
            shapes.append(row.shape)
        row = np.concatenate([*rows, np.arange(len(free))])
        column = np.concatenate([*columns, np.arange(len(free))])
        used = (row >= 0) & (column >= 0)
        factor, position = analyse(row[used], column[used], n=len(free))
        nowhere = len(factor.values)
        target = np.full(len(row), nowhere)
        target[used] = position
        bounds = np.cumsum([0, *(math.prod(shape) for shape in shapes)])
        places = [
            target[start:end].reshape(shape)
            for start, end, shape in zip(bounds[:-1], bounds[1:], shapes, strict=True)
        ]
        n_bars, n_before_bends = len(bar_pairs), len(bar_pairs) + len(hinge_pairs)
        return cls(
            factor._replace(values=np.zeros(nowhere + 1)),
            free,
            target[bounds[-1] :],
            tuple(places[:n_bars]),
            tuple(places[n_bars:n_before_bends]),
            tuple(places[n_before_bends:]),
            np.zeros(len(free)),
            np.zeros((4, 3)),
            np.zeros((5, 3, 3)),
        )


# --- bars ---------------------------------------------------------------------------------------


def bar_tangents(group: Any, p: int, stretch: float, rate: float) -> Any:
    """Return d(tension)/d(stretch) and d(tension)/d(rate) of bar `p` of a group."""


@chosen_by_type(bar_tangents)
def _bar_tangents(group, p, stretch, rate):
    kind = group.instance_class
    if kind is LinearBars:
        return lambda group, p, stretch, rate: (group.stiffness[p], group.damping[p])
    if kind is OgdenBars:
        return lambda group, p, stretch, rate: (
            ogden_tangent(stretch, group.stiffness[p], group.relaxed[p]),
            group.damping[p],
        )
    if kind is CubicBars:
        return lambda group, p, stretch, rate: (
            cubic_tangent(stretch, group.stiffness[p], group.stiffness_cubic[p]),
            cubic_tangent(rate, group.damping[p], group.damping_cubic[p]),
        )
    sign = {Cables: 1.0, Struts: -1.0}[kind]

    def one_sided(group, p, stretch, rate):
        if sign * stretch > 0.0:
            return group.stiffness[p], group.damping[p]
        return 0.0, 0.0

    return one_sided


def add_bar_tangents(
    group: Any,
    places: Any,
    tangent: Any,
    body: Any,
    x: Any,
    v: Any,
    by_x: float,
    by_v: float,
    definite: bool,
) -> None:
    """Add the contributions of a group of bars."""


@chosen_by_type(add_bar_tangents)
def _add_bar_tangents(group, places, tangent, body, x, v, by_x, by_v, definite):
    if group.instance_class is PrintedDampers:
        return _add_printed
    return _add_springs


def _add_springs(group, places, tangent, body, x, v, by_x, by_v, definite):
    values, stride = tangent.factor.values, body.stride
    for e in range(group.i.size):
        i, j = place(group.lanes, group.i, e), place(group.lanes, group.j, e)
        dx, dy, dz = x[j] - x[i], x[stride + j] - x[stride + i], 0.0
        ux, uy, uz = v[j] - v[i], v[stride + j] - v[stride + i], 0.0
        if len(body.space) == 3:
            dz = x[2 * stride + j] - x[2 * stride + i]
            uz = v[2 * stride + j] - v[2 * stride + i]
        length = math.sqrt(dx * dx + dy * dy + dz * dz + laws.TINY)
        n = (dx / length, dy / length, dz / length)
        rate = n[0] * ux + n[1] * uy + n[2] * uz
        stretch = length - group.relaxed[e]
        tension, _ = tension_and_loss(group, e, stretch, rate)
        stiffness, damping = bar_tangents(group, e, stretch, rate)
        if definite:
            tension = max(tension, 0.0)
        across = by_x * tension / length
        along = by_x * stiffness + by_v * damping - across
        for a in range(len(body.space)):
            for b in range(len(body.space)):
                entry = along * n[a] * n[b]
                if a == b:
                    entry += across
                values[places[e, 0, a, b]] += entry
                values[places[e, 1, a, b]] += entry
                values[places[e, 2, a, b]] -= entry


def _add_printed(group, places, tangent, body, x, v, by_x, by_v, definite):
    values = tangent.factor.values
    for e in range(group.i.size):
        # The mean for the coupling, which is not symmetric where masses differ.
        one, two = by_v * group.drag_i[e], by_v * group.drag_j[e]
        for a in range(len(body.space)):
            values[places[e, 0, a, a]] += one
            values[places[e, 1, a, a]] += two
            values[places[e, 2, a, a]] -= 0.5 * (one + two)


# --- hinges -------------------------------------------------------------------------------------


def hinge_tangent(group: Any, p: int, difference: float) -> float:
    """Return d(moment)/d(angle) of hinge `p` of a group."""


@chosen_by_type(hinge_tangent)
def _hinge_tangent(group, p, difference):
    if group.instance_class is LinearHinges:
        return lambda group, p, difference: group.stiffness[p]
    assert group.instance_class is WalledHinges  # noqa: S101 - there are no others

    def walled(group, p, difference):
        over, under = difference - group.high[p], difference - group.low[p]
        stiffness = group.stiffness[p]
        if over > 0.0:
            return stiffness + wall_tangent(over, stiffness, group.high_room[p])
        if under < 0.0:
            return stiffness + wall_tangent(under, stiffness, group.low_room[p])
        return stiffness

    return walled


@jit
def add_hinge_tangents(
    group: Any,
    places: Any,
    tangent: Any,
    body: Any,
    x: Any,
    v: Any,
    by_x: float,
    by_v: float,
    definite: bool,
) -> None:
    """Add the contributions of a group of hinges."""
    values, stride = tangent.factor.values, body.stride
    g, second = tangent.gradient, tangent.second
    for e in range(group.j.size):
        j, k = place(group.lanes, group.j, e), place(group.lanes, group.k, e)
        i, l = place(group.lanes, group.i, e), place(group.lanes, group.l, e)  # noqa: E741
        at = (j, k, i, l)
        geometry = frame(group, body.space, stride, x, e, at)
        moment, _ = moment_of(group, body.space, stride, v, e, at, geometry)
        difference, ix, iy, iz, lx, ly, lz, p, q = geometry
        wings = ((ix, lx), (iy, ly), (iz, lz))
        for r in range(3):
            gi, gl = wings[r]
            g[0, r] = (p - 1.0) * gi - q * gl
            g[1, r] = (q - 1.0) * gl - p * gi
            g[2, r] = gi
            g[3, r] = gl
        straight = by_x * hinge_tangent(group, e, difference) + by_v * group.damping[e]
        bent = 0.0 if definite else by_x * moment
        a, b, c = edge(x, stride, i, j), edge(x, stride, k, j), edge(x, stride, k, l)
        bend_second(a, b, c, second)
        pair = 0
        for first in range(4):
            for other in range(first + 1):
                for r in range(3):
                    for s in range(3):
                        entry = straight * g[first, r] * g[other, s]
                        entry += bent * pair_second(second, pair, r, s)
                        values[places[e, pair, r, s]] += entry
                pair += 1


# --- all groups ---------------------------------------------------------------------------------


def add_all(
    groups: Any,
    places: Any,
    tangent: Any,
    body: Any,
    x: Any,
    v: Any,
    by_x: float,
    by_v: float,
    definite: bool,
) -> None:
    """Add the contributions of every group of a tuple: bars, hinges or bends."""


@chosen_by_type(add_all)
def _add_all(groups, places, tangent, body, x, v, by_x, by_v, definite):
    if len(groups) == 0:
        return lambda groups, places, tangent, body, x, v, by_x, by_v, definite: None
    kind = groups.types[0].instance_class
    add_group = {
        LinearHinges: add_hinge_tangents,
        WalledHinges: add_hinge_tangents,
        LinearBends: add_bend_tangents,
    }.get(kind, add_bar_tangents)

    def one_by_one(groups, places, tangent, body, x, v, by_x, by_v, definite):
        add_group(groups[0], places[0], tangent, body, x, v, by_x, by_v, definite)
        add_all(groups[1:], places[1:], tangent, body, x, v, by_x, by_v, definite)

    return one_by_one


@jit
def assemble(
    tangent: Any, body: Any, x: Any, v: Any, by_x: float, by_v: float, definite: bool
) -> None:
    """Set the matrix to ``M + by_v C + by_x K``.

    With `definite`, what can make it indefinite is left out: bars under pressure and hinges
    with a moment have no geometric part then, and bends that of a moment that straightens.
    """
    values = tangent.factor.values
    for p in range(values.size):
        values[p] = 0.0
    for u in range(tangent.free.size):
        at = tangent.free[u]
        values[tangent.diagonal[u]] += body.mass[at] + by_v * body.drag[at]
    add_all(body.bars, tangent.bars, tangent, body, x, v, by_x, by_v, definite)
    add_all(body.hinges, tangent.hinges, tangent, body, x, v, by_x, by_v, definite)
    add_all(body.bends, tangent.bends, tangent, body, x, v, by_x, by_v, definite)
