# ruff: noqa: TID253 - graphs and ranks are what this module is for; a run does not load it
"""Motions that nothing resists: how many there are, and which nodes move in some of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from scipy import linalg, sparse

from openprc.demlat.planning.motion_words import say_motion, say_node, say_whole
from openprc.demlat.planning.rigidity import NULL, RigidityMatrix, rigidity_matrix
from openprc.demlat.planning.tangent_operators import starting_positions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]
    Places = NDArray[np.int64]

#: Motions that are shown, and nodes that are named of each.
MOST_SHOWN, MOST_NAMED = 8, 20
#: Motions are made sparse by dense algebra up to this many of them.
_MOST_MADE_SPARSE = 300
#: Coordinates of a piece among which those are sought that are kept at rest.
_FIRST = 9


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A motion that strains no element, to first order.

    Attributes
    ----------
    kind : {"mechanism", "whole"}
        "whole": a piece moves as if it were rigid.
    count : int
        How many independent motions the text stands for.
    n_nodes : int
        Nodes that move.
    nodes : tuple of int
        The first of them.
    text : str
    """

    kind: Literal["mechanism", "whole"]
    count: int
    n_nodes: int
    nodes: tuple[int, ...]
    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "kind": self.kind,
            "count": self.count,
            "n_nodes": self.n_nodes,
            "nodes": list(self.nodes),
            "text": self.text,
        }


@dataclass(frozen=True, kw_only=True)
class FreeMotions:
    """What the rigidity matrix says.

    Attributes
    ----------
    n_free : int
        Free coordinates.
    n_rows : int
        Independent strains if none were redundant: one of a bar or hinge, one or two of a bend.
    rank : int
    n_mechanisms, n_whole : int
        Motions without strain: within pieces, and of pieces as a whole.
    n_redundant : int
        States of self-stress: rows less the rank.
    n_redundant_rigid : int
        The same of rigid elements alone; which of them may be left out is in
    redundant_rigid : tuple of str
        "bar 3", ...; empty where there are too many rigid elements to tell.
    shown : tuple of Motion
        Some of the motions.
    """

    n_free: int
    n_rows: int
    rank: int
    n_mechanisms: int
    n_whole: int
    n_redundant: int
    n_redundant_rigid: int
    redundant_rigid: tuple[str, ...]
    shown: tuple[Motion, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        data = {name: getattr(self, name) for name in self.__dataclass_fields__}
        data["redundant_rigid"] = list(self.redundant_rigid)
        data["shown"] = [motion.as_dict() for motion in self.shown]
        return data


def mechanisms(experiment: Experiment) -> tuple[int, int] | None:
    """Count motions that strain no element, to first order.

    Returns
    -------
    (inner, whole) or None
        Independent mechanisms, and motions of pieces as a whole; None for bodies that are too
        large to be searched.
    """
    found = rigidity_matrix(experiment).null_space
    if found is None:
        return None
    whole = sum(piece.motions.shape[1] for piece in _pieces(experiment))
    return found.dimension - whole, whole


def free_motions(experiment: Experiment) -> FreeMotions | None:
    """Return what moves without strain, and what is held more than once.

    None for bodies that are too large to be searched.
    """
    system = rigidity_matrix(experiment)
    found, redundant = system.null_space, system.redundant_rigid()
    if found is None or redundant is None:
        return None
    pieces = _pieces(experiment)
    whole = sum(piece.motions.shape[1] for piece in pieces)
    rank = system.n_free - found.dimension
    names = [f"{system.kind[row][:-1]} {system.element[row]}" for row in redundant[1]]
    shown = _shown(experiment, system, pieces, n_inner=found.dimension - whole)
    return FreeMotions(
        n_free=system.n_free,
        n_rows=int(system.matrix.shape[0]),
        rank=rank,
        n_mechanisms=found.dimension - whole,
        n_whole=whole,
        n_redundant=int(system.matrix.shape[0]) - rank,
        n_redundant_rigid=redundant[0],
        redundant_rigid=tuple(names),
        shown=tuple(shown),
    )


# --- pieces as a whole ---------------------------------------------------------------------------


def pieces(experiment: Experiment) -> NDArray[np.int32]:
    """Return the number of the connected piece of each node: (N,)."""
    geometry, n = experiment.geometry, experiment.geometry.n_nodes
    hinges, bends = geometry.hinges.indices, geometry.bends.indices
    pairs = np.concatenate(
        [
            geometry.bars.indices,
            *(hinges[:, [0, column]] for column in range(1, 4)),
            *(bends[:, [1, column]] for column in (0, 2)),
        ]
    )
    graph = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    labels: NDArray[np.int32] = sparse.csgraph.connected_components(graph, directed=False)[1]
    return labels


class _Piece(NamedTuple):
    """A piece that can move as a whole.

    Attributes
    ----------
    nodes : (P,)
    columns : (F,)
        Of the rigidity matrix: its free coordinates.
    motions : (F, r)
        Orthonormal.
    screws : (6, r')
        Shifts along x, y, z and turns about them through the origin that what is held allows.
    """

    nodes: Places
    columns: Places
    motions: Reals
    screws: Reals


def _pieces(experiment: Experiment) -> list[_Piece]:
    x, labels = starting_positions(experiment), pieces(experiment)
    system_place = np.full(x.shape, -1, dtype=np.int64)
    free = ~experiment.held_axes
    axes = 2 if experiment.planar else 3
    free[:, axes:] = False
    system_place[free] = np.arange(int(free.sum()))
    # A piece with three held nodes that are not on a line is the common case, and cannot move.
    order = np.argsort(labels, kind="stable")
    found = []
    for nodes in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
        if not free[nodes].any():
            continue
        columns = system_place[nodes][free[nodes]]
        if len(nodes) == 1:  # there may be thousands
            found.append(_Piece(nodes, columns, np.eye(len(columns)), np.zeros((6, 0))))
            continue
        arms = x[nodes] - x[nodes].mean(axis=0)
        size = float(np.abs(arms).max()) or 1.0
        motions = np.zeros((len(nodes), 3, 6))
        for axis in range(3):
            motions[:, axis, axis] = 1.0
            motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms / size)
        motions = motions[:, :axes, [0, 1, 5] if axes == 2 else range(6)]
        moves = free[nodes, :axes]
        screws = _kernel(motions[~moves])
        if not screws.shape[1]:
            continue
        moving = motions[moves] @ screws
        left, strengths, _ = np.linalg.svd(moving, full_matrices=False)
        basis = left[:, strengths > NULL * max(1.0, float(strengths[0]))]
        if basis.shape[1]:
            whole = np.zeros((6, screws.shape[1]))
            whole[[0, 1, 5] if axes == 2 else range(6)] = screws
            found.append(_Piece(nodes, columns, basis, whole))
    return found


def _kernel(rows: Reals) -> Reals:
    if not len(rows):
        return np.eye(rows.shape[1])
    # Of six columns the Gram matrix would do, but it would square what is small.
    basis: Reals = linalg.null_space(np.linalg.qr(rows, mode="r"), rcond=NULL)
    return basis


# --- which nodes move ----------------------------------------------------------------------------


def _shown(
    experiment: Experiment, system: RigidityMatrix, parts: list[_Piece], *, n_inner: int
) -> Iterator[Motion]:
    fields = _Fields(starting_positions(experiment), system)
    for part in parts[:MOST_SHOWN]:
        yield from fields.whole(part)
    if len(parts) > MOST_SHOWN:
        rest = parts[MOST_SHOWN:]
        nodes = np.concatenate([part.nodes for part in rest])
        yield Motion(
            kind="whole",
            count=sum(part.motions.shape[1] for part in rest),
            n_nodes=len(nodes),
            nodes=tuple(nodes[:MOST_NAMED].tolist()),
            text=f"{len(rest):,} more pieces move as a whole, {len(nodes):,} nodes",
        )
    if n_inner:
        yield from fields.inner(parts, n_inner)


class _Fields:
    """Turns null vectors into motions of nodes."""

    def __init__(self, x: Reals, system: RigidityMatrix) -> None:
        self.x = x
        self.system = system
        node, axis = np.nonzero(system.place >= 0)
        self.node, self.axis = np.zeros((2, system.n_free), dtype=np.int64)
        self.node[system.place[node, axis]] = node
        self.axis[system.place[node, axis]] = axis

    def motion(self, columns: Places, values: Reals) -> Motion:
        """Return one motion whose rates at some coordinates are `values`."""
        nodes, at = np.unique(self.node[columns], return_inverse=True)
        rates = np.zeros((len(nodes), 3))
        rates[at, self.axis[columns]] = values
        sizes = np.linalg.norm(rates, axis=1)
        moving = sizes > 1e-6 * sizes.max()
        nodes, rates = nodes[moving], rates[moving]
        return Motion(
            kind="mechanism",
            count=1,
            n_nodes=len(nodes),
            nodes=tuple(nodes[:MOST_NAMED].tolist()),
            text=say_motion(nodes, self.x[nodes], rates),
        )

    def whole(self, part: _Piece) -> Iterator[Motion]:
        """Yield how a piece moves."""
        moving, count = np.unique(self.node[part.columns]), part.motions.shape[1]
        if len(moving) == 1:
            rates = np.zeros((count, 3))
            rates[:, self.axis[part.columns]] = _echelon(part.motions).T
            text = say_node(int(moving[0]), rates)
        elif count == 1:
            text = self.motion(part.columns, part.motions[:, 0]).text
        else:
            text = say_whole(moving, part.screws, count)
        yield Motion(
            kind="whole",
            count=count,
            n_nodes=len(moving),
            nodes=tuple(moving[:MOST_NAMED].tolist()),
            text=text,
        )

    def inner(self, parts: list[_Piece], n_inner: int) -> Iterator[Motion]:
        """Yield mechanisms, those of pieces that move as a whole with part of them at rest."""
        found = self.system.null_space
        assert found is not None  # noqa: S101 - told by the caller
        n_vectors = found.basis.shape[1] + len(found.loose)
        few = found.complete and n_vectors <= _MOST_MADE_SPARSE
        if few:
            every = np.zeros((self.system.n_free, n_vectors))
            every[:, : found.basis.shape[1]] = found.basis
            every[found.loose, found.basis.shape[1] + np.arange(len(found.loose))] = 1.0
            vectors = _echelon(_pinned(every, parts))
        else:  # examples will do, unless a piece moves as a whole in them
            vectors = _echelon(found.basis)
            vectors = vectors[:, [not _is_whole(column, parts) for column in vectors.T]]
        left = min(n_inner, MOST_SHOWN)
        if not few:
            for place in found.loose[:left]:
                yield self.motion(np.array([place]), np.ones(1))
            left = max(0, left - len(found.loose))
        for column in vectors.T[:left]:
            at = np.flatnonzero(np.abs(column) > 1e-6 * np.abs(column).max())
            yield self.motion(at, column[at])


def _is_whole(column: Reals, parts: list[_Piece]) -> bool:
    rest = column.copy()
    for part in parts:
        rest[part.columns] -= part.motions @ (part.motions.T @ rest[part.columns])
    return bool(np.linalg.norm(rest) < 1e-6 * np.linalg.norm(column))


def _pinned(vectors: Reals, parts: list[_Piece]) -> Reals:
    """Return combinations that are 0 where pieces are pinned so that they stay as a whole."""
    pins: list[Places] = []
    for part in parts:
        count = part.motions.shape[1]
        # Nodes that come first, if they do: people number bodies from where they are held.
        for rows in (part.motions[:_FIRST], part.motions):
            upper, order = linalg.qr(rows.T, mode="r", pivoting=True)
            pivots = np.abs(np.diag(upper))
            if len(pivots) == count and pivots[-1] > 0.1 * pivots[0]:
                break
        pins.append(part.columns[order[:count]])
    if not pins:
        return vectors
    inner = linalg.null_space(vectors[np.concatenate(pins)], rcond=NULL)
    pinned: Reals = vectors @ inner
    return pinned


def _echelon(vectors: Reals) -> Reals:
    """Return a basis of the same space, each vector 1 where all the others are 0.

    Nodes that can move by themselves then do.
    """
    if not vectors.shape[1]:
        return vectors
    order = linalg.qr(vectors.T, mode="r", pivoting=True)[1][: vectors.shape[1]]
    order = np.sort(order)
    reduced: Reals = np.linalg.solve(vectors[order].T, vectors.T).T
    reduced[np.abs(reduced) < 1e-9] = 0.0
    return reduced
