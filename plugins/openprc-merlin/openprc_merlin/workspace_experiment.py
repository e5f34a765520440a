"""A MERLIN workspace as an experiment: the same body, supports, laws and load, to be run again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import ConfigError, MissingData
from openprc.schema import UNITS, Experiment
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import FULL_TURN, Bars, Geometry, Hinges
from openprc_merlin import containers, material, verify, workspace
from openprc_merlin.topology import BEND

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc_merlin.material import Material
    from openprc_merlin.workspace import Workspace

    Floats = NDArray[np.float64]

#: Seconds per increment: an experiment has a time, although a quasi-static run has none.
INCREMENT = 1.0
_AXES = "xyz"
_Drive = tuple[Signal, tuple[Actuator, ...]]


@dataclass(frozen=True)
class _Scale:
    """Factors from the units of the workspace to m and N."""

    length: float
    force: float


def workspace_experiment(
    path: str | Path,
    *,
    unit: str = "m",
    force_unit: str = "N",
    c0: float | None = None,
    mass: float | None = None,
    increments: int | None = None,
) -> Experiment:
    """Return the experiment that a saved workspace describes.

    Bars follow the Ogden law with stiffness ``C0 A / L``; folds are enhanced-linear between
    their limits and bends that, or of the 4/3 power, all with MERLIN's stiffness per length
    times the length of the crease. A node that is supported on all axes is fixed, one on some is
    held there by a position actuator whose signal is constant. In force mode the load acts
    through force actuators whose signals rise to the reference load, by MERLIN's initial load
    factor in the first increment; in displacement mode the imposed displacements are followed
    increment by increment. One increment is one frame, one second apart.

    Parameters
    ----------
    path : path-like
        A workspace of MERLIN or MERLIN2 (.mat, .h5).
    unit, force_unit : str
        What lengths and forces are in, since MERLIN stores no unit.
    c0 : float, optional [force_unit / unit^2]
        Modulus of the bars, where the file does not tell it.
    mass : float, optional [kg]
        Of the whole body, shared out to the corners of its faces by area. MERLIN's statics have
        no mass: unless given every node has 1 kg, which matters only to producers that
        integrate the motion.
    increments : int, optional
        As many as the workspace has unless given.

    Raises
    ------
    UnreadableFile, UnsafeFile, SchemaError
        As the importer does.
    MissingData
        When the workspace does not tell a law, a support or a load.
    ConfigError
        When an argument is wrong.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from openprc_merlin.samples import write_sample
    >>> from openprc_merlin.workspace_experiment import workspace_experiment
    >>> with TemporaryDirectory() as folder:
    ...     sample = write_sample(Path(folder))
    ...     experiment = workspace_experiment(sample.path, unit="mm", c0=1e6)
    >>> experiment.geometry.n_nodes
    4
    """
    path = Path(path)
    scale = _Scale(_factor(unit, "length", "unit"), _factor(force_unit, "force", "force_unit"))
    for name, given in (("mass", mass), ("increments", increments)):
        if given is not None and not given > 0:
            raise ConfigError(f"{given}", expected="a number above 0", fix="correct it", key=name)
    space = workspace.build(containers.read(path).variables, file=path)
    laws = material.infer(space, c0=c0)
    notes = [f"lengths were taken to be in {unit}, forces in {force_unit}: MERLIN stores no unit"]
    bars = _bars(space, laws, scale)
    hinges, found = _hinges(space, laws, scale)
    notes += found
    positions = (space.nodes + space.start) * scale.length
    count = space.n_increments if increments is None else int(increments)
    # A displacement that is imposed on a supported axis wins, as it does in MERLIN.
    held = space.held & ~_imposed(space)
    drives, found = _drives(space, positions, scale, count)
    notes += found
    faces = np.zeros((0, 3)) if space.faces is None else space.faces
    if mass is None:
        notes.append("every node has 1 kg: MERLIN's statics have no mass (give one with mass)")
    return Experiment(
        geometry=Geometry(
            positions=positions,
            masses=_masses(space, mass),
            fixed=np.asarray(held.all(axis=1)),
            labels=tuple(str(number) for number in range(1, space.n_nodes + 1)),
            bars=bars,
            hinges=hinges,
            faces=faces.astype(np.int32),
        ),
        signals={signal.name: signal for signal, _ in drives},
        actuators=tuple(actuator for _, group in drives for actuator in group),
        duration=count * INCREMENT,
        dt=INCREMENT,
        save_interval=INCREMENT,
        notes=tuple(notes),
    )


def _factor(unit: str, dimension: str, key: str) -> float:
    found = UNITS.get(unit)
    if found is None or found.dimension != dimension:
        raise ConfigError(
            f"the unit {unit!r}",
            expected=f"a unit of {dimension}: "
            + ", ".join(u.symbol for u in UNITS.values() if u.dimension == dimension),
            fix="name what the numbers of the workspace are in",
            key=key,
        )
    return found.si_factor


def _missing(space: Workspace, what: str, fix: str, key: str) -> MissingData:
    return MissingData(
        f"the workspace does not tell {what}",
        expected="everything that the run was made with",
        fix=fix,
        file=space.file,
        key=key,
    )


_SAVE = "save the whole workspace of the run again"


def _bars(space: Workspace, laws: Material, scale: _Scale) -> Bars:
    if space.bars is None or space.bar_length is None or space.bar_area is None:
        raise _missing(space, "bars with their areas", _SAVE, "truss")
    if laws.c0 is None:
        raise _missing(space, "the modulus C0 of the bars", "give it as c0", "truss.CM")
    stiffness = laws.c0 * space.bar_area / space.bar_length
    return Bars(
        indices=space.bars.astype(np.int32),
        stiffness=stiffness * scale.force / scale.length,
        rest_length=space.bar_length * scale.length,
        law=np.full(len(space.bars), "ogden"),
    )


def _hinges(space: Workspace, laws: Material, scale: _Scale) -> tuple[Hinges, list[str]]:
    hinges = space.hinges
    if hinges is None:
        return Hinges(), []
    if hinges.rest_angle is None or hinges.stiffness is None:
        raise _missing(space, "rest angles and stiffness of the hinges", _SAVE, "angles")
    bends = hinges.code == BEND
    if bends.any() and laws.bend_law is None:
        raise _missing(space, "the law of the bends", _SAVE, "angles.CMbend")
    law = np.where(bends & (laws.bend_law == "four-thirds"), "four-thirds", "enhanced-linear")
    limits, notes = _limits(space, laws)
    if limits[0] <= 0.0 or limits[1] >= 360.0:
        law[law == "enhanced-linear"] = "linear"
    walled = law == "enhanced-linear"
    return Hinges(
        indices=hinges.indices.astype(np.int32),
        stiffness=hinges.stiffness * hinges.length * scale.force * scale.length,
        rest_angle=hinges.rest_angle,
        law=law,
        limit_low=np.where(walled, np.deg2rad(limits[0]), 0.0),
        limit_high=np.where(walled, np.deg2rad(limits[1]), FULL_TURN),
    ), notes


def _limits(space: Workspace, laws: Material) -> tuple[tuple[float, float], list[str]]:
    if laws.limits is not None:
        return laws.limits, []
    tried = {pair: verify.check(space, replace(laws, limits=pair)) for pair in verify.CANDIDATES}
    residuals = {
        pair: found.residual for pair, found in tried.items() if not isinstance(found, str)
    }
    if not residuals:
        raise _missing(space, "the limits of the folds", _SAVE, "angles.CM")
    low, high = min(residuals, key=lambda pair: residuals[pair])
    return (low, high), [
        f"the file does not tell the limits of the folds; {low:g} and {high:g} deg fit the saved"
        f" states best: the largest residual is {residuals[low, high]:.2g}"
    ]


def _masses(space: Workspace, mass: float | None) -> Floats:
    if mass is None:
        return np.ones(space.n_nodes)
    if space.faces is None:
        return np.full(space.n_nodes, mass / space.n_nodes)
    corners = space.nodes[space.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share = np.zeros(space.n_nodes)
    np.add.at(share, space.faces, (area / 3.0)[:, np.newaxis])
    masses: Floats = mass * share / share.sum()
    return masses


# --- supports and loads -----------------------------------------------------------------------


def _drives(
    space: Workspace, positions: Floats, scale: _Scale, count: int
) -> tuple[list[_Drive], list[str]]:
    load = space.load
    if load.reference is None or not load.reference.any():
        raise _missing(space, "the load", _SAVE, "Load")
    if load.mode == "unknown":
        raise _missing(
            space, "whether forces or displacements were imposed", _SAVE, "AnalyInputOpt.LoadType"
        )
    drives = list(_supports(positions, space.held & ~_imposed(space)))
    notes = []
    partly = len(drives)
    if partly:
        notes.append(f"{partly} nodes are held on some of their axes, by constant position signals")
    if load.mode == "displacement":
        drives += _displacements(space, positions, scale, count)
    else:
        first, source = _initial_factor(space)
        drives += _forces(space, load.reference.reshape(-1, 3) * scale.force, first, count)
        notes.append(f"the first increment aims at the load factor {first:g}, from {source}")
    return drives, notes


def _imposed(space: Workspace) -> NDArray[np.bool_]:
    imposed = np.zeros(space.held.size, dtype=bool)
    if space.load.mode == "displacement":
        imposed[space.load.dofs] = True
    return imposed.reshape(space.held.shape)


def _supports(positions: Floats, held: NDArray[np.bool_]) -> Iterator[_Drive]:
    for node in np.flatnonzero(held.any(axis=1) & ~held.all(axis=1)):
        signal = Signal(
            name=f"support {node + 1}", values=positions[node : node + 1], dt=INCREMENT, unit="m"
        )
        yield signal, (_actuator(node, signal, "position", held[node]),)


def _displacements(
    space: Workspace, positions: Floats, scale: _Scale, count: int
) -> Iterator[_Drive]:
    """Yield the imposed motion, as it was: MERLIN2 shortens steps that do not converge."""
    moved = np.concatenate([space.start[np.newaxis], space.displacements])
    moved = (space.nodes + moved).reshape(len(moved), -1)[: count + 1] * scale.length
    for dof in space.load.dofs.tolist():
        node, axis = divmod(dof, 3)
        name = f"position {node + 1} {_AXES[axis]}"
        signal = Signal(name=name, values=moved[:, dof], dt=INCREMENT, unit="m")
        yield signal, (_actuator(node, signal, "position", np.arange(3) == axis),)


def _forces(space: Workspace, reference: Floats, first: float, count: int) -> Iterator[_Drive]:
    """Yield one signal for each vector that acts on some of the nodes."""
    reference = np.where(space.held, 0.0, reference)
    loaded = np.flatnonzero(reference.any(axis=1))
    vectors, which = np.unique(reference[loaded], axis=0, return_inverse=True)
    rise = np.concatenate([[0.0], np.linspace(first, 1.0, count)]) if count > 1 else [0.0, 1.0]
    for number, vector in enumerate(vectors):
        name = "load" if len(vectors) == 1 else f"load {number + 1}"
        signal = Signal(name=name, values=np.outer(rise, vector), dt=INCREMENT, unit="N")
        nodes = loaded[which.ravel() == number]
        yield signal, tuple(_actuator(node, signal, "force", vector != 0.0) for node in nodes)


def _actuator(node: Any, signal: Signal, kind: Any, axes: NDArray[np.bool_]) -> Actuator:
    x, y, z = (bool(axis) for axis in axes)
    return Actuator(node=int(node), signal=signal.name, type=kind, axes=(x, y, z))


def _initial_factor(space: Workspace) -> tuple[float, str]:
    settings = space.variables.get("AnalyInputOpt")
    named = settings.get("InitialLoadFactor") if isinstance(settings, dict) else None
    for value, source in (
        (space.variables.get("blam"), "blam"),
        (named, "AnalyInputOpt.InitialLoadFactor"),
    ):
        if isinstance(value, np.ndarray) and value.size == 1 and np.isfinite(value).all():
            found = float(value.real.ravel()[0])
            if found != 0.0:
                return found, source
    history = space.load.history
    if history is not None and len(history) and history[0, 0] != 0.0:
        return float(history[0, 0]), f"the first value of {space.load.name}"
    return 1.0 / space.n_increments, "the number of increments"
