"""Bars, hinges, faces and supports of a workspace, in 0-based indices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import SchemaError
from openprc_merlin import geometry, histories

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Codes of bars and hinges: a boundary bar, a fold (crease), a bend (panel diagonal).
BOUNDARY, FOLD, BEND = 0, 1, 2


@dataclass(frozen=True)
class Hinges:
    """Hinges, bends before folds so that hinge b lies on bar b in MERLIN's order.

    Attributes
    ----------
    indices : (H, 4) crease j k, wings i l
    code : (H,) `FOLD` or `BEND`
    rest_angle : (H,) [rad] or None
    stiffness : (H,) moment per radian and unit length of crease, or None
    length : (H,) rest length of the crease
    """

    indices: Ints
    code: Ints
    rest_angle: Floats | None
    stiffness: Floats | None
    length: Floats


def indices(value: Any, width: int, n_nodes: int, *, key: str, file: Path) -> Ints | None:
    """Return 1-based node numbers as 0-based (E, width) int64; None when there are none.

    Raises
    ------
    SchemaError
        When they are not whole numbers between 1 and `n_nodes`, or not `width` a row.
    """
    if not isinstance(value, np.ndarray):
        return None
    if value.size == 0:
        return np.zeros((0, width), dtype=np.int64)
    table = value.reshape(1, -1) if value.ndim == 1 else value
    if table.ndim != 2 or table.shape[1] != width:
        raise SchemaError(
            f"shape {'x'.join(map(str, value.shape))}",
            expected=f"{width} node numbers a row",
            fix="save the workspace of the run again",
            file=file,
            key=key,
        )
    # What lies outside cannot be cast, and 0 is refused below.
    inside = np.abs(table) <= n_nodes
    numbers = np.round(np.where(inside, table.real, 0.0)).astype(np.int64)
    bad = (numbers != table) | (numbers < 1) | (numbers > n_nodes)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise SchemaError(
            f"node number {table[row, column]:g} in row {row + 1}",
            expected=f"whole numbers from 1 to {n_nodes}",
            fix="MERLIN counts nodes from 1; add 1 if another program wrote the file",
            file=file,
            key=key,
        )
    return numbers - 1


def vector(value: Any, length: int | None, *, key: str, file: Path) -> Floats | None:
    """Return a real vector of `length`; one number stands for all of them."""
    if not isinstance(value, np.ndarray) or length is None or (value.size == 0 and length > 0):
        return None
    if length == 0:
        return np.zeros(0)
    vector, _ = histories.real(value.ravel(), key=key, file=file)
    if vector.size == 1:
        vector = np.full(length, vector[0])
    bad = ~(np.abs(vector) < histories.PLAUSIBLE)
    if vector.size != length or bad.any():
        raise SchemaError(
            f"{vector.size} values, {int(bad.sum())} of them not finite",
            expected=f"{length} finite numbers",
            fix="save the workspace of the run again",
            file=file,
            key=key,
        )
    return vector


def held_dofs(
    truss: Mapping[str, Any], variables: Mapping[str, Any], *, n_nodes: int, file: Path
) -> NDArray[np.bool_]:
    """Return the supported degrees of freedom from FixedDofs, else from Supp."""
    held = np.zeros(3 * n_nodes, dtype=bool)
    fixed = truss.get("FixedDofs")
    if isinstance(fixed, np.ndarray):
        dofs = indices(fixed.reshape(-1, 1), 1, 3 * n_nodes, key="truss.FixedDofs", file=file)
        held[dofs] = True
        return held.reshape(n_nodes, 3)
    supports = variables.get("Supp")
    if isinstance(supports, np.ndarray) and supports.ndim == 2 and supports.shape[1] == 4:
        nodes = indices(supports[:, :1], 1, n_nodes, key="Supp", file=file)
        table = held.reshape(n_nodes, 3)
        for node, flags in zip(np.ravel(nodes), supports[:, 1:] != 0, strict=True):
            table[node] |= flags
    return held.reshape(n_nodes, 3)


def elements(
    truss: Mapping[str, Any],
    angles: Mapping[str, Any],
    *,
    bars: Ints | None,
    nodes: Floats,
    file: Path,
) -> tuple[Hinges | None, Floats | None, Ints | None, list[str]]:
    """Return hinges, bar lengths and bar codes."""
    notes: list[str] = []
    tables = {
        name: indices(angles.get(name), 4, len(nodes), key=f"angles.{name}", file=file)
        for name in ("bend", "fold")
    }
    bend, fold = (np.zeros((0, 4), np.int64) if t is None else t for t in tables.values())
    rows = np.concatenate([bend, fold])
    code = np.repeat([BEND, FOLD], [len(bend), len(fold)])
    length = bar_code = None
    if bars is not None:
        measured = geometry.bar_lengths(nodes[None], bars)[0]
        length = vector(truss.get("L"), len(bars), key="truss.L", file=file)
        if length is None:
            length = measured
            notes.append("truss.L is missing; rest lengths are the distances in truss.Node")
        if not (length > 1 / histories.PLAUSIBLE).all():
            raise SchemaError(
                f"bar {int(np.argmin(length)) + 1} has rest length {length.min():g}",
                expected="lengths above 0",
                fix="remove double nodes from the pattern",
                file=file,
                key="truss.L",
            )
        off = np.abs(length - measured) > 1e-6 * length
        if off.any():
            notes.append(
                f"{int(off.sum())} rest lengths in truss.L differ from the distances in truss.Node"
            )
        bar_code = np.zeros(len(bars), dtype=np.int64)
    if not len(rows):
        return None, length, bar_code, notes
    crease = geometry.bar_lengths(nodes[None], rows[:, :2])[0]
    if bars is not None and length is not None and bar_code is not None:
        place = {tuple(sorted(pair)): b for b, pair in enumerate(bars.tolist())}
        on = np.array([place.get(tuple(sorted(pair)), -1) for pair in rows[:, :2].tolist()])
        bar_code[on[on >= 0]] = code[on >= 0]
        crease[on >= 0] = length[on[on >= 0]]
        if (on < 0).any():
            notes.append(f"{int((on < 0).sum())} hinges lie on no bar")
    rest, stiffness = (
        _pair(angles, keys, (len(bend), len(fold)), file)
        for keys in ((("pb0",), ("pf0",)), (("kpb", "Kb"), ("kpf", "Kf")))
    )
    return Hinges(rows, code, rest, stiffness, crease), length, bar_code, notes


def _pair(
    angles: Mapping[str, Any],
    keys: tuple[tuple[str, ...], tuple[str, ...]],
    counts: tuple[int, int],
    file: Path,
) -> Floats | None:
    """Join a property of bends and folds; None unless both are known."""
    parts = []
    for names, count in zip(keys, counts, strict=True):
        name = next((name for name in names if name in angles), names[0])
        part = vector(angles.get(name), count, key=f"angles.{name}", file=file)
        if part is None and count:
            return None
        parts.append(np.zeros(0) if part is None else part)
    return np.concatenate(parts)


def triangles(
    truss: Mapping[str, Any],
    variables: Mapping[str, Any],
    *,
    n_nodes: int,
    file: Path,
) -> tuple[Ints | None, list[str]]:
    """Return the triangles of truss.Trigl, else the panels cut into fans."""
    triangles = indices(truss.get("Trigl"), 3, n_nodes, key="truss.Trigl", file=file)
    if triangles is not None and len(triangles):
        return triangles, []
    angles = variables.get("angles")
    inner = angles.get("Panel") if isinstance(angles, dict) else None
    both = (_as_rows(variables.get("Panel")), _as_rows(inner))
    panels = next((p for p in both if p is not None), None)
    if not panels:
        return None, []
    rows: list[tuple[int, int, int]] = []
    for number, panel in enumerate(panels, start=1):
        if not isinstance(panel, np.ndarray) or panel.size < 3:
            continue
        corners = indices(
            panel.reshape(1, -1), panel.size, n_nodes, key=f"Panel{{{number}}}", file=file
        )
        if corners is not None:
            rows += geometry.fan(corners[0].tolist())
    note = "truss.Trigl is missing; panels were cut into triangles from their first corner"
    cut = any(isinstance(panel, np.ndarray) and panel.size > 3 for panel in panels)
    return np.array(rows, dtype=np.int64).reshape(-1, 3), [note] if cut else []


def _as_rows(panels: Any) -> list[Any] | None:
    """Return the panels one by one; a matrix has one in each row, shorter ones filled with NaN."""
    if isinstance(panels, np.ndarray) and panels.ndim == 2 and panels.shape[1] >= 3:
        return [row[np.isfinite(row)] for row in panels]
    return panels if isinstance(panels, list) else None
