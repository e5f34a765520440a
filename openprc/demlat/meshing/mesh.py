"""`Mesh`: nodes, bars, hinges, bends and faces of a body, before it has masses and stiffnesses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.meshing.ordering import (
    bar_order,
    bend_order,
    canonical_bars,
    canonical_bends,
    canonical_hinges,
    hinge_order,
)
from openprc.demlat.observables import hinge_angles
from openprc.errors import ConfigError
from openprc.schema.geometry import Hinges
from openprc.schema.mistakes import list_some

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.demlat.geometry_builder import GeometryBuilder

    Reals = NDArray[np.float64]

FLAT = np.pi
#: Default of columns that are filled in once the positions are known.
_FILLED: Any = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """A body without mechanics; the elements are sorted when the mesh is made.

    Parameters
    ----------
    positions : (N, 3) [m]
    bars : (M, 2) [node]
    bar_kinds : (M,) str
        "edge" and "diagonal" in lattices; "fold", "facet" and "boundary" in sheets.
    hinges : (K, 4) [node]
        ``[j, k, i, l]``: the crease j-k, and the wings i and l. Seen from the side that the
        faces turn to, i is on the left of j-k, so that a valley has an angle below pi.
    hinge_kinds : (K,) str
        "fold", or "facet" where a panel bends.
    senses : (K,) int8, default 0
        1 for a valley, -1 for a mountain, 0 where the pattern does not say.
    rest_lengths : (M,) [m], default as in `positions`
    rest_angles : (K,) [rad], default as in `positions`
    bends : (B, 3) [node]
        ``[end, vertex, end]`` of bending springs; they rest at the angles of `positions`.
    faces : (F, 3) [node]
        Triangles, counter-clockwise seen from the side that they turn to.
    node_sets : mapping of str to (S,) [node]
        Such as "left", "right", "bottom", "top" and "boundary".

    Raises
    ------
    ConfigError
        For two bars between the same nodes, or columns that do not fit.
    """

    positions: NDArray[np.float64]
    bars: NDArray[Any]
    bar_kinds: NDArray[np.str_]
    hinges: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 4), "i4"))
    hinge_kinds: NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, "U16"))
    senses: NDArray[np.int8] = _FILLED
    rest_lengths: NDArray[np.float64] = _FILLED
    rest_angles: NDArray[np.float64] = _FILLED
    bends: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 3), "i4"))
    faces: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 3), "i4"))
    node_sets: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype="f8").reshape(-1, 3)
        bars, hinges = canonical_bars(self.bars), canonical_hinges(self.hinges)
        bends = canonical_bends(self.bends)
        faces = np.array(self.faces, dtype="i4").reshape(-1, 3)
        sets = {name: np.unique(np.array(n, dtype="i4")) for name, n in self.node_sets.items()}
        tables = {"bars": bars, "hinges": hinges, "bends": bends, "faces": faces}
        _check_nodes({**tables, **sets}, len(positions))
        along, around = bar_order(bars), hinge_order(hinges)
        senses = np.zeros(len(hinges)) if self.senses is None else self.senses
        lengths = (
            _lengths(positions, bars) if self.rest_lengths is None else np.array(self.rest_lengths)
        )
        angles = (
            dihedral_angles(positions, hinges)
            if self.rest_angles is None
            else np.array(self.rest_angles)
        )
        self._put("positions", positions)
        self._put("bars", bars[along])
        self._put("hinges", hinges[around])
        self._put("bends", bends[bend_order(bends)])
        self._put("faces", faces)
        for name, values, order, dtype in (
            ("bar_kinds", self.bar_kinds, along, "U16"),
            ("rest_lengths", lengths, along, "f8"),
            ("hinge_kinds", self.hinge_kinds, around, "U16"),
            ("senses", senses, around, "i1"),
            ("rest_angles", angles, around, "f8"),
        ):
            column = np.array(values, dtype=dtype)
            if column.shape != (len(order),):
                raise ConfigError(
                    f"shape {column.shape}", expected=f"({len(order)},)", key=f"mesh/{name}"
                )
            self._put(name, column[order])
        object.__setattr__(self, "node_sets", sets)
        twice = np.flatnonzero((np.diff(self.bars, axis=0) == 0).all(axis=1))
        if len(twice):
            raise ConfigError(
                f"two bars between nodes {self.bars[twice[0]].tolist()}",
                expected="one bar between two nodes",
                key="mesh/bars",
            )

    def _put(self, name: str, array: NDArray[Any]) -> None:
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.positions)

    @property
    def bar_lengths(self) -> Reals:
        """Lengths in `positions`: (M,) [m]."""
        return _lengths(self.positions, self.bars)

    @property
    def angles(self) -> Reals:
        """Dihedral angles in `positions`: (K,) [rad], pi is flat."""
        return dihedral_angles(self.positions, self.hinges)

    @property
    def crease_lengths(self) -> Reals:
        """Lengths of the creases of the hinges: (K,) [m]; multiply stiffnesses a metre by it."""
        return _lengths(self.positions, self.hinges[:, :2])

    def bar_values(self, values: float | Mapping[str, float] | ArrayLike) -> Reals:
        """Return `values`, a number, one for each kind, or one for each bar, as (M,)."""
        return _expand(values, self.bar_kinds, "bars")

    def hinge_values(self, values: float | Mapping[str, float] | ArrayLike) -> Reals:
        """Return `values`, a number, one for each kind, or one for each hinge, as (K,)."""
        return _expand(values, self.hinge_kinds, "hinges")

    def lumped_masses(self, density: float) -> Reals:
        """Return masses for a sheet of `density` [kg/m2], a third of each face: (N,) [kg].

        Raises
        ------
        ConfigError
            When a node has no face, which would leave it without mass.
        """
        a, b, c = (self.positions[self.faces[:, corner]] for corner in range(3))
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        masses = np.zeros(self.n_nodes)
        np.add.at(masses, self.faces, areas[:, None] * density / 3.0)
        bare = np.flatnonzero(masses == 0.0)
        if len(bare):
            raise ConfigError(
                f"node {list_some(bare)} belongs to no face, or the density is 0",
                expected="a sheet in which every node has a face, and a positive density",
                fix="give masses node by node instead",
                key="density",
            )
        return masses

    def folded(self, angle: float, *, facets_flat: bool = False) -> Mesh:
        """Return this mesh with rest angles ``pi - sense * angle`` at its folds.

        Parameters
        ----------
        angle : float [rad]
            0 is flat, pi folded shut; hinges without a sense keep their rest angle.
        facets_flat : bool
            Set the rest angle of facets to pi.
        """
        rest = np.where(self.senses != 0, FLAT - self.senses * angle, self.rest_angles)
        if facets_flat:
            rest = np.where(self.hinge_kinds == "facet", FLAT, rest)
        return replace(self, rest_angles=rest)

    def moved(self, *, by: ArrayLike = (0.0, 0.0, 0.0), rotation: ArrayLike | None = None) -> Mesh:
        """Return this mesh turned by `rotation` (3, 3), about the origin, then shifted [m]."""
        turned = self.positions if rotation is None else self.positions @ np.array(rotation).T
        return replace(self, positions=turned + np.asarray(by, dtype="f8"))

    def to_setup(
        self,
        setup: GeometryBuilder,
        *,
        mass: float | ArrayLike,
        stiffness: float | Mapping[str, float] | ArrayLike,
        damping: float | Mapping[str, float] | ArrayLike = 0.0,
        hinge_stiffness: float | Mapping[str, float] | ArrayLike | None = None,
        hinge_damping: float | Mapping[str, float] | ArrayLike = 0.0,
        bend_stiffness: float | ArrayLike | None = None,
        bend_damping: float | ArrayLike = 0.0,
        fixed: Iterable[int] = (),
        rigid: Iterable[str] = (),
        collidable: bool = False,
    ) -> NDArray[np.int32]:
        """Add nodes, bars, hinges, bends and faces to `setup`, and return the node numbers there.

        Stiffnesses and dampings are one number, a mapping from kind to number, or one number
        for each element.

        Parameters
        ----------
        setup : SimulationSetup
            It may have nodes already.
        mass : float or (N,) [kg]
            Of each node; see `lumped_masses`.
        stiffness : [N/m]
        damping : [N*s/m]
        hinge_stiffness : [N*m/rad]
            Needed when the mesh has hinges.
        hinge_damping : [N*m*s/rad]
        bend_stiffness : float or (B,) [N*m/rad]
            Needed when the mesh has bends.
        bend_damping : float or (B,) [N*m*s/rad]
        fixed : nodes of this mesh that never move
        rigid : kinds of bars whose length is a constraint
        collidable : bool

        Returns
        -------
        (N,) [node]
            ``numbers[mesh.node_sets["left"]]`` are the left nodes in `setup`.

        Raises
        ------
        ConfigError
            When a kind has no value, or a name is no kind of this mesh.
        """
        masses = _expand(mass, np.array([""] * self.n_nodes), "nodes")
        k, c = self.bar_values(stiffness), self.bar_values(damping)
        if hinge_stiffness is None and len(self.hinges):
            raise ConfigError(
                f"{len(self.hinges)} hinges without stiffness",
                expected="a number, or one for each of the kinds "
                + ", ".join(np.unique(self.hinge_kinds)),
                fix="give hinge_stiffness=",
                key="hinge_stiffness",
            )
        fold = self.hinge_values(0.0 if hinge_stiffness is None else hinge_stiffness)
        fold_damping = self.hinge_values(hinge_damping)
        if bend_stiffness is None and len(self.bends):
            raise ConfigError(
                f"{len(self.bends)} bends without stiffness",
                expected="a number, or one for each",
                fix="give bend_stiffness=",
                key="bend_stiffness",
            )
        springs = np.array([""] * len(self.bends))
        turn = _expand(0.0 if bend_stiffness is None else bend_stiffness, springs, "bends")
        turn_damping = _expand(bend_damping, springs, "bends")
        held = np.zeros(self.n_nodes, dtype=bool)
        held[_node_list(fixed, self.n_nodes)] = True
        stiff = _names(rigid, self.bar_kinds)
        first = setup.n_nodes
        for n, position in enumerate(self.positions):
            setup.add_node(
                position, mass=masses[n], fixed=bool(held[n]), collidable=bool(collidable)
            )
        for m, (i, j) in enumerate(self.bars.tolist()):
            setup.add_bar(
                first + i,
                first + j,
                stiffness=k[m],
                damping=c[m],
                rest_length=self.rest_lengths[m],
                rigid=str(self.bar_kinds[m]) in stiff,
            )
        for m, nodes in enumerate(self.hinges.tolist()):
            setup.add_hinge(
                [first + node for node in nodes],
                stiffness=fold[m],
                damping=fold_damping[m],
                rest_angle=self.rest_angles[m],
            )
        for m, nodes in enumerate(self.bends.tolist()):
            setup.add_bend(
                [first + node for node in nodes], stiffness=turn[m], damping=turn_damping[m]
            )
        for face in self.faces.tolist():
            setup.add_face([first + node for node in face])
        return np.arange(first, first + self.n_nodes, dtype=np.int32)


def _check_nodes(tables: Mapping[str, NDArray[Any]], n_nodes: int) -> None:
    for name, table in tables.items():
        outside = (table < 0) | (table >= n_nodes)
        if outside.any():
            raise ConfigError(
                f"node {table[outside][0]}",
                expected=f"nodes from 0 to {n_nodes - 1}",
                key=f"mesh/{name}",
            )


def _lengths(positions: Reals, pairs: NDArray[np.int32]) -> Reals:
    lengths: Reals = np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1)
    return lengths


def dihedral_angles(positions: Reals, hinges: NDArray[np.int32]) -> Reals:
    """Return the angles of `hinges` (K, 4) in `positions` (N, 3) [m]: (K,) [rad]."""
    rows = Hinges(indices=hinges, stiffness=np.zeros(len(hinges)), rest_angle=np.zeros(len(hinges)))
    angles: Reals = hinge_angles(positions[None], rows)[0]
    return angles


def _expand(values: Any, kinds: NDArray[np.str_], what: str) -> Reals:
    if isinstance(values, Mapping):
        known, given = set(kinds.tolist()), set(values)
        if given - known:
            raise ConfigError(
                f"no {what} of the kind {', '.join(sorted(given - known))}",
                expected="kinds of this mesh: " + (", ".join(sorted(known)) or "none"),
                key=what,
            )
        if known - given:
            raise ConfigError(
                f"no value for {what} of the kind {', '.join(sorted(known - given))}",
                expected="a value for every kind of this mesh",
                key=what,
            )
        return np.array([values[kind] for kind in kinds.tolist()], dtype="f8")
    array = np.asarray(values, dtype="f8")
    if array.shape not in ((), kinds.shape):
        raise ConfigError(
            f"shape {array.shape}", expected=f"one number, or one for each: {kinds.shape}", key=what
        )
    return np.broadcast_to(array, kinds.shape).astype("f8")


def _node_list(nodes: Iterable[int], n_nodes: int) -> NDArray[np.int64]:
    rows = np.array(list(nodes))
    if rows.size == 0:
        return np.zeros(0, dtype=np.int64)
    if rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= n_nodes:
        raise ConfigError(
            f"nodes {rows[:5].tolist()}", expected=f"numbers from 0 to {n_nodes - 1}", key="fixed"
        )
    return rows.astype(np.int64)


def _names(names: Iterable[str], kinds: NDArray[np.str_]) -> set[str]:
    chosen = {names} if isinstance(names, str) else set(names)
    unknown = chosen - set(kinds.tolist())
    if unknown:
        raise ConfigError(
            f"no bars of the kind {', '.join(sorted(unknown))}",
            expected="kinds of this mesh: " + ", ".join(np.unique(kinds)),
            key="rigid",
        )
    return chosen
