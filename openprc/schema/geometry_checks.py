"""Checks of a geometry: each finds all mistakes of its kind and says where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from openprc.schema.bend_angle import bend_angles
from openprc.schema.geometry import (
    BAR_LAWS,
    FULL_TURN,
    HINGE_LAWS,
    Bars,
    Bends,
    Geometry,
    Hinges,
)
from openprc.schema.mistakes import Mistakes, list_some

if TYPE_CHECKING:
    from numpy.typing import NDArray


def check_geometry(
    geometry: Geometry, mistakes: Mistakes, *, driven: NDArray[np.bool_] | None = None
) -> None:
    """Check nodes, bars, hinges, bends and faces.

    Parameters
    ----------
    driven : (N,) bool, optional
        Nodes whose position is prescribed on all axes; like fixed nodes they may have no mass.
    """
    if not _check_nodes(geometry, mistakes, driven):
        return
    n_nodes = geometry.n_nodes
    if _check_columns("elements/bars", geometry.bars, 2, _BAR_COLUMNS, mistakes):
        _check_bars(geometry.bars, geometry, mistakes)
    if _check_columns("elements/hinges", geometry.hinges, 4, _HINGE_COLUMNS, mistakes):
        _check_indices("elements/hinges", geometry.hinges.indices, n_nodes, mistakes)
        _check_hinges(geometry.hinges, mistakes)
    if _check_columns("elements/bends", geometry.bends, 3, _BEND_COLUMNS, mistakes):
        _check_bends(geometry.bends, geometry, mistakes)
    faces = geometry.faces
    if faces.ndim != 2 or faces.shape[1] != 3:
        mistakes.add("elements/faces/indices", f"shape {faces.shape}", expected="(F, 3)")
    else:
        _check_indices("elements/faces", faces, n_nodes, mistakes)


_BAR_COLUMNS = (
    *("stiffness", "rest_length", "damping", "prestress", "rigid", "law"),
    *("stiffness_cubic", "damping_cubic"),
)
#: A bend within this angle of straight or folded back is taken to be there [rad].
COLLINEAR = 1e-9
_BEND_COLUMNS = ("stiffness", "rest_angle", "damping")
_HINGE_COLUMNS = (
    *("stiffness", "rest_angle", "damping", "rigid", "law", "limit_low", "limit_high"),
)


def _check_nodes(geometry: Geometry, mistakes: Mistakes, driven: NDArray[np.bool_] | None) -> bool:
    n = geometry.n_nodes
    before = len(mistakes.found)
    if n == 0:
        mistakes.add("nodes/positions", "no nodes", expected="at least one node")
        return False
    for key, values, shape in (
        ("positions", geometry.positions, (n, 3)),
        ("velocities", geometry.velocities, (n, 3)),
        ("masses", geometry.masses, (n,)),
        ("fixed", geometry.fixed, (n,)),
        ("collidable", geometry.collidable, (n,)),
    ):
        if values.shape != shape:
            mistakes.add(f"nodes/{key}", f"shape {values.shape}", expected=f"{shape}")
        elif not (finite := np.isfinite(values.reshape(n, -1)).all(axis=1)).all():
            mistakes.add(
                f"nodes/{key}",
                f"NaN or infinity at node {list_some(np.flatnonzero(~finite))}",
                expected="finite numbers",
            )
    if geometry.labels is not None and len(geometry.labels) != n:
        mistakes.add("nodes/label", f"{len(geometry.labels)} labels", expected=f"{n}, one a node")
    elif geometry.labels is not None and len(set(geometry.labels)) < n:
        double = next(text for text in geometry.labels if geometry.labels.count(text) > 1)
        mistakes.add("nodes/label", f"the label {double!r} twice", expected="unique labels")
    if len(mistakes.found) > before:
        return False
    held = geometry.fixed if driven is None else geometry.fixed | driven
    bad = np.flatnonzero((geometry.masses < 0) | ((geometry.masses == 0) & ~held))
    if len(bad):
        mistakes.add(
            "nodes/masses",
            f"mass {geometry.masses[bad[0]]:g} kg at node {list_some(bad)}",
            expected="a positive mass at every node that can move",
            fix="give the node a mass, or fix it",
        )
    moving = np.flatnonzero(geometry.fixed & geometry.velocities.any(axis=1))
    if len(moving):
        mistakes.add(
            "nodes/velocities",
            f"fixed node {list_some(moving)} has a velocity",
            expected="0 at fixed nodes",
        )
    return True


def _check_columns(
    group: str,
    elements: Bars | Hinges | Bends,
    width: int,
    columns: tuple[str, ...],
    mistakes: Mistakes,
) -> bool:
    before = len(mistakes.found)
    indices = elements.indices
    if indices.ndim != 2 or indices.shape[1] != width:
        mistakes.add(f"{group}/indices", f"shape {indices.shape}", expected=f"(E, {width})")
        return False
    for key in columns:
        values = getattr(elements, key)
        if values.shape != (len(indices),):
            mistakes.add(f"{group}/{key}", f"shape {values.shape}", expected=f"({len(indices)},)")
        elif key == "law":
            _check_laws(group, values, mistakes)
        elif not (finite := np.isfinite(values)).all():
            mistakes.add(
                f"{group}/{key}",
                f"NaN or infinity at element {list_some(np.flatnonzero(~finite))}",
                expected="finite numbers",
            )
    return len(mistakes.found) == before


def _check_indices(
    group: str, indices: NDArray[np.int32], n_nodes: int, mistakes: Mistakes
) -> bool:
    outside = np.flatnonzero(((indices < 0) | (indices >= n_nodes)).any(axis=1))
    if len(outside):
        mistakes.add(
            f"{group}/indices",
            f"element {list_some(outside)} names node {indices[outside[0]].tolist()}",
            expected=f"node numbers from 0 to {n_nodes - 1}",
        )
        return False
    ordered = np.sort(indices, axis=1)
    repeated = np.flatnonzero((np.diff(ordered, axis=1) == 0).any(axis=1))
    if len(repeated):
        mistakes.add(
            f"{group}/indices",
            f"element {list_some(repeated)} uses a node twice: {indices[repeated[0]].tolist()}",
            expected=f"{indices.shape[1]} different nodes",
        )
        return False
    return True


def _check_laws(group: str, laws: NDArray[np.str_], mistakes: Mistakes) -> None:
    known: tuple[str, ...] = BAR_LAWS if group.endswith("bars") else HINGE_LAWS
    unknown = np.flatnonzero(~np.isin(laws, known))
    if len(unknown):
        mistakes.add(
            f"{group}/law",
            f"{str(laws[unknown[0]])!r} at element {list_some(unknown)}",
            expected="one of " + ", ".join(known),
        )


def _check_hinges(hinges: Hinges, mistakes: Mistakes) -> None:
    group = "elements/hinges"
    for key in ("stiffness", "damping"):
        _check_not_negative(f"{group}/{key}", getattr(hinges, key), mistakes)
    low, high = hinges.limit_low, hinges.limit_high
    bad = np.flatnonzero((low < 0.0) | (high > FULL_TURN) | (low >= high))
    if len(bad):
        e = bad[0]
        mistakes.add(
            f"{group}/limit_low",
            f"limits {low[e]:g} and {high[e]:g} rad at element {list_some(bad)}",
            expected="0 <= limit_low < limit_high <= 2 pi",
        )
        return
    walls = (hinges.law == "enhanced-linear") & ((low <= 0.0) | (high >= FULL_TURN))
    outside = (hinges.law == "enhanced-linear") & (
        (hinges.rest_angle < low) | (hinges.rest_angle > high)
    )
    bounded = (hinges.law == "four-thirds") & hinges.limited
    for law, which, what, wanted in (
        (
            "enhanced-linear",
            walls,
            "no limits",
            "limits between 0 and 2 pi, such as pi/4 and 7 pi/4",
        ),
        (
            "enhanced-linear",
            outside,
            "a rest angle outside its limits",
            "limit_low <= rest_angle <= limit_high",
        ),
        ("four-thirds", bounded, "limits", "none: limit_low 0 and limit_high 2 pi"),
    ):
        if which.any():
            mistakes.add(
                f"{group}/limit_low",
                f"{law} element {list_some(np.flatnonzero(which))} has {what}",
                expected=wanted,
            )


def _check_bends(bends: Bends, geometry: Geometry, mistakes: Mistakes) -> None:
    group = "elements/bends"
    for key in ("stiffness", "damping"):
        _check_not_negative(f"{group}/{key}", getattr(bends, key), mistakes)
    outside = np.flatnonzero((bends.rest_angle <= 0.0) | (bends.rest_angle > np.pi))
    if len(outside):
        mistakes.add(
            f"{group}/rest_angle",
            f"{bends.rest_angle[outside[0]]:g} rad at element {list_some(outside)}",
            expected="an angle above 0 and up to pi, which is straight",
        )
    if not _check_indices(group, bends.indices, geometry.n_nodes, mistakes):
        return
    ends = geometry.positions[bends.indices]
    short = (ends == ends[:, 1:2]).all(axis=2)[:, [0, 2]].any(axis=1)
    if short.any():
        mistakes.add(
            f"{group}/indices",
            f"an arm of element {list_some(np.flatnonzero(short))} has no length",
            expected="a distance between the vertex and either end, else there is no angle",
        )
    angle = bend_angles(geometry.positions[np.newaxis], bends.indices)[0]
    folded = np.flatnonzero(~short & (angle < COLLINEAR))
    if len(folded):
        mistakes.add(
            f"{group}/indices",
            f"the arms of element {list_some(folded)} lie on each other",
            expected="an angle above 0 between them, else the bend has no plane",
        )
    straight = np.flatnonzero(
        ~short & (np.pi - angle < COLLINEAR) & (np.pi - bends.rest_angle > COLLINEAR)
    )
    if len(straight):
        mistakes.add(
            f"{group}/rest_angle",
            f"element {list_some(straight)} starts straight and rests at"
            f" {bends.rest_angle[straight[0]]:g} rad",
            expected="a start that shows to which side it bends",
            fix="move the vertex a little off the line between the ends",
        )


def _check_bars(bars: Bars, geometry: Geometry, mistakes: Mistakes) -> None:
    group = "elements/bars"
    for key in ("stiffness", "rest_length", "damping"):
        _check_not_negative(f"{group}/{key}", getattr(bars, key), mistakes)
    for key in ("stiffness_cubic", "damping_cubic"):
        _check_not_negative(f"{group}/{key}", getattr(bars, key), mistakes)
        stray = np.flatnonzero((getattr(bars, key) != 0) & (bars.law != "cubic"))
        if len(stray):
            mistakes.add(
                f"{group}/{key}",
                f"{getattr(bars, key)[stray[0]]:g} at element {list_some(stray)}, whose law is"
                f" {str(bars.law[stray[0]])!r}",
                expected="0 unless the law is 'cubic'",
            )
    ogden = np.flatnonzero((bars.law == "ogden") & (bars.relaxed_length <= 0))
    if len(ogden):
        mistakes.add(
            f"{group}/rest_length",
            f"ogden element {list_some(ogden)} is relaxed at length 0",
            expected="a length, since the law is in the stretch ratio",
        )
    below = np.flatnonzero(bars.prestress < -1.0)
    if len(below):
        mistakes.add(
            f"{group}/prestress",
            f"{bars.prestress[below[0]]:g} at element {list_some(below)}",
            expected="at least -1, since rest_length * (1 + prestress) is a length",
        )
    if len(bars) == 0 or not _check_indices(group, bars.indices, geometry.n_nodes, mistakes):
        return
    _, first, count = np.unique(
        np.sort(bars.indices, axis=1), axis=0, return_index=True, return_counts=True
    )
    twice = first[count > 1]
    if len(twice):
        mistakes.add(
            f"{group}/indices",
            f"several bars between nodes {bars.indices[twice[0]].tolist()}"
            f" (first: element {list_some(np.sort(twice))})",
            expected="one bar between two nodes",
            fix="merge them: stiffnesses and dampings of parallel bars add up",
        )
    ends = geometry.positions[bars.indices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    collapsed = np.flatnonzero((length == 0) & (bars.relaxed_length > 0))
    if len(collapsed):
        mistakes.add(
            f"{group}/indices",
            f"the nodes of element {list_some(collapsed)} are at one point",
            expected="a distance between them, else the bar has no direction",
        )


def _check_not_negative(key: str, values: NDArray[np.float64], mistakes: Mistakes) -> None:
    negative = np.flatnonzero(values < 0)
    if len(negative):
        mistakes.add(
            key,
            f"{values[negative[0]]:g} at element {list_some(negative)}",
            expected="0 or more",
        )
