"""The rigid elements of a scene as rows of constraints, checked before the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.linear import PIVOT_TOLERANCE, analyse
from openprc.demlat.linear.symbolic import Factor
from openprc.demlat.models.barhinge.constraint_calls import newton_positions, values
from openprc.demlat.models.barhinge.constraint_rank import dependent_rows, shaken
from openprc.demlat.models.barhinge.constraints import ConstraintTable, ConstraintWork
from openprc.demlat.observables import hinge_angles
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.schema.geometry import Geometry

    Reals = NDArray[np.float64]
    Flags = NDArray[np.bool_]
    Rows = NDArray[np.int64]

#: Largest gap at the start that is closed by moving nodes, and the largest between rows of
#: which one follows from the others (positions in float32 leave 1e-7 ... 1e-6); relative to
#: the length, or in radians.
START_GAP = 1e-3
REDUNDANT_GAP = 1e-5
#: What counts as satisfied.
EXACT = 1e-13
ROUNDING = 1e-10
NEWTON_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class ConstraintSystem:
    """Rows of constraints with their work space, and what is worth knowing about them.

    Parameters
    ----------
    table : ConstraintTable
    work : ConstraintWork
    factor : Factor
        Of ``G M^-1 G^T``.
    bars, hinges : (B,), (H,) [element]
        Which bars and hinges of the geometry the rows are, in their order.
    names : tuple of str
        One for each row.
    redundant : tuple of str
        Rigid elements that are no row, because the others (or held nodes) imply them.
    singular : tuple of str
        Rows that depend on others in the shape at the start, but not in neighbouring ones.
    remarks : tuple of str
        Sentences for the user.
    """

    table: ConstraintTable
    work: ConstraintWork
    factor: Factor
    bars: Rows
    hinges: Rows
    names: tuple[str, ...]
    redundant: tuple[str, ...] = ()
    singular: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def n_rows(self) -> int:
        """Number of constraints."""
        return len(self.names)


def flat_state(columns: ArrayLike, *, stride: int) -> Reals:
    """Return (N, 3) values as the flat state: (3 * stride,), zeros between axes."""
    columns = np.asarray(columns, dtype=float)
    flat = np.zeros((3, stride))
    flat[:, : len(columns)] = columns.T
    return flat.ravel()


def inverse_masses(geometry: Geometry, *, held: Flags, stride: int) -> Reals:
    """Return the flat inverse masses [1/kg], 0 on held axes: (3 * stride,)."""
    with np.errstate(divide="ignore"):
        inverse = 1.0 / geometry.masses[:, np.newaxis]
    return flat_state(np.where(held, 0.0, inverse), stride=stride)


def constraint_table(
    geometry: Geometry,
    *,
    held: Flags,
    stride: int,
    bars: Rows | None = None,
    hinges: Rows | None = None,
) -> tuple[ConstraintTable, Factor]:
    """Return rigid elements as rows, unchecked, and the factor of ``G M^-1 G^T``.

    Parameters are those of `constraint_system`; `bars` and `hinges` (B,), (H,) say which
    elements, by default all rigid ones with a node that is not held.
    """
    free = ~np.all(held, axis=1)
    bars = _movable(geometry.bars, free) if bars is None else bars
    hinges = _movable(geometry.hinges, free) if hinges is None else hinges
    corners = geometry.hinges.indices
    node = np.concatenate([geometry.bars.indices[bars].ravel(), corners[hinges].ravel()])
    row = np.concatenate([np.repeat(np.arange(len(bars)), 2), np.repeat(np.arange(len(hinges)), 4)])
    row[2 * len(bars) :] += len(bars)

    # All pairs of blocks that meet at a node which can move.
    by_node = np.argsort(node, kind="stable")
    bounds = np.searchsorted(node[by_node], np.arange(len(free) + 1))
    firsts, seconds = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for n in np.flatnonzero(free & (np.diff(bounds) > 0)):
        blocks = by_node[bounds[n] : bounds[n + 1]]
        upper = np.triu_indices(len(blocks))
        firsts.append(blocks[upper[0]])
        seconds.append(blocks[upper[1]])
    first, second = np.concatenate(firsts), np.concatenate(seconds)
    factor, target = analyse(row[first], row[second], n=len(bars) + len(hinges))

    stops = geometry.hinges.limited & ~geometry.hinges.rigid & (geometry.hinges.law == "linear")
    stops &= free[corners].any(axis=1)
    table = ConstraintTable(
        stride=stride,
        node=node.astype(np.uint32),
        length=geometry.bars.rest_length[bars],
        rest_bend=geometry.hinges.rest_angle[hinges] - np.pi,
        stop_node=corners[stops].ravel().astype(np.uint32),
        stop_low=geometry.hinges.limit_low[stops] - np.pi,
        stop_high=geometry.hinges.limit_high[stops] - np.pi,
        pair_first=first.astype(np.uint32),
        pair_second=second.astype(np.uint32),
        pair_target=target,
    )
    return table, factor


def constraint_system(geometry: Geometry, *, held: Flags, stride: int) -> ConstraintSystem:
    """Return the rigid elements of a geometry as constraints that can be solved.

    Elements between held nodes are left out, and so are those that follow from the others, in
    the shape at the start and in neighbouring shapes alike. Ones that depend on others only in
    the shape at the start (a flat sheet, a straight chain) stay: the factorisation leaves
    their pivots out for as long as they vanish.

    Parameters
    ----------
    geometry : Geometry
    held : (N, 3) bool
        Axes that are fixed or driven in position.
    stride : int
        Of the flat state.

    Raises
    ------
    ConfigError
        If a rigid element cannot be a constraint (no length, a wing on its crease), contradicts
        the start positions by more than `START_GAP`, or contradicts the other elements.
    """
    system = _system(geometry, held=held, stride=stride)
    _check_held(geometry, held)
    _check_shape(geometry, system)
    x = flat_state(geometry.positions, stride=stride)
    inverse_mass = inverse_masses(geometry, held=held, stride=stride)
    gap = values(x, system.table, system.work)
    if gap > START_GAP:
        _refuse_start(system)

    nearby = flat_state(shaken(geometry, system, held=held), stride=stride)

    def leave_out(system: ConstraintSystem, rows: Rows) -> tuple[ConstraintSystem, Rows]:
        rest = _without(geometry, system, rows, held=held, stride=stride)
        return rest, dependent_rows(rest, x=x, inverse_mass=inverse_mass)

    here = dependent_rows(system, x=x, inverse_mass=inverse_mass)
    there = dependent_rows(system, x=nearby, inverse_mass=inverse_mass)
    kept, here = leave_out(system, np.intersect1d(here, there))
    # The two shapes may name different rows of one dependent group. With equal rank, the rows
    # of the start do for both; with less rank there, those of the neighbour go where it costs
    # the start nothing.
    there = dependent_rows(kept, x=nearby, inverse_mass=inverse_mass)
    if len(there):
        fewer, here_then = leave_out(kept, here if len(here) == len(there) else there)
        if fewer.n_rows - len(here_then) == kept.n_rows - len(here):
            kept, here = fewer, here_then
    if gap > ROUNDING:
        _check_consistent(system, kept, x, inverse_mass)
    singular = tuple(kept.names[row] for row in here)
    remarks = []
    if kept.redundant:
        remarks.append(
            f"{len(kept.redundant)} rigid element(s) are implied by the others and left out: "
            f"{_listed(kept.redundant)}."
        )
    if singular:
        remarks.append(
            f"{len(singular)} rigid element(s) depend on the others in the starting shape only, "
            f"where nothing resists the first motion out of line: {_listed(singular)}."
        )
    return replace(kept, singular=singular, remarks=tuple(remarks))


def satisfy(system: ConstraintSystem, *, x: Reals, inverse_mass: Reals) -> float:
    """Move the flat positions `x` in place onto the constraints; return the gap there was.

    For gaps as small as the rounding of stored positions. The nodes move along the gradients,
    light ones more than heavy ones, held ones not at all.

    Raises
    ------
    ConfigError
        If no positions nearby satisfy the constraints.
    """
    gap: float = values(x, system.table, system.work)
    if gap > EXACT:
        _, residual = newton_positions(
            x,
            inverse_mass,
            system.table,
            system.work,
            system.factor,
            PIVOT_TOLERANCE,
            EXACT,
            NEWTON_STEPS,
        )
        if not residual <= ROUNDING:
            row = _worst(system)
            raise ConfigError(
                f"{system.names[row]} is rigid, and its gap of {_gap(system, row)} at the start "
                "cannot be closed together with the others",
                expected="positions that satisfy all rigid elements, or nearly so",
                fix="correct positions, rest lengths and rest angles, or make it elastic",
                key="nodes/positions",
            )
    return gap


def _movable(elements: object, free: Flags) -> Rows:
    rigid, indices = elements.rigid, elements.indices  # type: ignore[attr-defined]
    return np.flatnonzero(rigid & free[indices].any(axis=1))


def _system(
    geometry: Geometry,
    *,
    held: Flags,
    stride: int,
    bars: Rows | None = None,
    hinges: Rows | None = None,
) -> ConstraintSystem:
    free = ~np.all(held, axis=1)
    bars = _movable(geometry.bars, free) if bars is None else bars
    hinges = _movable(geometry.hinges, free) if hinges is None else hinges
    table, factor = constraint_table(geometry, held=held, stride=stride, bars=bars, hinges=hinges)
    return ConstraintSystem(
        table=table,
        work=ConstraintWork.for_table(table),
        factor=factor,
        bars=bars,
        hinges=hinges,
        names=(
            *(_name("bar", b, geometry.bars.indices[b]) for b in bars),
            *(_name("hinge", h, geometry.hinges.indices[h]) for h in hinges),
        ),
    )


def _without(
    geometry: Geometry, system: ConstraintSystem, rows: Rows, *, held: Flags, stride: int
) -> ConstraintSystem:
    if not len(rows):
        return system
    n_bars = len(system.bars)
    kept = _system(
        geometry,
        held=held,
        stride=stride,
        bars=np.delete(system.bars, rows[rows < n_bars]),
        hinges=np.delete(system.hinges, rows[rows >= n_bars] - n_bars),
    )
    return replace(kept, redundant=(*system.redundant, *(system.names[r] for r in rows)))


def _name(kind: str, number: int, nodes: NDArray[np.int32]) -> str:
    return f"{kind} {number} (nodes {'-'.join(str(n) for n in nodes)})"


def _listed(names: Sequence[str], limit: int = 5) -> str:
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more


# --- checks -----------------------------------------------------------------------------------


def _check_shape(geometry: Geometry, system: ConstraintSystem) -> None:
    for b in system.bars[~(system.table.length > 0.0)]:
        raise ConfigError(
            f"{_name('bar', b, geometry.bars.indices[b])} is rigid with a rest length of "
            f"{geometry.bars.rest_length[b]:g} m",
            expected="a positive length",
            fix="merge its two nodes into one, or give it its length",
            key="elements/bars/rest_length",
        )
    corners = geometry.positions[geometry.hinges.indices[system.hinges]]
    j, k, i, l = (corners[:, c] for c in range(4))  # noqa: E741
    crease = np.linalg.norm(k - j, axis=1)
    for wing in (i, l):
        height = np.linalg.norm(np.cross(wing - j, k - j), axis=1)  # times the crease
        for h in system.hinges[~(height > ROUNDING * crease**2)]:
            raise ConfigError(
                f"{_name('hinge', h, geometry.hinges.indices[h])} is rigid, and a wing of it lies "
                "on the crease",
                expected="two triangles, which have an angle between them",
                fix="move the wing off the crease, or remove the hinge",
                key="elements/hinges/indices",
            )


def _check_held(geometry: Geometry, held: Flags) -> None:
    bars = geometry.bars
    still = np.all(held, axis=1)  # these nodes stay where they are put
    ends = geometry.positions[bars.indices]
    distance = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    gap = np.abs(distance - bars.rest_length)
    wrong = bars.rigid & still[bars.indices].all(axis=1) & (gap > REDUNDANT_GAP * bars.rest_length)
    for b in np.flatnonzero(wrong).tolist():
        raise ConfigError(
            f"{_name('bar', b, bars.indices[b])} is rigid with a rest length of "
            f"{bars.rest_length[b]:g} m, and its nodes are held {distance[b]:g} m apart",
            expected="held nodes at the distance of the rest length",
            fix="correct the rest length, remove the bar, or release a node",
            key="elements/bars/rest_length",
        )
    hinges = geometry.hinges
    for h in np.flatnonzero(hinges.rigid & still[hinges.indices].all(axis=1)).tolist():
        angle = hinge_angles(geometry.positions[np.newaxis], hinges)[0, h]
        turn = np.mod(angle - hinges.rest_angle[h] + np.pi, 2.0 * np.pi) - np.pi
        if abs(turn) > REDUNDANT_GAP:
            raise ConfigError(
                f"{_name('hinge', h, hinges.indices[h])} is rigid with a rest angle of "
                f"{hinges.rest_angle[h]:g} rad, and its nodes are held at {angle:g} rad",
                expected="held nodes at the rest angle",
                fix="correct the rest angle, remove the hinge, or release a node",
                key="elements/hinges/angle",
            )


def _worst(system: ConstraintSystem) -> int:
    scale = np.concatenate([system.table.length, np.ones(len(system.hinges))])
    return int(np.argmax(np.abs(system.work.value) / scale))


def _gap(system: ConstraintSystem, row: int) -> str:
    unit = "m" if row < len(system.bars) else "rad"
    return f"{system.work.value[row]:.3g} {unit}"


def _refuse_start(system: ConstraintSystem) -> None:
    row = _worst(system)
    raise ConfigError(
        f"{system.names[row]} is rigid, and the positions at the start leave a gap of "
        f"{_gap(system, row)}",
        expected=f"positions that satisfy every rigid element to {START_GAP:g} of its length "
        "(or rad)",
        fix="correct the positions, or the element's rest length or rest angle",
        key="nodes/positions",
    )


def _check_consistent(
    system: ConstraintSystem,
    kept: ConstraintSystem,
    x: Reals,
    inverse_mass: Reals,
) -> None:
    x = x.copy()
    satisfy(kept, x=x, inverse_mass=inverse_mass)
    values(x, system.table, system.work)
    for row, name in enumerate(system.names):
        scale = system.table.length[row] if row < len(system.bars) else 1.0
        if abs(system.work.value[row]) > REDUNDANT_GAP * scale:
            raise ConfigError(
                f"{name} is rigid and contradicts the other rigid elements by {_gap(system, row)}",
                expected="a rest value that the others leave room for: they fix it already",
                fix="correct its rest length or rest angle, or make one of them elastic",
                key=f"elements/{'bars' if row < len(system.bars) else 'hinges'}",
            )
