"""A series of meshes to simulation.h5."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import ConfigError
from openprc_meshio import mesh_series, recognise, vtkhdf, xdmf
from openprc_meshio.clock import Clock
from openprc_meshio.frames import Series
from openprc_meshio.motion import Motion
from openprc_meshio.roles import assign

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter


class MeshSeriesImporter:
    """Reads XDMF, VTKHDF, PVD, and numbered files of any mesh format."""

    def sniff(self, path: Path) -> float:
        """Return 1.0 for XDMF, PVD and VTKHDF, 0.7 for numbered meshes that look like some."""
        return recognise.sureness(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the series found at `path`.

        Raises
        ------
        UnreadableFile, UnsafeFile
            A file is damaged, or leads elsewhere.
        NotATrajectory
            It holds one instant, or nothing that moves.
        SchemaError
            The mesh changes on the way.
        ConfigError, MissingData, UnitError
            An option is missing, or contradicts the files.
        MissingDependency
            A mesh file is to be read and neither meshlane nor meshio is installed.
        """
        path = recognise.main_file(Path(path))
        with ExitStack() as stack:
            series = _open(path, stack, options)
            unit = _unit(series, options.get("unit"))
            clock = Clock(series, options)
            roles = assign(series, options, unit=unit, time_unit=clock.unit)
            motion = Motion(series, roles, options)
            for note in [*series.notes, clock.note, *roles.notes, *motion.notes]:
                writer.note(note)
            motion.write(writer, clock=clock, unit=unit)
            for source in series.sources:
                writer.add_source(source, role="mesh data")


def _open(path: Path, stack: ExitStack, options: Mapping[str, Any]) -> Series:
    kind = recognise.kind_of(path)
    if kind == "xdmf":
        return xdmf.open_series(path, stack=stack, collection=options.get("collection"))
    if kind == "vtkhdf":
        return vtkhdf.open_series(path, stack=stack)
    return mesh_series.open_series(path, reader=options.get("reader"))


def _unit(series: Series, given: str | None) -> str:
    stated = series.units.get("positions")
    if given and stated and given != stated:
        raise ConfigError(
            f"the option says {given!r} and the file {stated!r}",
            expected="one unit",
            fix="leave the option out; it is for files that do not say",
            file=series.path,
            key="unit",
        )
    if not given and not stated:
        raise ConfigError(
            "nothing says which unit the coordinates have",
            expected="the option unit: mesh formats do not know units",
            fix="pass unit=m, mm, um, ... or arb if there is none",
            file=series.path,
            key="unit",
        )
    return str(given or stated)
