"""A MERLIN or MERLIN2 workspace as one checked, frozen record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, SchemaError
from openprc_merlin import histories, topology
from openprc_merlin.topology import Hinges

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Load:
    """The load history and what it acts on.

    Attributes
    ----------
    mode : "force", "displacement" or "unknown"
        In force mode `history` is the load factor: the force is factor times `reference`.
        In displacement mode it is minus the force applied at each imposed degree of freedom.
    history : (T, C), or None where it was left out
    dofs : (C,) int, the loaded degrees of freedom (0-based), ascending
    reference : (3N,) or None
    name : str
        The variable.
    """

    mode: Literal["force", "displacement", "unknown"]
    history: Floats | None
    dofs: Ints
    reference: Floats | None
    name: str


@dataclass(frozen=True)
class Workspace:
    """What a saved run holds, in 0-based indices and float64.

    Attributes
    ----------
    solver : 1 (MERLIN), 2 (MERLIN2) or 0 (not told)
    nodes : (N, 3) coordinates that the displacements are counted from
    start : (N, 3) displacement of the initial state, ``truss.U0``
    displacements : (T, N, 3) after every converged increment
    n_input_nodes : int, nodes the user gave; the rest are panel centres of the N5B8 model
    held : (N, 3) bool, supported degrees of freedom
    bars : (M, 2) or None; bar_length, bar_area : (M,) or None; bar_code : (M,)
    hinges : Hinges or None
    faces : (F, 3) or None
    variables : every variable of the file as plain values
    skipped : columns of the histories before the first increment, 1 where they begin with the
        initial state
    """

    file: Path
    solver: int
    nodes: Floats
    start: Floats
    displacements: Floats
    n_input_nodes: int
    held: NDArray[np.bool_]
    bars: Ints | None
    bar_length: Floats | None
    bar_area: Floats | None
    bar_code: Ints | None
    hinges: Hinges | None
    faces: Ints | None
    load: Load
    variables: Mapping[str, Any]
    skipped: int = 0
    notes: tuple[str, ...] = ()

    @property
    def n_nodes(self) -> int:
        """Nodes of the bar-and-hinge model."""
        return len(self.nodes)

    @property
    def n_increments(self) -> int:
        """Converged increments; the trajectory has one frame more, the initial state."""
        return len(self.displacements)


def build(
    variables: Mapping[str, Any],
    *,
    file: Path,
    displacement: str | None = None,
    load: str | None = None,
) -> Workspace:
    """Check the variables of a file and arrange them.

    Parameters
    ----------
    variables : mapping of name to plain value, as `containers.read` returns them
    file : path
        What errors name.
    displacement, load : str, optional
        Names of the histories, where they cannot be told.

    Raises
    ------
    MissingData
        When rest coordinates or the displacement history are not there.
    SchemaError
        When sizes, indices or values contradict each other.
    """
    truss, angles = _struct(variables, "truss"), _struct(variables, "angles")
    notes: list[str] = []
    nodes = _nodes(truss, variables, file)
    name, found = histories.find_displacement(
        variables, n_nodes=len(nodes), name=displacement, file=file
    )
    notes += found
    raw, found = histories.real(variables[name], key=name, file=file)
    notes += found
    u, found = histories.by_increment(
        raw, n_nodes=len(nodes), key=name, file=file, hint=_row_hint(raw, variables, truss)
    )
    notes += found
    stored = len(u)
    length, found = histories.finite_length(u, key=name, file=file)
    notes += found
    history, load_name, found = histories.find_load(
        variables, n_increments=stored, name=load, exclude=name, file=file
    )
    notes += found
    u, history = u[:length], None if history is None else history[:length]
    if history is not None and not (np.abs(history) < histories.PLAUSIBLE).all():
        raise SchemaError(
            f"{int((~(np.abs(history) < histories.PLAUSIBLE)).sum())} values that are not finite",
            expected="a load for every converged increment",
            fix="save the run again, or leave the load out with load=none",
            file=file,
            key=load_name,
        )
    start, skipped = _start(truss, len(nodes), file), 0
    if len(u) > 1 and np.array_equal(u[0], start):
        u, history, skipped = u[1:], None if history is None else history[1:], 1
        notes.append(f"{name} begins with the initial state, which is frame 0 here")
    bars = topology.indices(truss.get("Bars"), 2, len(nodes), key="truss.Bars", file=file)
    held = topology.held_dofs(truss, variables, n_nodes=len(nodes), file=file)
    hinges, bar_length, bar_code, found = topology.elements(
        truss, angles, bars=bars, nodes=nodes, file=file
    )
    notes += found
    faces, found = topology.triangles(truss, variables, n_nodes=len(nodes), file=file)
    user_nodes = variables.get("Node")
    n_input = len(user_nodes) if isinstance(user_nodes, np.ndarray) else len(nodes)
    return Workspace(
        file=file,
        solver=_solver(variables, angles),
        nodes=nodes,
        start=start,
        displacements=u,
        n_input_nodes=min(n_input, len(nodes)),
        held=held,
        bars=bars,
        bar_length=bar_length,
        bar_area=topology.vector(
            truss.get("A"), None if bars is None else len(bars), key="truss.A", file=file
        ),
        bar_code=bar_code,
        hinges=hinges,
        faces=faces,
        load=_load(variables, history, load_name, len(nodes)),
        variables=variables,
        skipped=skipped,
        notes=tuple(notes + found),
    )


def _struct(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = variables.get(name)
    return value if isinstance(value, dict) else {}


def _nodes(truss: Mapping[str, Any], variables: Mapping[str, Any], file: Path) -> Floats:
    """Return truss.Node, which holds the centres of N5B8 panels; else Node."""
    for owner, key in ((truss, "truss.Node"), (variables, "Node")):
        value = owner.get("Node")
        if isinstance(value, np.ndarray):
            nodes, _ = histories.real(value, key=key, file=file)
            if nodes.ndim != 2 or nodes.shape[1] != 3 or not len(nodes):
                raise SchemaError(
                    f"shape {'x'.join(map(str, nodes.shape))}",
                    expected="N x 3 coordinates",
                    fix="save the workspace of the run again",
                    file=file,
                    key=key,
                )
            if not (np.abs(nodes) < histories.PLAUSIBLE).all():
                raise SchemaError(
                    "NaN, infinite or huge coordinates",
                    expected="finite rest coordinates",
                    fix="save the workspace of the run again",
                    file=file,
                    key=key,
                )
            return nodes
    histories_held = [
        f"{key} ({'x'.join(map(str, value.shape))})"
        for key, value in variables.items()
        if isinstance(value, np.ndarray) and (value.ndim == 3 or histories.is_displacement(key))
    ]
    raise MissingData(
        f"no rest coordinates beside {', '.join(histories_held) or 'what the file holds'}; "
        "a displacement history alone does not say where the nodes are",
        expected="truss.Node (or Node) in the same file",
        fix="save truss and angles as well, or give the coordinates with reference=FILE "
        "(N x 3: mat, h5, obj, npz or csv)",
        file=file,
        key="truss.Node",
    )


def _row_hint(raw: NDArray[Any], variables: Mapping[str, Any], truss: Mapping[str, Any]) -> str:
    nodes, panels = variables.get("Node"), variables.get("Panel")
    if truss or not isinstance(nodes, np.ndarray) or not isinstance(panels, list):
        return ""
    centres = sum(isinstance(panel, np.ndarray) and panel.size > 3 for panel in panels)
    if centres and 3 * (len(nodes) + centres) in raw.shape:
        return (
            f"the N5B8 model appends a centre node to each of the {centres} panels: "
            "save truss as well, whose Node holds them"
        )
    return ""


def _start(truss: Mapping[str, Any], n_nodes: int, file: Path) -> Floats:
    u0 = topology.vector(truss.get("U0"), 3 * n_nodes, key="truss.U0", file=file)
    return np.zeros((n_nodes, 3)) if u0 is None else u0.reshape(n_nodes, 3)


def _solver(variables: Mapping[str, Any], angles: Mapping[str, Any]) -> int:
    if "kpf" in angles or "LF_his" in variables or "Data" in variables:
        return 1
    if "AnalyInputOpt" in variables or "Kf" in angles or "Fhis" in variables:
        return 2
    return 0


def _load(variables: Mapping[str, Any], history: Floats | None, name: str, n_nodes: int) -> Load:
    settings = _struct(variables, "AnalyInputOpt")
    reference = None
    for value in (settings.get("Load"), variables.get("F")):
        if isinstance(value, np.ndarray) and value.size == 3 * n_nodes:
            reference = np.asarray(value.real, dtype=np.float64).ravel()
            break
    table = variables.get("Load")
    if reference is None and isinstance(table, np.ndarray) and table.shape[1:] == (4,):
        numbers = np.round(table[:, 0].real).astype(np.int64) - 1
        if ((numbers >= 0) & (numbers < n_nodes)).all():
            vectors = np.zeros((n_nodes, 3))
            np.add.at(vectors, numbers, table[:, 1:].real)
            reference = vectors.ravel()
    dofs = np.zeros(0, np.int64) if reference is None else np.flatnonzero(reference)
    kind = settings.get("LoadType")
    mode: Literal["force", "displacement", "unknown"] = "unknown"
    if isinstance(kind, str):
        mode = "displacement" if kind.lower().startswith("disp") else "force"
    elif _solver(variables, _struct(variables, "angles")) == 1:
        mode = "force"
    elif history is not None and history.shape[1] > 1:
        mode = "displacement"
    return Load(mode, history, dofs, reference, name)
