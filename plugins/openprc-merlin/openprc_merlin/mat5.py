"""MAT-files of level 5 (MATLAB v6 and v7, Octave -v6 and -v7).

The directory of variables is read here, by tags only, because SciPy's own listing stops at
MATLAB objects; the values are read by SciPy. Layout: "MAT-File Format", The MathWorks.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema import safety
from openprc_merlin.mat5_check import check_matrix

HEADER_BYTES = 128
MI_MATRIX, MI_COMPRESSED = 14, 15
#: Refuse files whose variables would unpack to more than this.
MAX_BYTES = 32 << 30
#: Deflate cannot do better than about 1032 to 1.
MAX_RATIO = 1100
CLASSES = {
    1: "cell",
    2: "struct",
    3: "object",
    4: "char",
    5: "sparse",
    6: "double",
    7: "single",
    8: "int8",
    9: "uint8",
    10: "int16",
    11: "uint16",
    12: "int32",
    13: "uint32",
    14: "int64",
    15: "uint64",
    16: "function",
    17: "opaque",
}
NUMERIC = frozenset(range(6, 16))
#: Classes that are read; objects, opaque data, sparse matrices and bare handles are not.
READ = frozenset({1, 2, 4, 16}) | NUMERIC


@dataclass(frozen=True, slots=True)
class FunctionHandle:
    """The text of a function handle, such as ``"@(Ex)Ogden(Ex,E0)"``."""

    text: str


@dataclass(frozen=True, slots=True)
class Entry:
    """One variable of a MAT-file.

    Attributes
    ----------
    name, kind, shape : of the variable; `kind` is a key of `CLASSES`
    n_bytes : size in memory
    offset, stored : where its element stands behind the tag, and its length there
    compressed : whether it does so compressed
    """

    name: str
    kind: int
    shape: tuple[int, ...]
    n_bytes: int
    offset: int = 0
    stored: int = 0
    compressed: bool = False


def _damaged(path: Path, found: str, error: Exception | None = None) -> UnreadableFile:
    detail = f": {type(error).__name__}: {error}" if error is not None else ""
    return UnreadableFile(
        f"the MAT-file is damaged or cut off ({found}){detail}",
        expected="a complete MAT-file",
        fix="save it again in MATLAB or Octave, or copy it again",
        file=path,
    )


def directory(path: Path) -> tuple[Entry, ...]:
    """List the variables of a MAT-file without reading their values.

    Variables without a name (the block of function workspaces, MATLAB objects in some
    versions) appear with the name ``""``.

    Raises
    ------
    UnreadableFile
        When the file is cut off or a tag makes no sense.
    UnsafeFile
        When it claims more data than its size allows.
    """
    size = path.stat().st_size
    entries: list[Entry] = []
    total = 0
    with path.open("rb") as stream:
        order = _byte_order(stream, path)
        position = HEADER_BYTES
        while position < size:
            stream.seek(position)
            entry, position = _entry(stream, position, size, order=order, path=path)
            entries.append(entry)
            total += entry.n_bytes
            if total > MAX_BYTES:
                raise UnsafeFile(
                    f"its variables would unpack to more than {MAX_BYTES >> 30} GiB",
                    expected="a file that fits in memory",
                    fix="save the needed variables only: truss angles U_his LF_his",
                    file=path,
                )
    return tuple(entries)


def _byte_order(stream: BinaryIO, path: Path) -> str:
    header = stream.read(HEADER_BYTES)
    if len(header) < HEADER_BYTES or header[126:128] not in (b"IM", b"MI"):
        raise _damaged(path, f"the header has {len(header)} bytes or no byte order mark")
    return "<" if header[126:128] == b"IM" else ">"


def _entry(
    stream: BinaryIO, position: int, size: int, *, order: str, path: Path
) -> tuple[Entry, int]:
    tag = stream.read(8)
    if len(tag) < 8:
        raise _damaged(path, f"{len(tag)} stray bytes at {position}")
    kind, n_bytes = struct.unpack(order + "II", tag)
    end = position + 8 + n_bytes
    if end > size:
        raise _damaged(path, f"a variable at {position} reaches {end - size} bytes past the end")
    compressed = kind == MI_COMPRESSED
    if compressed:
        try:
            head = zlib.decompressobj().decompress(stream.read(min(n_bytes, 4096)), 1024)
        except zlib.error as error:
            raise _damaged(path, f"the variable at {position}", error) from error
        if len(head) < 8:
            raise _damaged(path, f"the variable at {position} is empty")
        kind, claimed = struct.unpack(order + "II", head[:8])
        if claimed > n_bytes * MAX_RATIO + 1024:
            raise UnsafeFile(
                f"the variable at {position} claims {claimed:,} bytes and is stored in {n_bytes:,}",
                expected="a size that compression can reach",
                fix="save the file again, or do not open it",
                file=path,
            )
        head = head[8:]
    else:
        claimed, head = n_bytes, stream.read(min(n_bytes, 1024))
    if kind != MI_MATRIX:
        raise _damaged(path, f"an element of type {kind} at {position}")
    try:
        entry = _describe(head, claimed, order)
        return replace(entry, offset=position + 8, stored=n_bytes, compressed=compressed), end
    except (struct.error, ValueError) as error:
        raise _damaged(path, f"the variable at {position}", error) from error


def _describe(head: bytes, n_bytes: int, order: str) -> Entry:
    """Read array flags, dimensions and name from the first bytes of a matrix element."""
    if n_bytes == 0:
        return Entry("", 6, (0, 0), 0)
    offset, flags = _element(head, 0, order)
    kind = struct.unpack(order + "I", flags[:4])[0] & 0xFF
    if kind not in CLASSES:
        raise ValueError(f"array class {kind}")
    shape: tuple[int, ...] = ()
    if kind != 17:  # opaque objects carry no dimensions
        offset, raw = _element(head, offset, order)
        shape = struct.unpack(f"{order}{len(raw) // 4}i", raw)
    _, name = _element(head, offset, order)
    elements = int(np.prod(shape, dtype=object)) if shape else 0
    if kind in NUMERIC and (elements > n_bytes or min(shape, default=0) < 0):
        raise ValueError(f"shape {shape} in {n_bytes} bytes")
    width = 8 if kind in NUMERIC else 1
    return Entry(name.decode("latin-1"), kind, shape, max(n_bytes, width * max(elements, 0)))


def _element(data: bytes, offset: int, order: str) -> tuple[int, bytes]:
    """Return the offset after a sub-element and its payload; small elements share their tag."""
    (kind,) = struct.unpack_from(order + "I", data, offset)
    if kind >> 16:
        n_bytes = kind >> 16
        return offset + 8, data[offset + 4 : offset + 4 + n_bytes]
    (n_bytes,) = struct.unpack_from(order + "I", data, offset + 4)
    start = offset + 8
    if start + n_bytes > len(data):
        raise ValueError(f"a sub-element of {n_bytes} bytes does not fit")
    return start + -(-n_bytes // 8) * 8, data[start : start + n_bytes]


def read(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read every variable that can be represented, and notes about the rest.

    Numbers become float64 (complex128 when complex) whatever width they were packed in,
    because MATLAB stores whole-number doubles as small integers and index arithmetic on
    those overflows. Structs become dictionaries, cells lists, text ``str``.

    Raises
    ------
    UnreadableFile
        When SciPy cannot decode a variable.
    """
    from scipy.io import loadmat

    safety.check_readable(path)
    entries = directory(path)
    names = [entry.name for entry in entries if entry.name and entry.kind in READ]
    _check_content(path, entries)
    notes = []
    skipped = [f"{e.name or 'unnamed'} ({CLASSES[e.kind]})" for e in entries if e.kind not in READ]
    if skipped:
        notes.append(f"skipped: {', '.join(skipped)}")
    if not names:
        return {}, tuple(notes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            # Not mat_dtype=True: SciPy 1.17 then casts complex arrays to real ones.
            raw = loadmat(path, appendmat=False, variable_names=names)
        except (
            ArithmeticError,
            AttributeError,
            EOFError,
            LookupError,
            MemoryError,
            NotImplementedError,
            OSError,
            RecursionError,
            TypeError,
            ValueError,
            struct.error,
            zlib.error,
            _mat_read_error(),
        ) as error:
            # Which of these SciPy raises depends on which byte is wrong.
            raise _damaged(path, "SciPy cannot decode it", error) from error
    notes += sorted(
        {
            f"SciPy: {str(item.message).splitlines()[0]}"
            for item in caught
            if not issubclass(item.category, (DeprecationWarning, FutureWarning))
        }
    )
    return {name: plain(raw[name]) for name in dict.fromkeys(names) if name in raw}, tuple(notes)


def _check_content(path: Path, entries: tuple[Entry, ...]) -> None:
    """Visit every element of what SciPy will decode."""
    with path.open("rb") as stream:
        order = _byte_order(stream, path)
        for entry in entries:
            if entry.kind not in READ or not entry.name:
                continue
            stream.seek(entry.offset)
            data = stream.read(entry.stored)
            try:
                if entry.compressed:
                    data = _unpack(data, order)
                check_matrix(data, order)
            except (ValueError, struct.error, zlib.error) as error:
                raise _damaged(path, f"the variable {entry.name!r}", error) from error


def _unpack(data: bytes, order: str) -> bytes:
    """Decompress one matrix element and return its payload; its tag says how long it is."""
    unpacker = zlib.decompressobj()
    tag = unpacker.decompress(data, 8)
    (size,) = struct.unpack(order + "4xI", tag)
    payload = unpacker.decompress(unpacker.unconsumed_tail, max(size, 1))
    if len(payload) != size:
        raise ValueError(f"{len(payload)} bytes where the tag says {size}")
    # Reading on to the end makes zlib compare its checksum.
    if unpacker.decompress(unpacker.unconsumed_tail, 1) or not unpacker.eof:
        raise ValueError("the compressed data do not end where the tag says")
    return payload


def _mat_read_error() -> type[Exception]:
    from scipy.io.matlab import MatReadError

    return MatReadError


def plain(value: Any) -> Any:
    """Turn what SciPy returns into dictionaries, lists, text and float64 arrays.

    What has no counterpart (sparse matrices, MATLAB objects) becomes None.
    """
    kind = type(value).__name__
    if kind == "MatlabFunction":
        return FunctionHandle(_handle_text(value))
    if kind == "MatlabOpaque" or not isinstance(value, np.ndarray):
        return value if isinstance(value, str) else None
    if value.dtype.names:
        records = [
            {name: plain(record[name]) for name in value.dtype.names}
            for record in value.ravel(order="F")
        ]
        return records[0] if len(records) == 1 else records
    if value.dtype == object:
        return [plain(item) for item in value.ravel(order="F")]
    if value.dtype.kind in "US":
        rows = [str(row) for row in value.ravel()]
        return rows[0] if len(rows) == 1 else "\n".join(rows)
    if value.dtype.kind == "c":
        return value.astype(np.complex128)
    return value.astype(np.float64, copy=False) if value.dtype.kind in "fiub" else None


def _handle_text(value: Any) -> str:
    """Dig the text out of the record of a function handle; "" when it is not there."""
    for key in ("function_handle", "function"):
        names = getattr(value.dtype, "names", None) or ()
        if key not in names or value.size == 0:
            return ""
        value = value.ravel()[0][key]
    return str(value.ravel()[0]) if getattr(value, "size", 0) else ""
