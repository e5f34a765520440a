# ruff: noqa: TID253 - sparse algebra is what this module is for; a run does not load it
"""The rigidity matrix of a body and its null space: motions that strain no element.

Rows are gradients of lengths and angles of elements with stiffness, columns free coordinates
(Pellegrino & Calladine 1986, doi:10.1016/0020-7683(86)90014-4). Lengths of rows are 1, so that
singular values tell strains of like size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.sparse.linalg import splu

from openprc.demlat.planning.tangent_operators import (
    DEGENERATE,
    free_axes,
    hinge_flatness,
    starting_positions,
)
from openprc.demlat.statics.bending import bend_turns, have_arms
from openprc.demlat.statics.element_shapes import bar_directions, hinge_gradients

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse.linalg import SuperLU

    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Bends

    Reals = NDArray[np.float64]
    Places = NDArray[np.int64]

#: Sine of a turn below which the arms of a bend lie on one line.
COLLINEAR = 1e-6
#: Motions with a strain below this share of the largest one may be free; their strain is then
#: computed without squaring it, and
CANDIDATE = 1e-6
#: below this share it counts as none. (Coordinates in single precision are good to 6e-8.)
NULL = 1e-7
#: Entries of a row below this are rounding.
ROUNDING = 1e-13
#: Up to this many coordinates all eigenvalues are computed by dense algebra.
DENSE = 600
#: Up to this many free motions of a larger body are computed; of more only the number is.
MOST_VECTORS = 64
#: Bodies with more coordinates are not searched, nor those whose factors would take more work
#: than this (a few seconds).
MOST_COORDINATES, MOST_WORK = 400_000, 1.2e10
#: Of the largest eigenvalue: keeps the matrix definite while free motions are computed.
_SHIFT = 1e-14

Kind = Literal["bars", "hinges", "bends"]


class NullSpace(NamedTuple):
    """Motions that strain no element.

    Attributes
    ----------
    dimension : int
    basis : (n, dimension), or (n, fewer) where they are too many to compute
        Orthonormal.
    loose : (L,)
        Coordinates that no element holds; they are not in `basis`, and are counted.
    """

    dimension: int
    basis: Reals
    loose: Places

    @property
    def complete(self) -> bool:
        """Whether every motion is there."""
        return bool(self.basis.shape[1] + len(self.loose) == self.dimension)


@dataclass(frozen=True, eq=False)
class RigidityMatrix:
    """Gradients of lengths and angles.

    Attributes
    ----------
    matrix : (R, n) sparse
    place : (N, 3)
        Column of every coordinate, -1 where it is held.
    kind, element : (R,)
        What a row belongs to.
    rigid : (R,) bool
    """

    matrix: sparse.csr_array
    place: Places
    kind: NDArray[np.str_]
    element: Places
    rigid: NDArray[np.bool_]

    @property
    def n_free(self) -> int:
        """Number of free coordinates."""
        return int(self.matrix.shape[1])

    @cached_property
    def null_space(self) -> NullSpace | None:
        """Motions that strain nothing; None for bodies that are too large."""
        return null_space(self.matrix)

    def redundant_rigid(self) -> tuple[int, Places] | None:
        """Return how many rigid elements the others imply, and rows that may be left out.

        The rows are known up to `DENSE` of them, else there are none; None for bodies that are
        too large.
        """
        at = np.flatnonzero(self.rigid)
        rows = self.matrix[at]
        if not len(at):
            return 0, at
        found = null_space(rows)
        if found is None:
            return None
        n_redundant = len(at) - (self.n_free - found.dimension)
        if n_redundant == 0 or len(at) > DENSE:
            return n_redundant, at[:0]
        used = np.flatnonzero(np.diff(sparse.csc_array(rows).indptr))
        order = linalg.qr(rows[:, used].toarray().T, mode="r", pivoting=True)[1]
        return n_redundant, np.sort(at[order[len(at) - n_redundant :]])


_KNOWN: WeakKeyDictionary[Experiment, RigidityMatrix] = WeakKeyDictionary()


def rigidity_matrix(experiment: Experiment) -> RigidityMatrix:
    """Return the matrix of a body as it lies at t = 0; elements that hold nothing have no row."""
    if experiment not in _KNOWN:
        _KNOWN[experiment] = _assembled(experiment)
    return _KNOWN[experiment]


def _assembled(experiment: Experiment) -> RigidityMatrix:
    free = free_axes(experiment)
    n_free = int(free.sum())
    place = np.full(free.shape, -1, dtype=np.int64)
    place[free] = np.arange(n_free)
    rows, columns, values = [], [], []
    kinds, elements, rigid = [], [], []
    n_rows = 0
    for block in _gradients(experiment):
        shape = (len(block.element), 3 * block.indices.shape[1])
        at, entries = place[block.indices].reshape(shape), block.rows.reshape(shape)
        active = ((at >= 0) & (np.abs(entries) > ROUNDING)).any(axis=1)
        at, entries = at[active], entries[active]
        row = n_rows + np.broadcast_to(np.arange(len(at))[:, np.newaxis], at.shape)
        inside = (at >= 0) & (entries != 0.0)
        rows.append(row[inside])
        columns.append(at[inside])
        values.append(entries[inside])
        kinds.append(np.full(len(at), block.kind))
        elements.append(block.element[active])
        rigid.append(block.rigid[active])
        n_rows += len(at)
    where = (np.concatenate(rows), np.concatenate(columns))
    return RigidityMatrix(
        matrix=sparse.csr_array((np.concatenate(values), where), shape=(n_rows, n_free)),
        place=place,
        kind=np.concatenate(kinds),
        element=np.concatenate(elements),
        rigid=np.concatenate(rigid),
    )


# --- the null space ------------------------------------------------------------------------------


def null_space(matrix: sparse.csr_array) -> NullSpace | None:
    """Return the null space of a sparse matrix (R, n) with rows of about length 1.

    Large ones are counted by the negative pivots of ``R^T R`` minus a small multiple of the
    identity (Sylvester's law of inertia), and then found by inverse iteration.
    """
    n = matrix.shape[1]
    held = np.zeros(n, dtype=bool)
    held[matrix.indices] = True
    at, loose = np.flatnonzero(held), np.flatnonzero(~held)
    inner = sparse.csr_array(sparse.csc_array(matrix)[:, at])
    basis = np.zeros((n, 0))
    if not len(at):
        return NullSpace(len(loose), basis, loose)
    gram = sparse.csc_array(inner.T @ inner)
    largest = float(abs(gram).sum(axis=0).max())  # Gershgorin's bound
    if len(at) <= DENSE:
        squares, vectors = np.linalg.eigh(gram.toarray())
        found = _unstrained(inner, vectors[:, squares < CANDIDATE**2 * largest], largest)
        count = found.shape[1]
    else:
        if len(at) > MOST_COORDINATES or _work(gram) > MOST_WORK:
            return None
        negative = _negative_pivots(gram, CANDIDATE**2 * largest)
        if negative is None:
            return None
        count = len(negative)
        if count <= MOST_VECTORS:
            found = _unstrained(inner, _inverse_iteration(gram, count, largest), largest)
            count = found.shape[1]
        else:
            found = _examples(inner, gram, negative, largest)
    basis = np.zeros((n, found.shape[1]))
    basis[at] = found
    return NullSpace(count + len(loose), basis, loose)


def _unstrained(matrix: sparse.csr_array, vectors: Reals, largest: float) -> Reals:
    """Return a basis of what is not strained of the space of some orthonormal vectors."""
    if not vectors.shape[1]:
        return vectors
    rates = matrix @ vectors
    short = max(0, rates.shape[1] - rates.shape[0])
    rates = np.concatenate([rates, np.zeros((short, rates.shape[1]))])
    _, strains, turn = np.linalg.svd(rates, full_matrices=False)
    basis: Reals = vectors @ turn[strains < NULL * np.sqrt(largest)].T
    return basis


def _work(gram: sparse.csc_array) -> float:
    """Return about how many operations the factors take: the cube of the widest front.

    Fronts are estimated by the levels of a breadth-first search from either end of the body.
    """
    labels = connected_components(gram, directed=False)[1]
    start, widest = int(np.argmax(labels == np.bincount(labels).argmax())), 0
    for _ in range(2):
        order, before = breadth_first_order(gram, start, directed=False)
        level = np.zeros(gram.shape[0], dtype=np.int64)
        for node in order[1:].tolist():
            level[node] = level[before[node]] + 1
        widest, start = int(np.bincount(level[order]).max()), int(order[-1])
    return float(widest) ** 3


def _factors(matrix: sparse.csc_array) -> SuperLU | None:
    try:
        factors = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # an exactly singular column
        return None
    return factors if np.array_equal(factors.perm_r, factors.perm_c) else None


def _negative_pivots(gram: sparse.csc_array, shift: float) -> Places | None:
    """Return coordinates whose pivots are negative, as many as eigenvalues below the shift."""
    identity = sparse.eye_array(gram.shape[0])
    for factor in (1.0, 1.37, 0.71):  # a pivot that vanishes exactly is bad luck
        factors = _factors(sparse.csc_array(gram - factor * shift * identity))
        if factors is not None:
            below = factors.U.diagonal() < 0.0
            return np.flatnonzero(below[factors.perm_c])
    return None


def _inverse_iteration(gram: sparse.csc_array, count: int, largest: float) -> Reals:
    n = gram.shape[0]
    vectors = np.random.default_rng(0).standard_normal((n, count))
    if count == 0:
        return vectors
    factors = _factors(sparse.csc_array(gram + _SHIFT * largest * sparse.eye_array(n)))
    if factors is None:  # rounding made it singular; a larger shift converges more slowly
        shift = 1e3 * _SHIFT * largest
        factors = splu(sparse.csc_array(gram + shift * sparse.eye_array(n)))
    for _ in range(4):
        vectors = np.linalg.qr(factors.solve(vectors))[0]
    return vectors


def _examples(
    matrix: sparse.csr_array, gram: sparse.csc_array, negative: Places, largest: float
) -> Reals:
    """Return the free motions of the smallest part that has some, if it is small."""
    labels = connected_components(gram, directed=False)[1]
    sizes = np.bincount(labels)
    moving = np.unique(labels[negative])
    part = moving[np.argmin(sizes[moving])]
    at = np.flatnonzero(labels == part)
    found = np.zeros((gram.shape[0], 0))
    if len(at) > DENSE:
        return found
    squares, vectors = np.linalg.eigh(gram[at][:, at].toarray())
    rows = sparse.csr_array(sparse.csc_array(matrix)[:, at])
    basis = _unstrained(rows, vectors[:, squares < CANDIDATE**2 * largest], largest)
    found = np.zeros((gram.shape[0], basis.shape[1]))
    found[at] = basis
    return found


# --- gradients -----------------------------------------------------------------------------------


class _Block(NamedTuple):
    kind: Kind
    element: Places
    indices: NDArray[np.int32]
    rows: Reals
    rigid: NDArray[np.bool_]


def _gradients(experiment: Experiment) -> Iterator[_Block]:
    """Yield gradients (E, k, 3) of norm 1 of elements with stiffness."""
    geometry, x = experiment.geometry, starting_positions(experiment)
    bars, hinges = geometry.bars, geometry.hinges
    at = np.flatnonzero(bars.rigid | (bars.stiffness > 0) | (bars.stiffness_cubic > 0))
    unit = bar_directions(x, bars.indices[at])[1] / np.sqrt(2.0)
    yield _Block("bars", at, bars.indices[at], np.stack([-unit, unit], axis=1), bars.rigid[at])
    stiff = hinges.rigid | (hinges.stiffness > 0)
    at = np.flatnonzero(stiff & (hinge_flatness(x, hinges.indices) > DEGENERATE))
    gradients = hinge_gradients(x, hinges.indices[at])
    yield _Block("hinges", at, hinges.indices[at], _unit(gradients), hinges.rigid[at])
    yield from _bend_gradients(geometry.bends, x)


def _bend_gradients(bends: Bends, x: Reals) -> Iterator[_Block]:
    """Yield those of stiff bends; a straight one resists both sideways motions of its ends."""
    at = np.flatnonzero((bends.stiffness > 0) & have_arms(x, bends.indices))
    indices = bends.indices[at]
    turns = bend_turns(x, indices)
    u, v = x[indices[:, 0]] - x[indices[:, 1]], x[indices[:, 2]] - x[indices[:, 1]]
    uu, vv = np.sum(u * u, axis=1, keepdims=True), np.sum(v * v, axis=1, keepdims=True)
    # Any axis across the first arm will do where the arms lie on one line.
    axis = np.cross(u, v)
    sharp = np.sin(turns) > COLLINEAR
    least = np.eye(3)[np.abs(u).argmin(axis=1)]
    axis = np.where(sharp[:, np.newaxis], axis, np.cross(u, least))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    for chosen in (np.ones(len(indices), dtype=bool), ~sharp):
        first, last = np.cross(axis, u) / uu, np.cross(v, axis) / vv
        rows = np.stack([first, -first - last, last], axis=1)[chosen]
        none = np.zeros(int(chosen.sum()), dtype=bool)
        yield _Block("bends", at[chosen], indices[chosen], _unit(rows), none)
        axis = np.cross(u, axis) / np.sqrt(uu)


def _unit(rows: Reals) -> Reals:
    unit: Reals = rows / np.sqrt(np.sum(rows**2, axis=(1, 2), keepdims=True))
    return unit
