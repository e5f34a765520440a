"""Edges of a FOLD file: which bar, which hinge, which assignment, and which sense."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from openprc_merlin import geometry
from openprc_merlin.topology import BEND

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Rest angles closer to flat than this are flat [rad].
FLAT = 1e-9


@dataclass(frozen=True)
class Creases:
    """Edges with what FOLD says about them.

    Attributes
    ----------
    edges : (E, 2), the bars first, then sides of faces that carry none
    assignments : E letters of B, M, V, F, U, J
    boundary : (E,) bool, sides of one face only
    faces : (F, 3), neighbours turned alike
    hinges : (H, 4), those whose crease is an edge between two faces
    edge_of_hinge : (H,) rows of `edges`
    sense : (H,) 1 or -1: the fold angle is `sense` times (pi - angle of the hinge)
    """

    edges: Ints
    assignments: tuple[str, ...]
    boundary: NDArray[np.bool_]
    faces: Ints
    hinges: Ints
    edge_of_hinge: Ints
    sense: Floats

    @property
    def is_folded(self) -> bool:
        """Whether an edge has a fold angle."""
        return len(self.hinges) > 0


def creases_of(trajectory: Trajectory) -> Creases:
    """Collect the edges of a trajectory.

    Valleys fold towards the side that sees the corners of the faces run counterclockwise. The
    angle of a hinge [j k i l] is the opening on that side where the face with i runs from j to
    k, so fold angles are ``pi - angle`` there and ``angle - pi`` elsewhere. Without a face on
    both sides there is no sense: those edges are U, or F where they rest flat.
    """
    kinds = trajectory.element_kinds
    faces = (
        geometry.orient(trajectory.indices("faces").astype(np.int64))
        if "faces" in kinds
        else np.zeros((0, 3), np.int64)
    )
    bars = trajectory.indices("bars").astype(np.int64) if "bars" in kinds else _no_rows(2)
    place = {tuple(sorted(pair)): row for row, pair in enumerate(bars.tolist())}
    wings: dict[tuple[int, int], dict[int, tuple[int, int]]] = {}
    sides: dict[tuple[int, int], int] = {}
    extra: list[tuple[int, int]] = []
    for face in faces.tolist():
        for (a, b), corner in zip(geometry.sides(face), (face[2], face[0], face[1]), strict=True):
            edge = (min(a, b), max(a, b))
            sides[edge] = sides.get(edge, 0) + 1
            wings.setdefault(edge, {})[corner] = (a, b)
            if edge not in place:
                place[edge] = len(bars) + len(extra)
                extra.append(edge)
    edges = np.concatenate([bars, np.array(extra, dtype=np.int64).reshape(-1, 2)])
    hinges = trajectory.indices("hinges").astype(np.int64) if "hinges" in kinds else _no_rows(4)
    assignments = ["U"] * len(edges)
    boundary = np.zeros(len(edges), dtype=bool)
    for edge, count in sides.items():
        if count == 1:
            assignments[place[edge]], boundary[place[edge]] = "B", True
    chosen: list[int] = []
    on: list[int] = []
    sense: list[float] = []
    rest = _static(trajectory, "rest_angle", len(hinges), np.nan)
    bend = _static(trajectory, "kind_code", len(hinges), -1) == BEND
    for row, (j, k, i, l) in enumerate(hinges.tolist()):  # noqa: E741
        edge = (min(j, k), max(j, k))
        if edge not in place:
            continue
        first, second = wings.get(edge, {}).get(i), wings.get(edge, {}).get(l)
        turned = 0.0
        if sides.get(edge) == 2 and first is not None and second is not None and first != second:
            turned = 1.0 if first == (j, k) else -1.0
            chosen.append(row)
            on.append(place[edge])
            sense.append(turned)
        assignments[place[edge]] = _letter(turned * (np.pi - rest[row]), rest[row], bend[row])
    return Creases(
        edges=edges,
        assignments=tuple(assignments),
        boundary=boundary,
        faces=faces,
        hinges=hinges[chosen],
        edge_of_hinge=np.array(on, dtype=np.int64),
        sense=np.array(sense),
    )


def _no_rows(width: int) -> Ints:
    return np.zeros((0, width), np.int64)


def _static(trajectory: Trajectory, name: str, count: int, default: float) -> Floats:
    if trajectory.has(f"/topology/hinges/{name}"):
        return np.asarray(trajectory.element_static("hinges", name), dtype=np.float64)
    return np.full(count, default)


def _letter(fold: float, rest: float, bend: bool) -> str:
    """Return the assignment of a crease from its fold angle at rest [rad], 0 without a sense."""
    if bend:
        return "J"
    if abs(rest - np.pi) <= FLAT:
        return "F"
    if fold > 0:
        return "V"
    return "M" if fold < 0 else "U"
