"""What kind of series a path is."""

from __future__ import annotations

from pathlib import Path

import h5py

from openprc.errors import NotATrajectory, OpenPRCError
from openprc.schema import safety
from openprc.schema.damage import DAMAGE
from openprc_meshio.mesh_files import FORMATS
from openprc_meshio.numbered import family

_XDMF = (".xdmf", ".xmf", ".xdmf3", ".xdmf2")
_LISTS = (*_XDMF, ".pvd", ".series", ".vtkhdf")
_HEAD = 4096
#: What stands near the beginning of the formats that are told by their content.
_SIGNS = {
    ".vtu": (b'type="UnstructuredGrid"', b"type='UnstructuredGrid'"),
    ".vtp": (b'type="PolyData"', b"type='PolyData'"),
    ".vtk": (b"# vtk DataFile",),
    ".msh": (b"$MeshFormat",),
    ".inp": (b"*NODE", b"*Node", b"*node", b"*HEADING", b"*Heading"),
    ".mesh": (b"MeshVersionFormatted",),
    ".off": (b"OFF",),
    ".ply": (b"ply",),
    ".vol": (b"mesh3d",),
    ".su2": (b"NDIME",),
    ".bdf": (b"GRID",),
    ".nas": (b"GRID",),
}


def main_file(path: Path) -> Path:
    """Return the file of a folder that describes its series, or `path` itself."""
    if not path.is_dir():
        return path
    found = [file for file in sorted(path.iterdir()) if file.suffix.lower() in _LISTS]
    if len(found) > 1:
        raise NotATrajectory(
            f"{len(found)} series: " + ", ".join(file.name for file in found),
            expected="one in a folder",
            fix="name one of these files",
            file=path,
        )
    return found[0] if found else path


def kind_of(path: Path) -> str:
    """Return ``xdmf``, ``vtkhdf`` or ``files``."""
    if path.is_dir():
        return "files"
    suffix = path.suffix.lower()
    if suffix in _XDMF:
        return "xdmf"
    if suffix in FORMATS or suffix in (".pvd", ".series"):
        return "files"
    head = _head(path)
    if b"<Xdmf" in head:
        return "xdmf"
    return "vtkhdf" if suffix == ".vtkhdf" or head[:4] == b"\x89HDF" else "files"


def sureness(path: Path) -> float:
    """Say how sure it is that `path` is a series, or a mesh of a format that is read."""
    try:
        if path.is_dir():
            return _sureness_of_folder(path)
        suffix = path.suffix.lower()
        head = _head(path)
        if head[:8] == safety.HDF5_SIGNATURE:
            return _sureness_of_hdf5(path)
        if b"<Xdmf" in head:
            return 1.0
        if (b"<VTKFile" in head and b'"Collection"' in head) or b'"file-series-version"' in head:
            return 1.0
        if suffix in FORMATS:
            signs = _SIGNS.get(suffix, ())
            return 0.7 if any(sign in head for sign in signs) else 0.3
        return 0.3 if suffix in _LISTS else 0.0
    except OSError:
        return 0.0


def _sureness_of_folder(folder: Path) -> float:
    lists = [file for file in folder.iterdir() if file.suffix.lower() in _LISTS]
    if lists:
        return min(0.7, sureness(lists[0])) if len(lists) == 1 else 0.3
    try:
        members = family(folder, tuple(FORMATS))
    except OpenPRCError:
        return 0.3
    return sureness(members[0][1]) if len(members) > 1 else 0.0


def _sureness_of_hdf5(path: Path) -> float:
    try:
        # Only the root is looked at here; `open_hdf5` walks through all of it later.
        with h5py.File(path, "r", locking="best-effort") as file:
            if isinstance(file.get("VTKHDF", getlink=True), h5py.HardLink):
                return 1.0
            # The group of meshes of a MED file.
            return 0.7 if isinstance(file.get("ENS_MAA", getlink=True), h5py.HardLink) else 0.0
    except DAMAGE:
        return 0.3 if path.suffix.lower() == ".vtkhdf" else 0.0


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(_HEAD)
