"""Which constraints depend on the others, in one shape of the body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

from openprc.demlat.models.barhinge.constraint_calls import prepare, push, rates, solve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.constraint_table import ConstraintSystem
    from openprc.schema.geometry import Geometry

    Reals = NDArray[np.float64]
    Flags = NDArray[np.bool_]
    Rows = NDArray[np.int64]

#: Pivots below CERTAIN are rounding of zero, those up to LOOSE are looked at closely. (Rounding
#: grows with the size of the body: it reaches 1e-8 in a braced lattice of 100 by 100 nodes.)
LOOSE, CERTAIN = 1e-6, 1e-12
#: Part of a gradient that other gradients may miss, for it to depend on them.
DEPENDENT = 1e-8


def shaken(geometry: Geometry, system: ConstraintSystem, *, held: Flags) -> Reals:
    """Return positions (N, 3) [m] of a shape near the start that has no special symmetry."""
    node = system.table.node.astype(np.int64)
    n_bars = len(system.bars)
    reach = np.full(geometry.n_nodes, np.inf)
    np.minimum.at(reach, node[: 2 * n_bars], np.repeat(system.table.length, 2))
    corners = node[2 * n_bars :].reshape(-1, 4)
    crease = geometry.positions[corners[:, 1]] - geometry.positions[corners[:, 0]]
    np.minimum.at(reach, corners.ravel(), np.repeat(np.linalg.norm(crease, axis=1), 4))
    reach[~np.isfinite(reach)] = 0.0
    # A fixed generator: the same scene always has the same rows.
    shift = np.random.default_rng(0).uniform(-0.1, 0.1, geometry.positions.shape)
    shifted: Reals = geometry.positions + np.where(held, 0.0, shift * reach[:, np.newaxis])
    return shifted


def dependent_rows(system: ConstraintSystem, *, x: Reals, inverse_mass: Reals) -> Rows:
    """Return rows (ascending) without which the other gradients span as much, but not more.

    Rows with clear pivots of ``G M^-1 G^T`` are a basis, and rows without any depend on it.
    For those between, the part of the gradient that the basis misses is computed: a pivot is
    the square of that part's size, rounded relative to the row's square, so it cannot tell a
    shallow truss from rounding, while the part itself can.

    Parameters
    ----------
    system : ConstraintSystem
    x, inverse_mass : (3 * stride,) [m], [1/kg]
    """
    factor = system.factor
    prepare(x, inverse_mass, system.table, system.work, factor, LOOSE)
    places = np.flatnonzero(factor.inverse_pivot == 0.0)
    rows = factor.order[places].astype(np.int64)
    doubtful = rows[factor.relative_pivot[places] >= CERTAIN]
    metric = np.sqrt(np.divide(1.0, inverse_mass, where=inverse_mass > 0, out=np.zeros_like(x)))
    weights = 1.0 / np.sqrt(_row_squares(system))

    def missed(some: Rows, amounts: Reals) -> Reals:
        combination = np.zeros(system.n_rows)
        combination[some] = amounts * weights[some]
        return metric * _missed_part(system, combination)

    # A random combination misses nothing only if none of its rows does.
    rng = np.random.default_rng(0)
    groups, independent = [doubtful], []
    while groups:
        group = groups.pop()
        if not len(group) or np.linalg.norm(missed(group, rng.normal(size=len(group)))) < DEPENDENT:
            continue
        if len(group) == 1:
            independent.append(group[0])
        else:
            groups.extend([group[: len(group) // 2], group[len(group) // 2 :]])
    if independent:  # of the basis; and of each other?
        one = np.ones(1)
        parts = np.stack([missed(np.array([row]), one) for row in independent], axis=1)
        triangle, order = qr(parts, mode="r", pivoting=True)
        sizes = np.zeros(len(independent))
        diagonal = np.abs(np.diag(triangle))
        sizes[: len(diagonal)] = diagonal
        rows = np.setdiff1d(rows, np.array(independent)[order[sizes >= DEPENDENT]])
    return np.sort(rows)


def _row_squares(system: ConstraintSystem) -> Reals:
    """Return the diagonal of ``G M^-1 G^T``, 1 where it vanishes: (R,)."""
    n_bars, n_hinges = len(system.bars), len(system.hinges)
    each = np.sum(system.work.gradient * system.work.mobile, axis=1)
    bars = each[: 2 * n_bars].reshape(n_bars, 2).sum(axis=1)
    hinges = each[2 * n_bars :].reshape(n_hinges, 4).sum(axis=1)
    squares = np.concatenate([bars, hinges])
    return np.where(squares > 0.0, squares, 1.0)


def _missed_part(system: ConstraintSystem, combination: Reals) -> Reals:
    """Return ``M^-1 G^T`` times a combination of rows, less what the basis can make of it."""
    part = np.zeros(3 * system.table.stride)
    push(part, combination, 1.0, system.table, system.work)
    amounts = np.zeros_like(combination)
    for _ in range(3):  # repeated, because the first amounts carry the rounding of the pivots
        rates(part, system.table, system.work, amounts)
        solve(system.factor, amounts)
        push(part, amounts, -1.0, system.table, system.work)
    return part
