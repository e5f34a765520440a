"""One mesh file through meshlane or meshio, with their habits contained.

Both end the interpreter on a file that they cannot read, print, and some of their readers open
other files that the mesh names. None of it may happen here: what they print becomes part of
the error or a note, `SystemExit` becomes an error, and files that name others are looked at
first.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from openprc.errors import MissingDependency, UnreadableFile, UnsafeFile
from openprc.schema import safety
from openprc_meshio import vtk_xml
from openprc_meshio.frames import Array, Cells
from openprc_meshio.vtk_xml import VtkXmlFrame

#: The one that is looked after goes first.
READERS = ("meshlane", "meshio")
#: Ending to the format that is asked for; nothing is left to their guessing.
FORMATS = {
    ".vtu": "vtu",
    ".vtp": "vtp",
    ".vtk": "vtk",
    ".msh": "gmsh",
    ".inp": "abaqus",
    ".mesh": "medit",
    ".meshb": "medit",
    ".med": "med",
    ".off": "off",
    ".ply": "ply",
    ".vol": "netgen",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".su2": "su2",
}
#: Whatever their parsers raise on files that are damaged.
_FAULTS = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError,
    RuntimeError, SyntaxError, TypeError, ValueError, struct.error, zlib.error,
)  # fmt: skip


def load_reader(name: str | None = None) -> ModuleType:
    """Import the package that reads mesh files: `name`, or the first that is installed.

    Raises
    ------
    MissingDependency
        When it is not installed.
    """
    wanted = READERS if name is None else (name,)
    for candidate in wanted:
        if find_spec(candidate) is not None:
            return import_module(candidate)
    raise MissingDependency(
        f"{' and '.join(wanted)} {'are' if len(wanted) > 1 else 'is'} not installed",
        expected="a reader of mesh files",
        fix=f"pip install {wanted[0]}",
        key="reader",
    )


def version_of(reader: ModuleType) -> str:
    """Return name and version of a reader."""
    return f"{reader.__name__} {metadata.version(reader.__name__)}"


def open_frame(path: Path, *, reader: str | None) -> MeshFrame | VtkXmlFrame:
    """Return the mesh in a file.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When it is damaged, or leads elsewhere.
    MissingDependency
        When what reads it is not installed.
    """
    safety.check_readable(path)
    xml = path.suffix.lower() in (".vtp", ".vtu")
    if xml and vtk_xml.reads(path):
        return VtkXmlFrame(path)
    return MeshFrame(path, reader=load_reader(reader))


class MeshFrame:
    """One mesh file."""

    def __init__(self, path: Path, *, reader: ModuleType) -> None:
        self.path = path
        self.by = version_of(reader)
        self.same_points: object = None
        self.same_cells: object = None
        #: Whether the time in the file means something.
        self.timed = True
        self._mesh, self.said = _read(path, reader)
        self.point_names = tuple(self._mesh.point_data)
        self.cell_names = tuple(self._mesh.cell_data)

    def points(self) -> Array:
        """Return the places, (N, D)."""
        return np.asarray(self._mesh.points)

    def cells(self) -> list[Cells]:
        """Return the cells, block by block; polyhedra, which list no corners, are left out."""
        return [
            Cells(block.type, np.asarray(block.data, dtype=np.int64))
            for block in self._mesh.cells
            if not block.type.startswith("polyhedron")
        ]

    def point_field(self, name: str) -> Array:
        """Return a field of the points."""
        return _flat(self._mesh.point_data[name])

    def cell_field(self, name: str) -> Sequence[Array | None]:
        """Return a field of the cells, one array a block."""
        return [
            _flat(values)
            for block, values in zip(self._mesh.cells, self._mesh.cell_data[name], strict=True)
            if not block.type.startswith("polyhedron")
        ]

    @property
    def time(self) -> float | None:
        """The time that VTK writes into the file, if there is one."""
        if not self.timed:
            return None
        value = np.asarray(self._mesh.field_data.get("TimeValue", ())).reshape(-1)
        return float(value[0]) if value.size == 1 and value.dtype.kind in "fiu" else None


def _flat(values: Any) -> Array:
    array = np.asarray(values)
    array = array.reshape(len(array), -1) if array.ndim > 1 else array
    return array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array


def _read(path: Path, reader: ModuleType) -> tuple[Any, str]:
    """Return the mesh and what was printed on the way."""
    form = FORMATS[path.suffix.lower()]
    _look_first(path, form)
    said = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said):
            mesh = reader.read(path, file_format=form)
    except SystemExit:
        raise _unreadable(path, reader, said.getvalue()) from None
    except (*_FAULTS, reader.ReadError) as error:
        # Their parsers raise whatever the first wrong byte leads to.
        words = f"{said.getvalue()} {type(error).__name__}: {error}"
        raise _unreadable(path, reader, words) from error
    return mesh, " ".join(said.getvalue().split())


def _unreadable(path: Path, reader: ModuleType, words: str) -> UnreadableFile:
    return UnreadableFile(
        f"{reader.__name__} cannot read it: {' '.join(words.split()) or 'it does not say why'}",
        expected=f"a file of format {FORMATS[path.suffix.lower()]}",
        fix="export or copy it again, or convert it to VTU",
        file=path,
    )


def _look_first(path: Path, form: str) -> None:
    """Refuse what could make a reader open other files or fill the memory.

    Raises
    ------
    UnreadableFile, UnsafeFile
    """
    safety.check_readable(path)
    if form == "med":
        safety.open_hdf5(path, allow_soft_links=True).close()
    elif form in ("abaqus", "nastran"):
        _refuse_inclusion(path, "*include" if form == "abaqus" else "include")


def _refuse_inclusion(path: Path, word: str) -> None:
    with path.open("rb") as stream:
        for number, line in enumerate(stream, start=1):
            if line.lstrip()[: len(word)].lower() == word.encode():
                raise UnsafeFile(
                    f"line {number} includes another file: {line.strip()[:60].decode('latin-1')!r}",
                    expected="one file with everything in it",
                    fix="write the model as a flat input file",
                    file=path,
                )
