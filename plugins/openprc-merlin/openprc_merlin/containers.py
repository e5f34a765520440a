"""Which container a file is, which variables it lists, and their values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import h5py

from openprc.errors import UnreadableFile
from openprc.schema import safety
from openprc_merlin import hdf5_workspaces, mat5

Kind = Literal["mat5", "hdf5", "mat4", "octave-text", "octave-binary", "gzip", "pickle", ""]

_REMEDY = {
    "mat4": ("a MAT-file of level 4", "load it in MATLAB or Octave and save it with -v7"),
    "octave-text": ("Octave's text format", "save it in Octave with -hdf5, which keeps all of it"),
    "octave-binary": ("Octave's binary format", "save it in Octave with -hdf5"),
    "gzip": ("a gzip archive", "unpack it first"),
    "pickle": ("a Python pickle", "write its arrays to a .mat file with scipy.io.savemat"),
}


@dataclass(frozen=True)
class Container:
    """The variables of a saved workspace as plain values.

    Structs are dictionaries, cells are lists, numbers are float64 or complex128 arrays in
    MATLAB's own shape, and what cannot be represented is None.
    """

    path: Path
    variables: dict[str, Any]
    notes: tuple[str, ...] = ()


def kind_of(path: Path) -> Kind:
    """Recognise a container by its first bytes; ``""`` when it is none of the known ones."""
    with path.open("rb") as stream:
        head = stream.read(mat5.HEADER_BYTES)
    if safety.is_hdf5(path):
        return "hdf5"
    if len(head) == mat5.HEADER_BYTES and head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        return "mat5"
    if head.startswith(b"# Created by Octave"):
        return "octave-text"
    if head.startswith((b"Octave-1-L", b"Octave-1-B")):
        return "octave-binary"
    if head.startswith(b"\x1f\x8b"):
        return "gzip"
    if head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        return "pickle"
    if path.suffix.lower() == ".mat" and _looks_like_level_4(head):
        return "mat4"
    return ""


def _looks_like_level_4(head: bytes) -> bool:
    """Level 4 begins with five int32: type (MOPT below 5000), rows, columns, complex, name."""
    if len(head) < 20:
        return False
    for order in ("little", "big"):
        mopt, rows, columns, imaginary, length = (
            int.from_bytes(head[i : i + 4], order, signed=True) for i in range(0, 20, 4)
        )
        name = head[20 : 20 + max(length - 1, 0)]
        if (
            0 <= mopt < 5000
            and rows >= 0
            and columns >= 0
            and imaginary in (0, 1)
            and 1 < length < 64
            and name.replace(b"_", b"a").isalnum()
        ):
            return True
    return False


def list_variables(path: Path) -> dict[str, tuple[int, ...] | None]:
    """Return the names of the variables with their shapes where those cost nothing to know.

    Values are not read. Shapes are in MATLAB's order; None stands for structs and cells.
    """
    kind = kind_of(path)
    if kind == "mat5":
        return {
            entry.name: entry.shape if entry.kind in mat5.NUMERIC else None
            for entry in mat5.directory(path)
            if entry.name and entry.kind in mat5.READ
        }
    if kind == "hdf5":
        with h5py.File(path, "r", locking="best-effort") as file:
            if not hdf5_workspaces.flavour(file):
                return {}
            return {name: _shape(file, name) for name in file if not name.startswith("#")}
    return {}


def _shape(file: h5py.File, name: str) -> tuple[int, ...] | None:
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        return None
    item = file[name]
    if isinstance(item, h5py.Group):
        item = item.get("value")
    return tuple(reversed(item.shape)) if isinstance(item, h5py.Dataset) else None


def read(path: Path) -> Container:
    """Read a saved workspace.

    Raises
    ------
    UnreadableFile
        When the container is not one that is read here, is damaged, or holds no variable.
    UnsafeFile
        When reading it could reach outside it or exhaust the memory.
    """
    safety.check_readable(path)
    kind = kind_of(path)
    if kind in _REMEDY:
        name, fix = _REMEDY[kind]
        raise UnreadableFile(
            f"this is {name}",
            expected="a MAT-file of v6, v7 or v7.3, or Octave's save -hdf5",
            fix=fix,
            file=path,
        )
    if not kind:
        with path.open("rb") as stream:
            head = stream.read(24)
        raise UnreadableFile(
            f"this is no saved workspace: it begins with {head!r}",
            expected="a MAT-file of v6, v7 or v7.3, or Octave's save -hdf5",
            fix="name the file that was saved in MATLAB or Octave after the run",
            file=path,
        )
    variables, notes = (mat5 if kind == "mat5" else hdf5_workspaces).read(path)
    if not variables:
        raise UnreadableFile(
            f"the file has a header and no variables ({path.stat().st_size} bytes)",
            expected="truss, angles and a displacement history",
            fix="Octave's save -v7 writes an empty file when a function handle is among the "
            "variables: save with -hdf5, or clear BarMater, RotSpring and truss.CM first",
            file=path,
        )
    return Container(path=path, variables=variables, notes=notes)
