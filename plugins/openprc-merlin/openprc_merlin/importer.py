"""The importer: saved workspaces and OBJ sequences to trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import ConfigError, OpenPRCError, UnreadableFile
from openprc_merlin import (
    containers,
    geometry,
    histories,
    material,
    obj_sequence,
    reference,
    run,
    stated,
    stored,
    verify,
    workspace,
)
from openprc_merlin.material import Material
from openprc_merlin.run import Run, Signal, Units
from openprc_merlin.topology import BEND
from openprc_merlin.workspace import Workspace

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_AXES = "xyz"
#: Below this the initial state counts as free of stress: strain, and angle in rad.
_RELAXED = 1e-6


class Importer:
    """Reads MERLIN, MERLIN2 and Sim-FAST workspaces, and OBJ sequences."""

    def sniff(self, path: Path) -> float:
        """Say how sure this importer is of `path`, from the list of variables only."""
        path = Path(path)
        try:
            if path.is_dir() or path.suffix.lower() == ".obj":
                return obj_sequence.is_sequence(path)
            kind = containers.kind_of(path)
            if kind == "octave-text":
                return 0.5 if _names_in_text(path) else 0.0
            try:
                listed = containers.list_variables(path)
            except UnreadableFile:
                # A workspace that was cut off: import_run() says where, which helps more than
                # that nobody knows the file.
                return 0.5 if kind == "mat5" and path.suffix.lower() == ".mat" else 0.0
        except (
            ArithmeticError,
            AttributeError,
            LookupError,
            MemoryError,
            OpenPRCError,
            OSError,
            RuntimeError,
            TypeError,
            ValueError,
        ):
            # Whatever h5py or the file system say of a damaged file: it is not ours.
            return 0.0
        if kind == "mat5" and not listed:
            # Octave's save -v7 leaves such a file behind; import_run() explains it.
            return 0.5 if path.stat().st_size == 128 else 0.0
        has_history = any(histories.is_displacement(name) for name in listed)
        if "truss" in listed:
            return 1.0 if has_history else 0.6 if "angles" in listed else 0.0
        if has_history:
            return 0.7
        hinted = any(histories.hints_displacement(name, shape) for name, shape in listed.items())
        return 0.6 if hinted else 0.0

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the run at `path` into `writer`; the options are those of the record.

        Raises
        ------
        UnreadableFile, UnsafeFile
            When the container cannot be read.
        MissingData, SchemaError
            When the workspace is not complete, or contradicts itself.
        ConfigError
            When an option does not fit the file.
        """
        path = Path(path)
        units = Units(options.get("unit") or "arb", options.get("force-unit") or "arb")
        time = options.get("time") or "increment"
        lent = None
        if options.get("reference") is not None:
            source = Path(options["reference"])
            lent = reference.load(source)
            writer.add_source(source, role="reference")
        if path.is_dir() or path.suffix.lower() == ".obj":
            result, notes = obj_sequence.load(path, units=units, rest=lent)
            if not path.is_dir():
                for file in obj_sequence.members(path):
                    if file != path:
                        writer.add_source(file)
            variables: Mapping[str, Any] = {}
        else:
            container = containers.read(path)
            loose, nested = _unpacked(container.variables)
            said = stated.read(_merge(loose, lent, path), file=path)
            variables = said.variables
            units = Units(
                options.get("unit") or said.length, options.get("force-unit") or said.force
            )
            space = workspace.build(
                variables,
                file=path,
                displacement=options.get("displacement"),
                load=options.get("load"),
            )
            laws = material.infer(space, c0=options.get("c0"))
            result, notes = assemble(space, laws, units, keep=bool(options.get("stored")))
            notes = [*container.notes, *nested, *notes]
            if options.get("verify"):
                outcome = verify.check(space, laws)
                notes.append(outcome if isinstance(outcome, str) else outcome.text)
            if said.has_time and time == "increment" and options.get("dt") is None:
                time = stated.TIME
        if units.length == "arb":
            writer.note("MERLIN stores no unit: lengths are arbitrary; give unit=mm, cm or m")
        instants, unit, kind = run.clock(
            result.increments,
            dt=options.get("dt"),
            time=time,
            variables=variables,
            file=path,
        )
        if kind == "physical" and time != stated.TIME:
            notes.append("the run is quasi-static; its time was given by the user")
        for note in notes:
            writer.note(note)
        run.write(result, writer, instants=instants, unit=unit, kind=kind)


def _unpacked(variables: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[str]]:
    """Return the workspace, also when all of it was saved as the fields of one struct."""
    if "truss" in variables or any(histories.is_displacement(name) for name in variables):
        return variables, []
    inside = [
        name
        for name, value in variables.items()
        if isinstance(value, dict) and any(histories.is_displacement(field) for field in value)
    ]
    if len(inside) != 1:
        return variables, []
    rest = {name: value for name, value in variables.items() if name != inside[0]}
    return {**rest, **variables[inside[0]]}, [f"the workspace is the struct {inside[0]}"]


def _names_in_text(path: Path) -> bool:
    """Look for MERLIN's names in the head of a file in Octave's text format."""
    with path.open("rb") as stream:
        head = stream.read(1 << 20).decode("latin-1")
    names = [line[8:].strip() for line in head.splitlines() if line.startswith("# name: ")]
    return "truss" in names or any(histories.is_displacement(name) for name in names)


def _merge(
    variables: Mapping[str, Any], lent: Mapping[str, Any] | None, path: Path
) -> Mapping[str, Any]:
    if lent is None:
        return variables
    truss = variables.get("truss")
    if "Node" in variables or (isinstance(truss, dict) and "Node" in truss):
        raise ConfigError(
            "the file has rest coordinates of its own",
            expected="the option reference only for a run saved without truss and Node",
            fix="leave the option out",
            file=path,
            key="reference",
        )
    return {**lent, **variables}


def assemble(
    space: Workspace, laws: Material, units: Units, *, keep: bool = False
) -> tuple[Run, list[str]]:
    """Turn a workspace into a run, with notes.

    Parameters
    ----------
    space : Workspace
    laws : Material
    units : Units
    keep : bool
        Also keep MERLIN's own strains, angles and energies.
    """
    signals, notes = _signals(space, units)
    extras: dict[str, tuple[Any, str, str]] = {
        "solver": (np.int64(space.solver), "1", "1 MERLIN, 2 MERLIN2, 0 not told"),
    }
    if space.load.mode == "force" and space.load.reference is not None:
        comment = "force at every node for a load factor of 1, x y z"
        vectors = space.load.reference.reshape(-1, 3)
        extras["reference_load"] = (vectors, units.force, comment)
    if laws.limits is not None:
        comment = "ends of the linear range of the hinges"
        extras["limits"] = (np.array(laws.limits), "deg", comment)
    if keep:
        extras |= _kept(space)
    bar_static: dict[str, run.Static] = {}
    if space.bars is not None and space.bar_length is not None:
        bar_static["kind_code"] = run.codes(space.bar_code)
        if space.bar_area is not None:
            bar_static["area"] = units.area(space.bar_area)
            if laws.c0 is not None:
                bar_static["stiffness"] = units.stiffness(
                    laws.c0 * space.bar_area / space.bar_length
                )
                notes.append(f"bar stiffness is C0 A / L, C0 = {laws.c0:g} from {laws.c0_source}")
    hinge_static, found = _hinge_static(space, laws, units)
    panel_centres = space.n_nodes - space.n_input_nodes
    if panel_centres:
        found.append(f"the last {panel_centres} nodes are panel centres of the N5B8 model")
    result = Run(
        positions=run.Displaced(space.nodes, space.start, space.displacements),
        increments=np.arange(space.n_increments + 1),
        units=units,
        rest=space.nodes,
        held=space.held,
        bars=space.bars if space.bars is not None and len(space.bars) else None,
        bar_rest=space.bar_length,
        bar_static=bar_static,
        hinges=None if space.hinges is None else space.hinges.indices,
        hinge_static=hinge_static,
        faces=space.faces,
        signals=signals,
        extras=extras,
    )
    return result, [*space.notes, *notes, *found, *stored.compare(space)]


def _kept(space: Workspace) -> dict[str, tuple[Any, str, str]]:
    rows = {
        "stored_strain": (stored.strains(space), "1", "Green-Lagrange strain of every bar"),
        "stored_angle": (stored.angles(space), "rad", "angle of every hinge"),
        "stored_energy": (stored.energy(space), "arb", "strain energy"),
    }
    return {
        name: (array, unit, f"{comment}, one row an increment, as MERLIN stored it")
        for name, (array, unit, comment) in rows.items()
        if array is not None
    }


def _hinge_static(
    space: Workspace, laws: Material, units: Units
) -> tuple[dict[str, run.Static], list[str]]:
    hinges = space.hinges
    if hinges is None:
        return {}, []
    static: dict[str, run.Static] = {
        "kind_code": run.codes(hinges.code),
        "crease_length": (hinges.length, units.length),
    }
    notes: list[str] = []
    if hinges.rest_angle is not None:
        static["rest_angle"] = (hinges.rest_angle, "rad")
    if hinges.stiffness is None:
        return static, notes
    coefficient = hinges.stiffness * hinges.length
    bends = hinges.code == BEND
    if not bends.any() or laws.bend_law == "linear":
        static["stiffness"] = units.rotational(coefficient)
    elif laws.bend_law == "four-thirds":
        static["moment_coefficient"] = (coefficient, "arb")
        static["moment_exponent"] = (np.where(bends, 4 / 3, 1.0), "1")
        notes.append(
            "bends follow M = K L sign(d) |d|^(4/3) and have no linear stiffness: hinges carry "
            "moment_coefficient and moment_exponent instead of stiffness"
        )
    else:
        static["moment_coefficient"] = (coefficient, "arb")
        notes.append("the law of the bends is not told: hinges carry no stiffness")
    if laws.limits is not None:
        notes.append(
            f"folds are linear from {laws.limits[0]:g} to {laws.limits[1]:g} deg "
            f"({laws.limits_source}) and stiffen without bound outside"
        )
    return static, notes


def _signals(space: Workspace, units: Units) -> tuple[tuple[Signal, ...], list[str]]:
    """Return what drove the run, and the reactions where displacements were imposed."""
    load = space.load
    names = [f"{dof // 3 + 1} {_AXES[dof % 3]}" for dof in load.dofs.tolist()]
    targets = tuple(dict.fromkeys(str(dof // 3 + 1) for dof in load.dofs.tolist()))
    width = 0 if load.history is None else load.history.shape[1]
    if load.mode == "displacement":
        signals: list[Signal] = []
        notes: list[str] = []
        if load.history is not None:
            numbered = [f"dof {n + 1}" for n in range(width)]
            at_rest = 0.0 if _is_relaxed(space) else np.nan
            values = np.vstack([np.full((1, width), at_rest), load.history])
            signals.append(
                Signal(
                    "reaction",
                    tuple(names if len(names) == width else numbered),
                    values,
                    "minus the force applied at each imposed degree of freedom",
                    units.force,
                    is_input=False,
                )
            )
            notes.append(f"channel reaction is {load.name} as stored: minus the applied force")
        if names and (load.history is None or len(names) == width):
            history = space.displacements.reshape(space.n_increments, -1)[:, load.dofs]
            imposed = np.vstack([space.start.ravel()[load.dofs], history])
            signals.append(
                Signal("displacement", tuple(names), imposed, "displacement", units.length, targets)
            )
        else:
            notes.append("which degrees of freedom were imposed is not told: there is no input")
        return tuple(signals), notes
    if load.history is None:
        return (), []
    values = np.vstack([np.zeros((1, width)), load.history])
    if load.mode == "force":
        columns = tuple(
            ["load factor"] if width == 1 else [f"factor {n + 1}" for n in range(width)]
        )
        return (Signal("load", columns, values, "load factor", "1", targets),), []
    columns = tuple(f"{load.name} {n + 1}" for n in range(width))
    note = f"whether {load.name} is a load factor or a reaction is not told; frame 0 has none of it"
    return (Signal("load", columns, values, "load", "arb", targets),), [note]


def _is_relaxed(space: Workspace) -> bool:
    """Tell whether the initial state is free of stress, so that its reactions are zero."""
    positions = (space.nodes + space.start)[None]
    if space.bars is not None and space.bar_length is not None:
        stretch = geometry.bar_lengths(positions, space.bars)[0] / space.bar_length
        if np.abs(stretch - 1).max(initial=0.0) > _RELAXED:
            return False
    if space.hinges is None:
        return True
    if space.hinges.rest_angle is None:
        return False
    angle = geometry.dihedral_angles(positions, space.hinges.indices)[0]
    return bool(np.abs(angle - space.hinges.rest_angle).max(initial=0.0) <= _RELAXED)
