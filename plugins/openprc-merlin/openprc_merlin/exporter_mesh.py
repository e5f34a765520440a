"""Nodes, bars, hinges and panels of a trajectory, in the order that MERLIN keeps them in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, UnsupportedScene
from openprc_merlin import geometry
from openprc_merlin.topology import BEND

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """A body in MERLIN's order, in 0-based indices.

    Attributes
    ----------
    rest : (N, 3), padded with z = 0 where the trajectory is planar
    bars : (M, 2), bends, then folds, then boundaries; bar b carries hinge b
    bar_rows : (M,) rows of these bars in the trajectory
    length : (M,) relaxed lengths
    hinges : (H, 4) crease, then wings; bends before folds
    hinge_rows : (H,) rows of these hinges in the trajectory
    n_bends : int
    faces : (F, 3), neighbours turned alike
    panels : polygons of corners; bends cut them into triangles
    n_input : int, nodes that are no centre of a panel; the centres come last
    notes : what a reader should know
    """

    rest: Floats
    bars: Ints
    bar_rows: Ints
    length: Floats
    hinges: Ints
    hinge_rows: Ints
    n_bends: int
    faces: Ints
    panels: tuple[tuple[int, ...], ...]
    n_input: int
    notes: tuple[str, ...]


def build(trajectory: Trajectory, *, rest: str) -> Mesh:
    """Collect and order what MERLIN needs of the body.

    Parameters
    ----------
    trajectory : Trajectory
    rest : {"stored", "first"}
        Which shape is free of stress.

    Raises
    ------
    MissingData
        When there are no nodes, bars, faces or rest shape.
    UnsupportedScene
        When MERLIN has no place for an element.
    """
    file = trajectory.path
    if not trajectory.n_nodes:
        raise _missing(trajectory, "no nodes", "positions", "/time_series/nodes/positions")
    shape, notes = _rest(trajectory, rest)
    if "bars" not in trajectory.element_kinds or not len(trajectory.indices("bars")):
        raise _missing(
            trajectory, "no bars", "bars, which MERLIN calls truss.Bars", "/topology/bars"
        )
    if "bends" in trajectory.element_kinds and len(trajectory.indices("bends")):
        raise UnsupportedScene(
            f"{len(trajectory.indices('bends'))} bends (springs between two bars of a chain)",
            expected="bars and hinges, the elements of MERLIN",
            fix="export another body, or one without them",
            file=file,
            key="/topology/bends",
        )
    bars = trajectory.indices("bars").astype(np.int64)
    hinges, order, n_bends = _hinges(trajectory)
    bars_at = {tuple(sorted(pair)): b for b, pair in enumerate(bars.tolist())}
    creases = [tuple(sorted(pair)) for pair in hinges[:, :2].tolist()]
    carried = _carriers(creases, bars_at, order, trajectory)
    rows = np.concatenate([carried, np.setdiff1d(np.arange(len(bars)), carried)]).astype(np.int64)
    faces, found = _faces(trajectory, hinges)
    notes += found
    bends = set(creases[:n_bends])
    panels, n_input = merged_panels(faces, bends, n_nodes=len(shape))
    return Mesh(
        rest=shape,
        bars=bars[rows],
        bar_rows=rows,
        length=_lengths(trajectory, shape, bars)[rows],
        hinges=hinges,
        hinge_rows=order,
        n_bends=n_bends,
        faces=faces,
        panels=panels,
        n_input=n_input,
        notes=tuple(notes),
    )


def _missing(trajectory: Trajectory, found: str, expected: str, key: str) -> MissingData:
    return MissingData(
        found,
        expected=expected,
        fix="export a bar-and-hinge body: an imported MERLIN run, or a simulated sheet",
        file=trajectory.path,
        key=key,
    )


def padded(points: Floats) -> Floats:
    """Return (..., 3) points of (..., 2) or (..., 3) ones, z = 0 added."""
    if points.shape[-1] == 3:
        return points
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def _rest(trajectory: Trajectory, rest: str) -> tuple[Floats, list[str]]:
    notes = []
    if trajectory.dims == 2:
        notes.append("the body is planar: z is 0 and held at every node")
    if rest == "first":
        notes.append("Node is frame 0, which was said to be free of stress")
        return padded(trajectory.positions(slice(0, 1))[0]), notes
    if not trajectory.has("/topology/nodes/rest"):
        raise MissingData(
            "no rest shape",
            expected="the shape free of stress, which MERLIN calls truss.Node",
            fix="if frame 0 is free of stress, say so with the option rest=first",
            file=trajectory.path,
            key="/topology/nodes/rest",
        )
    return padded(np.asarray(trajectory.node("rest"), dtype=np.float64)), notes


def _has(trajectory: Trajectory, kind: str, name: str) -> bool:
    return bool(trajectory.has(f"/topology/{kind}/{name}"))


def _lengths(trajectory: Trajectory, rest: Floats, bars: Ints) -> Floats:
    """Return the length of every bar without force, in the unit of the positions."""
    if not _has(trajectory, "bars", "rest_length"):
        measured: Floats = geometry.bar_lengths(rest[None], bars)[0]
        return measured
    unit = trajectory.position_unit
    stored = trajectory.unit("/topology/bars/rest_length")
    converted = None if stored == unit else unit
    length: Floats = trajectory.element_static("bars", "rest_length", unit=converted).astype("f8")
    if _has(trajectory, "bars", "prestress"):
        length = length * (1.0 + trajectory.element_static("bars", "prestress"))
    return length


def _hinges(trajectory: Trajectory) -> tuple[Ints, Ints, int]:
    """Return hinges with bends first, their rows in the trajectory, and the number of bends."""
    if "hinges" not in trajectory.element_kinds:
        return np.zeros((0, 4), np.int64), np.zeros(0, np.int64), 0
    table = trajectory.indices("hinges").astype(np.int64)
    bend = np.zeros(len(table), dtype=bool)
    if _has(trajectory, "hinges", "kind_code"):
        bend = trajectory.element_static("hinges", "kind_code") == BEND
    elif _has(trajectory, "hinges", "law"):
        laws = trajectory.element_static("hinges", "law")
        bend = np.array([str(law) == "four-thirds" for law in laws], dtype=bool)
    order = np.concatenate([np.flatnonzero(bend), np.flatnonzero(~bend)])
    return table[order], order, int(bend.sum())


def _carriers(
    creases: list[tuple[int, ...]],
    bars_at: dict[tuple[int, ...], int],
    rows: Ints,
    trajectory: Trajectory,
) -> Ints:
    """Return the bar under every hinge.

    Raises
    ------
    UnsupportedScene
        When a crease carries none, or two hinges share one.
    """
    seen: set[tuple[int, ...]] = set()
    for crease, row in zip(creases, rows.tolist(), strict=True):
        wrong = "lies on no bar" if crease not in bars_at else "shares its bar with another one"
        if crease not in bars_at or crease in seen:
            raise UnsupportedScene(
                f"hinge {row} on nodes {crease[0]} and {crease[1]} {wrong}",
                expected="one bar under every hinge, and one hinge on a bar",
                fix="add the bar to the body, or take the second hinge away",
                file=trajectory.path,
                key="/topology/hinges/indices",
            )
        seen.add(crease)
    return np.array([bars_at[crease] for crease in creases], dtype=np.int64)


def _faces(trajectory: Trajectory, hinges: Ints) -> tuple[Ints, list[str]]:
    if "faces" in trajectory.element_kinds and len(trajectory.indices("faces")):
        return trajectory.indices("faces").astype(np.int64), []
    if not len(hinges):
        raise _missing(
            trajectory, "no faces", "triangles, which MERLIN calls truss.Trigl", "/topology/faces"
        )
    # A hinge is the crease of two triangles, so every triangle with a neighbour is known.
    triangles = np.concatenate([hinges[:, [0, 1, 2]], hinges[:, [1, 0, 3]]])
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    note = "the trajectory holds no faces: the triangles are those on both sides of the hinges"
    return geometry.orient(triangles[np.sort(first)]), [note]


def merged_panels(
    faces: Ints, bends: Iterable[tuple[int, ...]], *, n_nodes: int
) -> tuple[tuple[tuple[int, ...], ...], int]:
    """Join triangles over bends to the panels that were cut, and count the nodes given.

    Parameters
    ----------
    faces : (F, 3)
    bends : pairs of nodes, the smaller one first
    n_nodes : int

    Returns
    -------
    panels : polygons, each from its smallest corner on
    n_input : int
        Nodes before the centres that the N5B8 model appends; `n_nodes` where there are none.
    """
    rows = geometry.orient(faces).tolist()
    soft = set(bends)
    group = list(range(len(rows)))

    def root(number: int) -> int:
        while group[number] != number:
            group[number] = group[group[number]]
            number = group[number]
        return number

    at_edge: dict[tuple[int, int], int] = {}
    for number, row in enumerate(rows):
        for a, b in geometry.sides(row):
            edge = (min(a, b), max(a, b))
            if edge in soft:
                group[root(number)] = root(at_edge.setdefault(edge, number))
    members: dict[int, list[list[int]]] = {}
    for number, row in enumerate(rows):
        members.setdefault(root(number), []).append(row)
    panels: list[tuple[int, ...]] = []
    inner: set[int] = set()
    for triangles in members.values():
        loop = _outline(triangles)
        if loop is None:
            panels += [tuple(row) for row in triangles]
            continue
        panels.append(loop)
        inner |= {node for row in triangles for node in row} - set(loop)
    n_input = n_nodes - len(inner)
    if inner != set(range(n_input, n_nodes)):
        # Centres that do not come last are no centres of MERLIN's own.
        return tuple(tuple(row) for row in rows), n_nodes
    return tuple(panels), n_input


def _outline(triangles: list[list[int]]) -> tuple[int, ...] | None:
    """Return the corners around triangles turned alike, or None where there are several rounds."""
    directed = {pair for row in triangles for pair in geometry.sides(row)}
    after = {a: b for a, b in directed if (b, a) not in directed}
    rim = sum((b, a) not in directed for a, b in directed)
    start = min(after, default=None)
    if start is None or len(after) != rim:
        return None
    loop = [start]
    while (node := after.get(loop[-1])) != start:
        if node is None or len(loop) > rim:
            return None
        loop.append(node)
    return tuple(loop) if len(loop) == rim else None
