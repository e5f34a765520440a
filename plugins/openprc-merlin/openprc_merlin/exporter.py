"""The exporter: a trajectory as the workspace that a run of MERLIN or MERLIN2 leaves behind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, MissingData
from openprc.exporters.rows import Rows
from openprc.schema import UNITS
from openprc_merlin import exporter_laws, exporter_load, exporter_mesh, geometry
from openprc_merlin.exported_file import new_file
from openprc_merlin.exporter_laws import Laws, Scale
from openprc_merlin.exporter_load import Drive
from openprc_merlin.exporter_mesh import Mesh

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
#: The first 116 bytes of a MAT-file are free text; a fixed one makes equal runs equal files.
_HEADER = b"MATLAB 5.0 MAT-file, written by OpenPRC".ljust(116)
#: A variable of a MAT-file of level 5 ends here.
MAX_VARIABLE = (1 << 31) - (1 << 12)
_BLOCK = 256


class MerlinExporter:
    """Writes a MAT-file of level 5 that MATLAB and Octave load, and that is imported again."""

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write `trajectory` to `path` and return the one file made.

        Raises
        ------
        MissingData
            When the body has no bars, faces or rest shape, or a point is missing.
        UnsupportedScene
            When an element has no counterpart in MERLIN.
        ConfigError
            When an option is wrong, or the run is too long for the format.
        ResultExists
            When `path` exists.
        """
        from scipy.io import savemat

        path = Path(path)
        variables = workspace(
            trajectory,
            version=options.get("version"),
            rest=str(options.get("rest") or "stored"),
            stride=int(options.get("stride", 1)),
        )
        with new_file(path) as stream:
            savemat(
                stream,  # type: ignore[arg-type] # the stubs know paths only
                variables,
                do_compression=bool(options.get("compress", True)),
                long_field_names=True,
                oned_as="column",
            )
            stream.seek(0)
            stream.write(_HEADER)
        return [path]


def workspace(
    trajectory: Trajectory, *, version: str | None = None, rest: str = "stored", stride: int = 1
) -> dict[str, Any]:
    """Return the variables of the workspace, in double precision and counted from 1.

    Parameters
    ----------
    trajectory : Trajectory
    version : {"1", "2"}, optional
        Names of MERLIN (``U_his``, ``LF_his``) or MERLIN2 (``Uhis``, ``Fhis``); by default
        those of the solver that a run was imported from, else of MERLIN2.
    rest : {"stored", "first"}
        Whether the shape free of stress is the stored one or that of frame 0.
    stride : int
        Keep every so many frames, the first one always.
    """
    version = version or _solver(trajectory)
    mesh = exporter_mesh.build(trajectory, rest=rest)
    frames = _frames(trajectory, stride)
    displacements = _displacements(trajectory, mesh, frames)
    scale = exporter_laws.scale_of(trajectory)
    laws = exporter_laws.collect(trajectory, mesh, scale)
    drive = exporter_load.collect(trajectory, mesh, displacements)
    if version == "1" and (laws.four_thirds or drive.mode == "displacement"):
        what = "bends of the 4/3-power law" if laws.four_thirds else "imposed displacements"
        raise ConfigError(
            f"{what}, which the first MERLIN does not have",
            expected="version=2",
            fix="leave the option version out",
            file=trajectory.path,
            key="version",
        )
    notes = [*mesh.notes, *laws.notes, *drive.notes]
    # A reader takes a first increment without motion for the initial state, so that is put
    # in front where a run begins with a pause.
    first = 0 if len(frames) > 1 and np.array_equal(displacements[1], displacements[0]) else 1
    if first == 0:
        notes.append("the histories begin with the initial state")
    if len(frames) == 1:
        first = 0
    history = displacements[first:].reshape(len(displacements) - first, -1).T
    load = None if drive.history is None else drive.history[frames][first:]
    variables = _model(mesh, laws, drive, version=version)
    variables["truss"]["U0"] = displacements[0].reshape(-1, 1)
    if version == "1":
        variables |= {"U_his": history, **({} if load is None else {"LF_his": load})}
        variables["Data"] = _post_processed(mesh, displacements[first:])
    else:
        variables |= {"Uhis": history, **({} if load is None else {"Fhis": load})}
        variables["AnalyInputOpt"] = _settings(mesh, laws, drive, n_increments=history.shape[1])
    variables["openprc"] = _said(trajectory, scale, frames, notes)
    return variables


def _solver(trajectory: Trajectory) -> str:
    known = trajectory.has("/extensions/openprc-merlin/solver")
    first = known and int(trajectory.extension("openprc-merlin", "solver")) == 1
    return "1" if first else "2"


def _frames(trajectory: Trajectory, stride: int) -> NDArray[np.intp]:
    Rows(trajectory.n_frames, {"stride": stride})  # refuses what is below 1
    frames = np.arange(0, trajectory.n_frames, stride)
    size = 8 * 3 * trajectory.n_nodes * len(frames)
    if size > MAX_VARIABLE:
        raise ConfigError(
            f"{len(frames)} frames of {trajectory.n_nodes} nodes are {size:,} bytes",
            expected=f"at most {MAX_VARIABLE:,} bytes in a variable of a MAT-file of level 5",
            fix=f"thin the run out with the option stride={stride * (size // MAX_VARIABLE + 1)}",
            file=trajectory.path,
            key="stride",
        )
    return frames


def _displacements(trajectory: Trajectory, mesh: Mesh, frames: NDArray[np.intp]) -> Floats:
    """Return (T, N, 3) displacements from the rest shape."""
    moved = np.zeros((len(frames), len(mesh.rest), 3))
    for begin in range(0, len(frames), _BLOCK):
        chosen = frames[begin : begin + _BLOCK]
        step = int(frames[1] - frames[0]) if len(frames) > 1 else 1
        rows = trajectory.positions(slice(int(chosen[0]), int(chosen[-1]) + 1, step))
        bad = np.argwhere(~np.isfinite(rows))
        if bad.size:
            frame, node = int(chosen[bad[0, 0]]), int(bad[0, 1])
            raise MissingData(
                f"node {node} is missing in frame {frame}",
                expected="the position of every node in every frame",
                fix="export a run without gaps, or fill them first",
                file=trajectory.path,
                key="/time_series/nodes/observed",
            )
        moved[begin : begin + _BLOCK] = exporter_mesh.padded(rows) - mesh.rest
    return moved


def _model(mesh: Mesh, laws: Laws, drive: Drive, *, version: str) -> dict[str, Any]:
    """Return the input of MERLIN's scripts, and `truss` and `angles` as they make them."""
    n_bends = mesh.n_bends
    panels = np.empty((len(mesh.panels), 1), dtype=object)
    for number, panel in enumerate(mesh.panels):
        panels[number, 0] = np.array([panel], dtype=np.float64) + 1
    # MERLIN2 does not count imposed degrees of freedom among the supported ones.
    supports = drive.held & ~((drive.reference != 0) & (drive.mode == "displacement"))
    supported = np.flatnonzero(supports.any(axis=1))
    truss: dict[str, Any] = {
        "Node": mesh.rest,
        "Bars": mesh.bars.astype(np.float64) + 1,
        "Trigl": mesh.faces.astype(np.float64) + 1,
        "B": compatibility(mesh),
        "L": _column(mesh.length),
        "FixedDofs": _column(np.flatnonzero(supports.ravel()) + 1.0),
    }
    angles: dict[str, Any] = {
        "fold": mesh.hinges[n_bends:].astype(np.float64) + 1,
        "bend": mesh.hinges[:n_bends].astype(np.float64) + 1,
        "Panel": panels,
    }
    variables: dict[str, Any] = {
        "Node": mesh.rest[: mesh.n_input],
        "Panel": panels,
        "Supp": np.column_stack([supported + 1.0, supports[supported]]),
        "truss": truss,
        "angles": angles,
    }
    loaded = np.flatnonzero(drive.reference.any(axis=1))
    if loaded.size:
        variables["Load"] = np.column_stack([loaded + 1.0, drive.reference[loaded]])
    if laws.area is not None:
        truss["A"] = _column(laws.area)
        _uniform(variables, "Abar", laws.area)
    if laws.c0 is not None:
        variables["E0" if version == "1" else "C0"] = laws.c0
        truss["CM"] = f"@(Ex)Ogden(Ex,{laws.c0!r})"
    shape = (1, -1) if version == "1" else (-1, 1)
    names = ("kpb", "kpf") if version == "1" else ("Kb", "Kf")
    for values, pair in ((laws.stiffness, names), (laws.rest_angle, ("pb0", "pf0"))):
        if values is not None:
            angles[pair[0]] = values[:n_bends].reshape(shape)
            angles[pair[1]] = values[n_bends:].reshape(shape)
    if laws.stiffness is not None:
        _uniform(variables, "Kb", laws.stiffness[:n_bends])
        _uniform(variables, "Kf", laws.stiffness[n_bends:])
        angles |= _handles(laws, version=version)
    if laws.limits is not None:
        variables["limlft"], variables["limrht"] = laws.limits
    if version == "1" and drive.mode == "force":
        variables["F"] = drive.reference.reshape(-1, 1)
    return variables


def _handles(laws: Laws, *, version: str) -> dict[str, str]:
    """Return the laws of the hinges as text for str2func: SciPy cannot write handles."""
    handles: dict[str, str] = {}
    if laws.limits is not None:
        law = "@(he,h0,kpi,L0)EnhancedLinear(he,h0,kpi,L0,{!r},{!r})".format(*laws.limits)
        handles = {"CM": law} if version == "1" else {"CMfold": law, "CMbend": law}
    if laws.four_thirds:
        handles["CMbend"] = "@(he,h0,kb,L0)SuperLinearBend(he,h0,kb,L0)"
    return handles


def _column(values: Any) -> Floats:
    return np.asarray(values, dtype=np.float64).reshape(-1, 1)


def _uniform(variables: dict[str, Any], name: str, values: Floats) -> None:
    """Add the one number that MERLIN's scripts take, where all elements share it."""
    if len(values) and np.ptp(values) <= 1e-12 * abs(values[0]):
        variables[name] = float(values[0])


def compatibility(mesh: Mesh) -> Any:
    """Return MERLIN's sparse (M, 3N) matrix B: minus and plus the direction of every bar."""
    from scipy.sparse import csc_matrix

    first, second = mesh.bars.T
    direction = (mesh.rest[second] - mesh.rest[first]) / mesh.length[:, None]
    rows = np.repeat(np.arange(len(mesh.bars)), 3)
    axes = np.arange(3)
    ends = [(3 * end[:, None] + axes).ravel() for end in (first, second)]
    values = np.concatenate([-direction.ravel(), direction.ravel()])
    place = (np.concatenate([rows, rows]), np.concatenate(ends))
    return csc_matrix((values, place), shape=(len(mesh.bars), mesh.rest.size))


def _settings(mesh: Mesh, laws: Laws, drive: Drive, *, n_increments: int) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "ModelType": "N5B8" if mesh.n_input < len(mesh.rest) else "N4B5",
        "MaterCalib": "manual",
        "MaxIcr": float(n_increments),
    }
    if drive.mode:
        settings["LoadType"] = "Force" if drive.mode == "force" else "Displacement"
        settings["Load"] = drive.reference.reshape(-1, 1)
    if drive.mode == "displacement":
        settings["DispStep"] = float(n_increments)
    for name, values in (("Abar", laws.area), ("Kb", laws.stiffness), ("Kf", laws.stiffness)):
        if values is not None:
            part = {"Kb": values[: mesh.n_bends], "Kf": values[mesh.n_bends :]}.get(name, values)
            _uniform(settings, name, part)
    return settings


def _post_processed(mesh: Mesh, displacements: Floats) -> dict[str, Floats]:
    """Return the struct `Data` of the first MERLIN: strains, angles and crease lengths."""
    counts = (len(mesh.bars), len(mesh.hinges))
    strain, angle, crease = (
        np.zeros((rows, len(displacements))) for rows in (counts[0], counts[1], counts[1])
    )
    for begin in range(0, len(displacements), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        positions = mesh.rest + displacements[block]
        length = geometry.bar_lengths(positions, mesh.bars)
        strain[:, block] = (((length / mesh.length) ** 2 - 1) / 2).T
        angle[:, block] = geometry.dihedral_angles(positions, mesh.hinges).T
        crease[:, block] = length[:, : counts[1]].T
    n = mesh.n_bends
    return {
        "Exbar": strain,
        "FdAngle": angle[n:],
        "LFdAngle": crease[n:],
        "BdAngle": angle[:n],
        "LBdAngle": crease[:n],
    }


def _said(
    trajectory: Trajectory, scale: Scale, frames: NDArray[np.intp], notes: list[str]
) -> dict[str, Any]:
    """Return what MERLIN has no variable for: units, instants, and what was left out."""
    said: dict[str, Any] = {
        "length_unit": scale.length,
        "force_unit": scale.force,
        "note": "; ".join(
            [
                *notes,
                "handles are text: truss.CM = str2func(truss.CM), and so on",
            ]
        ),
    }
    if trajectory.time_kind == "physical":
        factor = UNITS[trajectory.time_unit].si_factor
        said["time"] = _column(trajectory.time[frames] * factor)
    return said
