"""Importer for files of the older 0.1 packages.

Reads runs of both generations of that engine, laboratory recordings in its layout, and the
output of its video tracker. What an older file leaves out is looked for in the experiment
folder around it; what cannot be found stays out, and a note says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import UnreadableFile
from openprc.schema import legacy_kinds, safety
from openprc.schema.legacy_recordings import (
    import_displacement,
    import_laboratory,
    import_tracks,
)
from openprc.schema.legacy_simulation import import_simulation
from openprc.schema.legacy_vision import import_vision

if TYPE_CHECKING:
    import h5py

    from openprc.schema import TrajectoryWriter

    Reader = Callable[[h5py.File, Path, TrajectoryWriter, Mapping[str, Any]], None]

_READERS: dict[legacy_kinds.Kind, Reader] = {
    legacy_kinds.ENGINE: import_simulation,
    legacy_kinds.LABORATORY: import_laboratory,
    legacy_kinds.TRACKS: import_tracks,
    legacy_kinds.DISPLACEMENT: import_displacement,
    legacy_kinds.VISION: import_vision,
}


class LegacyImporter:
    """Reads files of the older 0.1 packages (capability ``import``).

    The one option, ``unit``, is the unit of length of recordings that do not say; px is taken
    for what comes from a video.
    """

    def sniff(self, path: Path) -> float:
        """Return 1.0 for runs and tracker output, 0.7 for the other files of the packages.

        Files without a trajectory are claimed too, so that `import_run` can say what they are.
        """
        return legacy_kinds.sureness(Path(path))

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the run at `path`, a file or an experiment folder.

        Raises
        ------
        NotATrajectory
            The file is known and holds something else.
        UnreadableFile, UnsafeFile
            It is none of the older files, damaged, or leads outside itself.
        Diverged
            The stored run contains numbers that are not finite.
        """
        path = Path(path)
        if not path.is_dir():
            safety.check_readable(path)
        kind = legacy_kinds.identify(path)
        if kind is None:
            raise UnreadableFile(
                "none of the layouts of the older packages fits",
                expected="a simulation.h5, experiment.h5, tracking_data.h5 or vision file, or "
                "an experiment folder",
                fix="ask `openprc info` what it is, or let `openprc import` choose the importer",
                file=path,
            )
        if kind not in _READERS:
            raise kind.refuse(path)
        run = legacy_kinds.find_run(path) if path.is_dir() else path
        if run is None:
            raise legacy_kinds.EXPERIMENT.refuse(path)
        if run != path:
            writer.add_source(run, role="trajectory")
        with safety.open_hdf5(run, allow_vlen=True) as file:
            _READERS[kind](file, run, writer, options)
