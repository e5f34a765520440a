"""Series of mesh files, one a step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import overload

from openprc.errors import UnreadableFile
from openprc_meshio import mesh_files, numbered
from openprc_meshio.frames import Frame, Series
from openprc_meshio.vtk_xml import VtkXmlFrame

Opened = mesh_files.MeshFrame | VtkXmlFrame
SUFFIXES = tuple(mesh_files.FORMATS)


def open_series(path: Path, *, reader: str | None = None) -> Series:
    """Return the series that a PVD file lists, or that numbered files make up.

    Raises
    ------
    NotATrajectory
        When it is a single mesh.
    UnreadableFile
        When a file is of a kind that is not read.
    """
    listing = _listing(path)
    strange = [file for file in listing.files if file.suffix.lower() not in SUFFIXES]
    if strange:
        raise UnreadableFile(
            f"it lists {strange[0].name}",
            expected="files ending in " + ", ".join(SUFFIXES),
            fix="save the steps as VTU, in ParaView with one piece each",
            file=path,
        )
    first = mesh_files.open_frame(listing.files[0], reader=reader)
    frames = _Files(listing.files, reader, first)
    notes = [f"read by {first.by}, {len(listing.files)} files"]
    start = first.time
    if listing.times is None and start is not None:
        frames.timed = True
        second = frames[1].time
        frames.timed = second is not None and second > start
        notes.append(
            "times are those in the files (TimeValue)"
            if frames.timed
            else "the times in the files (TimeValue) do not increase and were left aside"
        )
    if first.said:
        notes.append(f"{first.by} said about {first.path.name}: {first.said}")
    named = path.resolve()
    # The host hashes what was named: of a folder, every file below it.
    others = [] if path.is_dir() else [f for f in listing.files if f.resolve() != named]
    return Series(path, frames, listing.times, listing.numbers, sources=others, notes=notes)


def _listing(path: Path) -> numbered.Listing:
    suffix = "" if path.is_dir() else path.suffix.lower()
    if suffix == ".pvd":
        return numbered.listed(path)
    if suffix == ".series":
        return numbered.listed_in_json(path)
    return numbered.numbered(path, SUFFIXES)


class _Files(Sequence[Frame]):
    """Reads a file when its frame is asked for; the last one is kept."""

    def __init__(self, files: tuple[Path, ...], reader: str | None, first: Opened) -> None:
        self._files = files
        self._reader = reader
        self._last = (0, first)
        self.timed = False

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> Opened: ...
    @overload
    def __getitem__(self, index: slice) -> list[Opened]: ...
    def __getitem__(self, index: int | slice) -> Opened | list[Opened]:
        """Return a frame."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if self._last[0] != index:
            frame = mesh_files.open_frame(self._files[index], reader=self._reader)
            self._last = (index, frame)
        self._last[1].timed = self.timed
        return self._last[1]
