"""`GeometryBuilder`: nodes, bars, hinges, bends and faces, added one by one."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from openprc.demlat.observables import hinge_angles
from openprc.errors import ConfigError
from openprc.schema.bend_angle import bend_angles
from openprc.schema.geometry import FULL_TURN, BarLaw, Bars, Bends, Geometry, HingeLaw, Hinges

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

#: Within this angle of straight three nodes count as straight [rad].
COLLINEAR = 1e-9


class GeometryBuilder:
    """Collects a geometry; node numbers are checked at once, everything else when it is saved."""

    def __init__(self) -> None:
        self._nodes: list[dict[str, Any]] = []
        self._bars: list[dict[str, Any]] = []
        self._hinges: list[dict[str, Any]] = []
        self._bends: list[dict[str, Any]] = []
        self._faces: list[list[int]] = []

    @property
    def n_nodes(self) -> int:
        """Number of nodes so far."""
        return len(self._nodes)

    def add_node(
        self,
        position: ArrayLike,
        *,
        mass: float = 1.0,
        fixed: bool = False,
        collidable: bool = False,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        label: str | None = None,
    ) -> int:
        """Add a node and return its index.

        Parameters
        ----------
        position : (2,) or (3,) [m]
            Two coordinates put the node at z = 0.
        mass : float [kg]
        fixed : bool
            The node never moves.
        collidable : bool
        velocity : (2,) or (3,) [m/s]
            At t = 0.
        label : str, optional
            What matches the node across producers; give all nodes one, or none.
        """
        self._nodes.append(
            {
                "position": _vector(position, "position"),
                "mass": number(mass, "mass"),
                "fixed": bool(fixed),
                "collidable": bool(collidable),
                "velocity": _vector(velocity, "velocity"),
                "label": label,
            }
        )
        return len(self._nodes) - 1

    def add_nodes(self, positions: ArrayLike, **settings: Any) -> list[int]:
        """Add nodes at `positions` (N, 2 or 3) [m], all with the same settings."""
        rows = np.asarray(positions, dtype="f8")
        if rows.ndim != 2:
            raise ConfigError(f"shape {rows.shape}", expected="(N, 2) or (N, 3)", key="positions")
        return [self.add_node(row, **settings) for row in rows]

    def add_bar(
        self,
        node_i: SupportsIndex,
        node_j: SupportsIndex,
        *,
        stiffness: float,
        damping: float = 0.0,
        rest_length: float | None = None,
        prestress: float = 0.0,
        rigid: bool = False,
        law: BarLaw = "linear",
        stiffness_cubic: float = 0.0,
        damping_cubic: float = 0.0,
    ) -> int:
        """Add a bar and return its index.

        Parameters
        ----------
        node_i, node_j : int
        stiffness : float [N/m]
        damping : float [N*s/m]
            Along the bar.
        rest_length : float [m], optional
            The distance of the nodes unless given.
        prestress : float [1]
            The bar is relaxed at ``rest_length * (1 + prestress)``.
        rigid : bool
            The length is a constraint.
        law : {"linear", "cubic", "cable", "strut", "ogden"}
            See `openprc.schema.experiment.Bars`.
        stiffness_cubic : float [N/m3]
        damping_cubic : float [N*s3/m3]
            For the law "cubic" only.
        """
        i, j = self.node_index(node_i), self.node_index(node_j)
        if rest_length is None:
            ends = self._nodes[i]["position"], self._nodes[j]["position"]
            rest_length = float(np.linalg.norm(ends[1] - ends[0]))
        self._bars.append(
            {
                "indices": [i, j],
                "stiffness": number(stiffness, "stiffness"),
                "damping": number(damping, "damping"),
                "rest_length": number(rest_length, "rest_length"),
                "prestress": number(prestress, "prestress"),
                "rigid": bool(rigid),
                "law": str(law),
                "stiffness_cubic": number(stiffness_cubic, "stiffness_cubic"),
                "damping_cubic": number(damping_cubic, "damping_cubic"),
            }
        )
        return len(self._bars) - 1

    def add_hinge(
        self,
        nodes: Sequence[SupportsIndex],
        *,
        stiffness: float,
        rest_angle: float | None = None,
        damping: float = 0.0,
        rigid: bool = False,
        law: HingeLaw = "linear",
        limits: Sequence[float] | None = None,
    ) -> int:
        """Add a hinge and return its index.

        Parameters
        ----------
        nodes : [j, k, i, l]
            The crease j-k first, then the wings i and l.
        stiffness : float [N*m/rad]
        rest_angle : float [rad], optional
            pi is flat; the angle of the nodes as they are now unless given.
        damping : float [N*m*s/rad]
        rigid : bool
            The angle is a constraint.
        law : {"linear", "enhanced-linear", "four-thirds"}
            See `openprc.schema.experiment.Hinges`.
        limits : (low, high) [rad], optional
            Angles between which the hinge is linear; pi/4 and 7 pi/4 for "enhanced-linear",
            none for "linear".
        """
        if len(nodes) != 4:
            raise ConfigError(
                f"a hinge with {len(nodes)} nodes", expected="four: [j, k, i, l]", key="nodes"
            )
        indices = [self.node_index(node) for node in nodes]
        if rest_angle is None:
            hinge = Hinges(indices=[indices], stiffness=[0.0], rest_angle=[0.0])
            rows = np.array([[node["position"] for node in self._nodes]])
            rest_angle = float(hinge_angles(rows, hinge)[0, 0])
        if limits is None:
            limits = (np.pi / 4, 7 * np.pi / 4) if law == "enhanced-linear" else (0.0, FULL_TURN)
        if len(limits) != 2:
            raise ConfigError(f"limits {limits}", expected="two angles: low, high", key="limits")
        low, high = limits
        self._hinges.append(
            {
                "indices": indices,
                "stiffness": number(stiffness, "stiffness"),
                "rest_angle": number(rest_angle, "rest_angle"),
                "damping": number(damping, "damping"),
                "rigid": bool(rigid),
                "law": str(law),
                "limit_low": number(low, "limits"),
                "limit_high": number(high, "limits"),
            }
        )
        return len(self._hinges) - 1

    def add_bend(
        self,
        nodes: Sequence[SupportsIndex],
        *,
        stiffness: float,
        rest_angle: float | None = None,
        damping: float = 0.0,
    ) -> int:
        """Add a bending spring between two arms that meet at a node, and return its index.

        Parameters
        ----------
        nodes : [end, vertex, end]
        stiffness : float [N*m/rad]
            ``E I / l`` for a rod cut into segments of length l.
        rest_angle : float [rad], optional
            pi is straight; the angle of the nodes as they are now unless given.
        damping : float [N*m*s/rad]
        """
        if len(nodes) != 3:
            raise ConfigError(
                f"a bend with {len(nodes)} nodes",
                expected="three: [end, vertex, end]",
                key="nodes",
            )
        indices = [self.node_index(node) for node in nodes]
        if rest_angle is None:
            rows = np.array([[node["position"] for node in self._nodes]])
            rest_angle = float(bend_angles(rows, np.array([indices]))[0, 0])
            # Three nodes on a line are straight, whatever rounding makes of them.
            rest_angle = np.pi if np.pi - rest_angle < COLLINEAR else rest_angle
        self._bends.append(
            {
                "indices": indices,
                "stiffness": number(stiffness, "stiffness"),
                "rest_angle": number(rest_angle, "rest_angle"),
                "damping": number(damping, "damping"),
            }
        )
        return len(self._bends) - 1

    def add_face(self, nodes: Sequence[SupportsIndex]) -> int:
        """Add a triangle for display and return its index; it has no mechanics."""
        if len(nodes) != 3:
            raise ConfigError(f"a face with {len(nodes)} nodes", expected="three", key="nodes")
        self._faces.append([self.node_index(node) for node in nodes])
        return len(self._faces) - 1

    def geometry(self) -> Geometry:
        """Return what has been collected, unchecked.

        Raises
        ------
        ConfigError
            When some nodes have a label and others have none.
        """
        nodes = self._nodes
        labels = [node["label"] for node in nodes]
        if any(labels) and not all(labels):
            raise ConfigError(
                f"node {labels.index(None)} has no label and others have one",
                expected="labels for all nodes, or for none",
                key="nodes/label",
            )
        return Geometry(
            positions=np.array([node["position"] for node in nodes]).reshape(-1, 3),
            masses=np.array([node["mass"] for node in nodes]),
            fixed=np.array([node["fixed"] for node in nodes], dtype=bool),
            collidable=np.array([node["collidable"] for node in nodes], dtype=bool),
            velocities=np.array([node["velocity"] for node in nodes]).reshape(-1, 3),
            labels=tuple(labels) if any(labels) else None,
            bars=Bars(**_columns(self._bars)),
            hinges=Hinges(**_columns(self._hinges)),
            bends=Bends(**_columns(self._bends)),
            faces=np.array(self._faces, dtype="i4"),
        )

    def take_geometry(self, geometry: Geometry) -> None:
        """Begin with the nodes and elements of `geometry`."""
        labels = geometry.labels or (None,) * geometry.n_nodes
        self._nodes = [
            {
                "position": np.array(geometry.positions[n]),
                "mass": float(geometry.masses[n]),
                "fixed": bool(geometry.fixed[n]),
                "collidable": bool(geometry.collidable[n]),
                "velocity": np.array(geometry.velocities[n]),
                "label": labels[n],
            }
            for n in range(geometry.n_nodes)
        ]
        self._bars = _rows(geometry.bars, _BAR_COLUMNS)
        self._hinges = _rows(geometry.hinges, _HINGE_COLUMNS)
        self._bends = _rows(geometry.bends, _BEND_COLUMNS)
        self._faces = [list(map(int, face)) for face in geometry.faces]

    def node_index(self, node: SupportsIndex) -> int:
        """Return `node` as a plain int, having checked that there is such a node."""
        try:
            index = operator.index(node)
        except TypeError:
            index = -1
        if isinstance(node, bool | np.bool_) or not 0 <= index < len(self._nodes):
            raise ConfigError(
                f"node {node!r}",
                expected=f"a node from 0 to {len(self._nodes) - 1}"
                if self._nodes
                else "a node that was added before",
                fix="use the numbers that add_node() returned",
                key="node",
            )
        return index


_BAR_COLUMNS = tuple(column.name for column in fields(Bars))
_HINGE_COLUMNS = tuple(column.name for column in fields(Hinges))
_BEND_COLUMNS = tuple(column.name for column in fields(Bends))


def _columns(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {key: np.array([row[key] for row in rows]) for key in (rows[0] if rows else ())}


def _rows(elements: Bars | Hinges | Bends, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    table = {key: getattr(elements, key).tolist() for key in columns}
    return [{key: table[key][e] for key in columns} for e in range(len(elements))]


def _vector(values: ArrayLike, key: str) -> NDArray[np.float64]:
    vector = np.array(values, dtype="f8")
    if vector.shape == (2,):
        vector = np.append(vector, 0.0)
    if vector.shape != (3,):
        raise ConfigError(
            f"shape {vector.shape}", expected="(3,), or (2,) for a node at z = 0", key=key
        )
    return vector


def number(value: Any, key: str) -> float:
    """Return one number as a float, numpy scalars included; `key` is named in the message."""
    array = np.asarray(value)
    if array.ndim != 0 or array.dtype.kind not in "fiu":
        raise ConfigError(f"found {value!r}", expected="one number", key=key)
    return float(array)
