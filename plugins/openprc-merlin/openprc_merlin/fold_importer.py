"""The importer of FOLD animations (FOLD 1.2, https://github.com/edemaine/fold)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, OpenPRCError
from openprc_merlin import fold_file, fold_mesh, fold_said, geometry
from openprc_merlin.fold_file import FoldRun
from openprc_merlin.fold_mesh import FoldMesh
from openprc_merlin.fold_units import STORED
from openprc_merlin.run import codes

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

Floats = NDArray[np.float64]
#: What is parsed to be sure; larger files are judged by their first and last bytes.
_PARSED = 8 << 20
_EDGE = 1 << 16
_BLOCK = 1 << 20


class FoldImporter:
    """Reads the frames of a FOLD file as instants of one run."""

    def sniff(self, path: Path) -> float:
        """Say how sure this importer is of `path`.

        A single state is claimed, too, so that the refusal can say what to do with it.
        """
        path = Path(path)
        try:
            if not path.is_file():
                return 0.0
            size = path.stat().st_size
            with path.open("rb") as stream:
                head = stream.read(_EDGE)
                stream.seek(max(0, size - _EDGE))
                tail = stream.read(_EDGE)
            begins = head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{"
            if not begins or tail.rstrip()[-1:] != b"}" or not _names_fold(head + tail):
                return 0.0
            if size > _PARSED:
                return 0.7
            data = fold_file.parse(path)
        except (OSError, OpenPRCError):
            return 0.0
        if not any(key in data for key in ("vertices_coords", "file_frames")):
            return 0.0
        frames = data.get("file_frames")
        moving = isinstance(frames, list) and any(
            isinstance(frame, dict) and "vertices_coords" in frame for frame in frames
        )
        return 1.0 if moving else 0.6

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the animation at `path` into `writer`; the options are those of the record.

        Raises
        ------
        UnreadableFile, UnsafeFile, NotATrajectory, MissingData, SchemaError
            See `fold_file.read` and `fold_mesh.build`.
        ConfigError
            When an option does not fit the file.
        """
        path = Path(path)
        run = fold_file.read(path)
        unit, factor = _unit(run, options.get("unit"), path)
        said = fold_said.read(run.shared, n_nodes=run.positions.shape[1], file=path)
        mesh = fold_mesh.build(run.shared, shape=run.positions[0], file=path)
        clock = _clock(run, options, path)
        if unit == "arb" and said.unit:
            unit = said.unit
        _write(run, mesh, said, writer, unit=unit, factor=factor, clock=clock)
        for note in (*run.notes, *mesh.notes):
            writer.note(note)


def _names_fold(text: bytes) -> bool:
    return any(key in text for key in (b'"vertices_coords"', b'"file_frames"', b'"edges_vertices"'))


def _unit(run: FoldRun, given: str | None, path: Path) -> tuple[str, float]:
    """Return the unit of the trajectory, and the factor to it."""
    known = STORED.get(run.unit)
    if known is None:
        return given or "arb", 1.0
    if given is not None and given != run.unit:
        raise ConfigError(
            f"unit={given}, and the file says {run.unit}",
            expected="one of them",
            fix="leave the option out",
            file=path,
            key="unit",
        )
    return known


def _clock(run: FoldRun, options: Mapping[str, Any], path: Path) -> tuple[Floats, str, Any]:
    """Return the instants, their unit, and ``"pseudo"`` or ``"physical"``."""

    def refused(found: str, expected: str, fix: str, key: str) -> ConfigError:
        return ConfigError(found, expected=expected, fix=fix, file=path, key=key)

    dt, key = options.get("dt"), options.get("time")
    count = np.arange(len(run.frames), dtype=np.float64)
    if dt is not None:
        if key is not None:
            raise refused("both dt and time are given", "one of them", "leave one out", "time")
        if not (np.isfinite(dt) and dt > 0):
            raise refused(f"dt = {dt}", "seconds per frame, above 0", "correct the option", "dt")
        return count * float(dt), "s", "physical"
    if key == "increment":
        return count, "1", "pseudo"
    name = key or fold_said.TIME
    values = [frame.get(name) for frame in run.frames]
    if key is None and all(value is None for value in values):
        return count, "1", "pseudo"
    if not all(isinstance(value, int | float) and type(value) is not bool for value in values):
        held = sum(isinstance(value, int | float) for value in values)
        raise refused(
            f"{held} of {len(values)} frames have a number under {name!r}",
            "an instant in every frame",
            "number the frames with time=increment, or give dt",
            "time",
        )
    instants = np.array(values, dtype=np.float64)
    if not (np.isfinite(instants).all() and (np.diff(instants) > 0).all()):
        raise refused(
            f"the instants under {name!r} do not increase everywhere",
            "strictly increasing numbers",
            "number the frames with time=increment, or give dt",
            "time",
        )
    unit, kind = ("s", "physical") if key else fold_said.clock(run.shared, file=path)
    return instants, unit, kind


def _write(
    run: FoldRun,
    mesh: FoldMesh,
    said: fold_said.Said,
    writer: TrajectoryWriter,
    *,
    unit: str,
    factor: float,
    clock: tuple[Floats, str, Any],
) -> None:
    instants, time_unit, kind = clock
    n_frames, n_nodes, dims = run.positions.shape
    positions = run.positions if factor == 1.0 else run.positions * factor
    writer.declare_time(unit=time_unit, kind=kind)
    writer.declare_nodes(n_nodes, dims, unit=unit, **said.nodes(dims))
    bars = mesh.edges if said.n_bars is None else mesh.edges[: said.n_bars]
    hinges = mesh.hinges if said.hinges is None else said.hinges
    length = None
    if len(bars):
        static = dict(said.constants("bars", len(bars)))
        if said.n_bars is None:
            static["kind_code"] = codes(mesh.edge_code)
            static["assignment"] = (list(mesh.assignments), None)
        if run.flat is not None:
            flat = np.zeros((1, n_nodes, 3))
            flat[0, :, : run.flat.shape[1]] = run.flat * factor
            static["rest_length"] = (geometry.bar_lengths(flat, bars)[0], unit)
        if "rest_length" in static:
            length = np.asarray(static["rest_length"][0])
        series = {"length": unit} | ({} if length is None else {"strain": "1"})
        writer.declare_elements("bars", bars, series=series, static=static)
    if len(hinges):
        static = dict(said.constants("hinges", len(hinges)))
        if said.hinges is None:
            static["kind_code"] = codes(mesh.hinge_code)
        writer.declare_elements("hinges", hinges, series={"angle": "rad"}, static=static)
    faces = mesh.faces if said.faces is None else said.faces
    if len(faces):
        writer.declare_elements("faces", faces)
    inputs = said.declare_inputs(writer, n_frames=n_frames)
    unwrap = geometry.Unwrapper()
    step = max(1, _BLOCK // (3 * max(n_nodes, len(bars), len(hinges))))
    for begin in range(0, n_frames, step):
        block = slice(begin, begin + step)
        elements: dict[tuple[str, str], Floats] = {}
        if len(bars):
            measured = geometry.bar_lengths(positions[block], bars)
            elements["bars", "length"] = measured
            if length is not None:
                elements["bars", "strain"] = (measured - length) / length
        if len(hinges):
            angles = geometry.dihedral_angles(positions[block], hinges)
            elements["hinges", "angle"] = unwrap(angles)
        writer.append(
            instants[block],
            positions=positions[block],
            elements=elements,
            inputs={name: values[block] for name, values in inputs.items()},
        )
    if unwrap.crossings:
        writer.note(
            f"hinge angles cross the cut at 0 and 2 pi {unwrap.crossings} times and were "
            "unwrapped: faces passed through each other, or are folded shut"
        )
