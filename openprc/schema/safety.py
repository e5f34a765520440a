"""Opening files of unknown origin.

HDF5 can point outside itself (external links, external raw storage, virtual datasets), can
claim terabytes that it does not hold, and reads what was never written as zeros. Nothing of
that may pass. Archives and pickles are handled in `openprc.schema.archives` and
`openprc.schema.pickles` and re-exported here.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import h5py

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema.archives import load_npz, npz_headers
from openprc.schema.damage import DAMAGE
from openprc.schema.pickles import PicklePreview, load_pickle, preview_pickle

__all__ = [
    "PicklePreview",
    "check_readable",
    "is_hdf5",
    "load_npz",
    "load_pickle",
    "npz_headers",
    "open_hdf5",
    "preview_pickle",
]

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
MAX_DEPTH = 32
MAX_OBJECTS = 200_000
#: Below this, an unwritten dataset is a blemish and not an attack.
SMALL = 1 << 20
#: Deflate cannot do better than about 1032 to 1.
MAX_RATIO = 1100


def check_readable(path: str | Path) -> Path:
    """Return `path` if it is a file with something in it.

    Raises
    ------
    UnreadableFile
        When it is missing, a directory, or empty.
    """
    path = Path(path)
    try:
        there = path.exists()
        if path.is_file():
            path.open("rb").close()
    except OSError as error:
        raise UnreadableFile(
            f"the system does not open it: {error.strerror or error}",
            expected="a file that you may read",
            fix="check the name and the permissions",
            file=path,
        ) from error
    if not there:
        near = _neighbours(path)
        raise UnreadableFile(
            "the file does not exist",
            expected="an existing file",
            fix=f"check the spelling{near}",
            file=path,
        )
    if path.is_dir():
        raise UnreadableFile(
            "this is a directory",
            expected="a file",
            fix="name a file inside it",
            file=path,
        )
    if path.stat().st_size == 0:
        raise UnreadableFile(
            "the file is empty (0 bytes)",
            expected="a file with content",
            fix="copy or export it again; the program that wrote it may not have closed it",
            file=path,
        )
    return path


def _neighbours(path: Path) -> str:
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist either"
    partial = path.with_name(path.name + ".partial")
    if partial.exists():
        return f"; {partial.name} is there: a run that did not finish, see `openprc repair`"
    return ""


def is_hdf5(path: str | Path) -> bool:
    """Tell whether the HDF5 signature stands at offset 0, 512, 1024, 2048, ..."""
    path = Path(path)
    size = path.stat().st_size
    offset = 0
    with path.open("rb") as stream:
        while offset < min(size, 1 << 20):
            stream.seek(offset)
            if stream.read(8) == HDF5_SIGNATURE:
                return True
            offset = 512 if offset == 0 else offset * 2
    return False


def open_hdf5(
    path: str | Path,
    *,
    allow_references: bool = False,
    allow_vlen: bool = False,
    allow_soft_links: bool = False,
    unfinished: bool = False,
) -> h5py.File:
    """Open an HDF5 file read-only after a walk over every link in it.

    The caller closes the file. Of an `unfinished` file of the contract only the rows below
    ``/committed`` have to be there: a killed writer may have announced more.

    Raises
    ------
    UnreadableFile
        Missing, empty, not HDF5, truncated, or stored with a filter that is not installed.
    UnsafeFile
        Something in it leads outside, or claims more data than the file can hold.
    """
    path = check_readable(path)
    if not is_hdf5(path):
        with path.open("rb") as stream:
            head = stream.read(24)
        raise UnreadableFile(
            f"this is not HDF5: it begins with {head!r}",
            expected="the HDF5 signature",
            fix="if it is a foreign format, try `openprc import`; otherwise export it again",
            file=path,
        )
    try:
        file = h5py.File(path, "r", locking="best-effort")
    except BlockingIOError as error:
        raise UnreadableFile(
            "another process is writing this file",
            expected="a file that nobody writes to",
            fix="wait for the run to end",
            file=path,
        ) from error
    except OSError as error:
        raise UnreadableFile(
            f"HDF5 cannot open it: {_reason(error)}",
            expected="a file that was closed properly",
            fix="copy it again; for an OpenPRC file that was cut off, try `openprc repair`",
            file=path,
        ) from error
    try:
        _walk(
            file,
            path,
            references=allow_references,
            vlen=allow_vlen,
            soft=allow_soft_links,
            committed=_committed(file) if unfinished else None,
        )
    except DAMAGE as error:
        # Damaged metadata surfaces here as any of these, depending on which byte was hit.
        file.close()
        raise UnreadableFile(
            f"its structure is damaged: {_reason(error)}",
            expected="readable HDF5 metadata",
            fix="copy or export the file again",
            file=path,
        ) from error
    except (UnsafeFile, UnreadableFile):
        file.close()
        raise
    return file


def _reason(error: Exception) -> str:
    text = str(error).strip().strip("'\"")
    return text.splitlines()[0] if text else type(error).__name__


def _committed(file: h5py.File) -> int | None:
    # Read before the walk, so nothing that leads elsewhere may be followed here.
    if not isinstance(file.get("committed", getlink=True), h5py.HardLink):
        return None
    item = file["committed"]
    plain = isinstance(item, h5py.Dataset) and not item.is_virtual and not item.external
    return int(item[()]) if plain and item.shape == () and item.dtype.kind == "i" else None


def _walk(
    file: h5py.File,
    path: Path,
    *,
    references: bool,
    vlen: bool,
    soft: bool,
    committed: int | None,
) -> None:
    seen: set[int] = set()
    pending: list[tuple[h5py.Group, int]] = [(file, 0)]
    count = 0
    while pending:
        group, depth = pending.pop()
        if depth > MAX_DEPTH:
            raise _unsafe(path, group.name, f"groups are nested deeper than {MAX_DEPTH}")
        for name in group:
            count += 1
            if count > MAX_OBJECTS:
                raise _unsafe(path, group.name, f"more than {MAX_OBJECTS} objects")
            where = f"{group.name.rstrip('/')}/{name}"
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise _unsafe(path, where, f"an external link into {link.filename!r}")
            if isinstance(link, h5py.SoftLink):
                if soft:
                    continue
                raise _unsafe(path, where, f"a soft link to {link.path!r}")
            # The link knows the address; asking the object would walk all its chunks.
            address = group.id.links.get_info(name.encode("utf-8", "surrogateescape")).u
            if address in seen:
                continue
            seen.add(address)
            item = group[name]
            if isinstance(item, h5py.Group):
                pending.append((item, depth + 1))
            elif isinstance(item, h5py.Dataset):
                _check_dataset(item, path, where, references=references, vlen=vlen)
                _check_size(item, path, where, committed)


def _check_dataset(
    item: h5py.Dataset, path: Path, where: str, *, references: bool, vlen: bool
) -> None:
    if item.is_virtual:
        raise _unsafe(path, where, "a virtual dataset, which reads other files")
    if item.external:
        raise _unsafe(path, where, f"external raw storage in {item.external[0][0]!r}")
    _check_dtype(item.dtype, path, where, references=references, vlen=vlen)
    plist = item.id.get_create_plist()
    for index in range(plist.get_nfilters()):
        code, _, _, label = plist.get_filter(index)
        if not h5py.h5z.filter_avail(code):
            raise UnreadableFile(
                f"stored with filter {code} ({label.decode(errors='replace')}), not installed",
                expected="gzip, shuffle, fletcher32, lzf or szip",
                fix="write the file again without that filter",
                file=path,
                key=where,
            )


def _check_size(item: h5py.Dataset, path: Path, where: str, committed: int | None) -> None:
    if item.shape is None or item.size == 0:
        return
    declared = item.size * item.dtype.itemsize
    if declared <= SMALL:
        return
    if committed is not None and item.maxshape[0] is None and item.chunks[1:] == item.shape[1:]:
        lost = _first_row_not_there(item, committed)
        if lost is not None:
            raise _unsafe(path, where, f"row {lost} is committed and was never written")
        return
    stored = item.id.get_storage_size()
    ratio = MAX_RATIO if item.id.get_create_plist().get_nfilters() else 1
    if stored * ratio < declared:
        raise _unsafe(
            path,
            where,
            f"claims {declared:,} bytes and holds {stored:,}; the rest would read as zeros",
        )


def _first_row_not_there(item: h5py.Dataset, committed: int) -> int | None:
    there: set[int] = set()
    # The part of the index that the killed writer was at may be damaged; the rest counts.
    with suppress(*DAMAGE):
        item.id.chunk_iter(lambda chunk: there.add(chunk.chunk_offset[0]))
    rows = range(0, min(committed, item.shape[0]), item.chunks[0])
    return next((row for row in rows if row not in there), None)


def _check_dtype(dtype: object, path: Path, where: str, *, references: bool, vlen: bool) -> None:
    fields = getattr(dtype, "fields", None)
    if fields:
        for field in fields.values():
            _check_dtype(field[0], path, where, references=references, vlen=vlen)
        return
    if h5py.check_string_dtype(dtype) is not None:
        return
    if h5py.check_ref_dtype(dtype) is not None and not references:
        raise _unsafe(path, where, "object references, which can point at anything")
    if h5py.check_vlen_dtype(dtype) is not None and not vlen:
        raise _unsafe(path, where, "variable-length arrays, whose size cannot be checked")


def _unsafe(path: Path, where: str, found: str) -> UnsafeFile:
    return UnsafeFile(
        found,
        expected="a file whose data are all inside it",
        fix="ask its author for a plain copy (h5repack makes one), or do not open it",
        file=path,
        key=where,
    )
