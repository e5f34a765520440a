"""VTK's XML files of polygonal data (``.vtp``) and unstructured grids (``.vtu``).

meshio and meshlane do not know ``.vtp``, nor newer versions of ``.vtu``; they fail on some of the
files with bytes at the end that ParaView writes by default, and unpack LZMA without a limit.
Format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

from __future__ import annotations

import base64
import lzma
import math
import zlib
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile, UnsafeFile
from openprc.schema.safety import MAX_RATIO
from openprc_meshio import safe_xml, vtk_shapes
from openprc_meshio.frames import Array, Cells

Ints = NDArray[np.int64]

_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
#: What numbers and heads that were damaged lead to.
_FAULTS = (ArithmeticError, EOFError, LookupError, MemoryError, ValueError)
_KINDS = ("PolyData", "UnstructuredGrid")


class VtkXmlFrame:
    """One file of polygonal data, or one unstructured grid, of a single piece."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.same_points: object = None
        self.same_cells: object = None
        self.timed = True
        self.said = ""
        self.by = "this plugin itself"
        self._root = root = safe_xml.parse(path, stop_at="AppendedData")
        kind = root.get("type", "")
        grid = root.find(kind) if kind in _KINDS else None
        pieces = [] if grid is None else grid.findall("Piece")
        full = [piece for piece in pieces if piece.get("NumberOfPoints", "0") != "0"]
        if root.tag != "VTKFile" or grid is None or len(full) != 1:
            raise self._wrong(
                f"{root.tag} of type {kind!r} with {len(full)} pieces that are not empty",
                "a VTKFile of type PolyData or UnstructuredGrid in one piece",
            )
        self._grid, self._piece = grid, full[0]
        order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        self._order = order
        self._head = np.dtype(order + _TYPES.get(root.get("header_type", "UInt32"), "u4"))
        self.point_names = self._names("PointData")
        self.cell_names = self._names("CellData")

    # --- what is asked ------------------------------------------------------------------------

    @property
    def time(self) -> float | None:
        """The time that VTK writes into the file, if there is one."""
        for item in self._grid.findall("FieldData/DataArray") if self.timed else ():
            if item.get("Name") == "TimeValue":
                value = self._array(item, 1)
                return float(value[0])
        return None

    def points(self) -> Array:
        """Return the places, (N, 3)."""
        return self._array(self._item("Points", None), self._count("NumberOfPoints"))

    def point_field(self, name: str) -> Array:
        """Return a field of the points."""
        return self._array(self._item("PointData", name), self._count("NumberOfPoints"))

    def cells(self) -> list[Cells]:
        """Return the cells, block by block."""
        return [block for block, _ in self._blocks]

    def cell_field(self, name: str) -> list[Array | None]:
        """Return a field of the cells, one array a block."""
        total = sum(len(rows) for _, rows in self._blocks)
        values = self._array(self._item("CellData", name), total)
        return [values[rows] for _, rows in self._blocks]

    @cached_property
    def _blocks(self) -> list[tuple[Cells, Ints]]:
        if self._root.get("type") == "UnstructuredGrid":
            count = self._count("NumberOfCells")
            types = self._array(self._item("Cells", "types"), count).astype(np.int64)
            return self._cut("Cells", types, 0)
        found: list[tuple[Cells, Ints]] = []
        before = 0
        for kind, code in vtk_shapes.POLYDATA.items():
            count = self._count(f"NumberOf{kind}")
            if count:
                found += self._cut(kind, np.full(count, code), before)
            before += count
        return found

    def _cut(self, group: str, types: Ints, before: int) -> list[tuple[Cells, Ints]]:
        if not len(types):
            return []
        ends = self._array(self._item(group, "offsets"), len(types)).astype(np.int64)
        ends = np.concatenate([[0], ends])
        size = int(ends[-1])
        nodes = self._array(self._item(group, "connectivity"), size).astype(np.int64)
        if not vtk_shapes.fits(ends, nodes):
            raise self._wrong(f"offsets of {group} that leave the cells", "0, ..., all of them")
        return [(b, rows + before) for b, rows in vtk_shapes.split(types, ends, nodes)]

    # --- arrays -------------------------------------------------------------------------------

    def _names(self, group: str) -> tuple[str, ...]:
        items = self._piece.findall(f"{group}/DataArray")
        return tuple(item.get("Name", "") for item in items if item.get("type") in _TYPES)

    def _item(self, group: str, name: str | None) -> Element:
        for item in self._piece.findall(f"{group}/DataArray"):
            if name is None or item.get("Name") == name:
                return item
        raise self._wrong(f"no array {name or 'of points'} in {group}", "one")

    def _count(self, name: str) -> int:
        text = self._piece.get(name, "0")
        if not text.isdigit():
            raise self._wrong(f"{name} {text!r}", "a whole number")
        return int(text)

    def _array(self, item: Element, rows: int) -> Array:
        kind = _TYPES.get(item.get("type", ""))
        width = item.get("NumberOfComponents") or "1"
        if kind is None or not width.isdigit() or width == "0":
            raise self._wrong(f"an array of type {item.get('type')!r} x {width}", "numbers")
        dtype = np.dtype(self._order + kind)
        size = rows * int(width) * dtype.itemsize
        if size > MAX_RATIO * self.path.stat().st_size:
            raise UnsafeFile(
                f"claims {size:,} bytes in an array",
                expected="a file whose data are all inside it",
                fix="do not open it",
                file=self.path,
                key=item.get("Name"),
            )
        try:
            if item.get("format", "ascii") == "ascii":
                values = np.array((item.text or "").split(), dtype=dtype)
            else:
                values = np.frombuffer(self._bytes(item, size), dtype=dtype)
        except (*_FAULTS, zlib.error, lzma.LZMAError) as error:
            raise self._wrong(f"array {item.get('Name')!r}: {error}", "data as written") from None
        if values.size != rows * int(width):
            raise self._wrong(
                f"array {item.get('Name')!r} holds {values.size} numbers",
                f"{rows} x {width}",
            )
        values = values.reshape(rows, int(width))
        return values[:, 0] if width == "1" else values

    def _bytes(self, item: Element, size: int) -> bytes:
        if item.get("format") != "appended":
            text = "".join((item.text or "").split())
            return self._unpack(_Base64(text.encode()), size)
        start = int(item.get("offset", "x"))
        raw = self._root.find("AppendedData")
        stored = _Raw if raw is not None and raw.get("encoding") == "raw" else _Base64
        return self._unpack(stored(self._appended, start), size)

    @cached_property
    def _appended(self) -> bytes:
        data = self.path.read_bytes()
        start = data.find(b"_", data.find(b">", data.find(b"<AppendedData")))
        return data[start + 1 :]

    def _unpack(self, source: _Raw, size: int) -> bytes:
        """Return `size` bytes: as they are, or unpacked block by block and never beyond."""
        step = self._head.itemsize
        packer = self._root.get("compressor")
        if packer is None:
            return source.take(step + size)[step:]
        count = int(np.frombuffer(source.take(step), self._head)[0])
        if count > MAX_RATIO * self.path.stat().st_size:
            raise ValueError(f"{count} blocks")
        head = source.take(step * (3 + count))
        lengths = np.frombuffer(head, self._head)[3:].astype(np.int64)
        packed = source.rest(int(lengths.sum()))
        ends = np.concatenate([[0], np.cumsum(lengths)])
        out = bytearray()
        for low, high in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            out += _expand(packed[low:high], packer, size - len(out))
        return bytes(out)

    def _wrong(self, found: str, expected: str) -> UnreadableFile:
        return UnreadableFile(
            found, expected=expected, fix="export or copy it again", file=self.path, key="VTKFile"
        )


def _expand(data: bytes, packer: str, room: int) -> bytes:
    if packer == "vtkZLibDataCompressor":
        return zlib.decompressobj().decompress(data, room + 1)
    if packer == "vtkLZMADataCompressor":
        return lzma.LZMADecompressor().decompress(data, room + 1)
    raise ValueError(f"packed by {packer}; save it with zlib or unpacked")


class _Raw:
    """Bytes as they stand in the file from `start` on: a head, and numbers behind it."""

    def __init__(self, data: bytes, start: int = 0) -> None:
        self._data = data
        self._start = start
        self._behind = start

    def take(self, size: int) -> bytes:
        """Return the first bytes; `rest` goes on behind them."""
        self._behind = self._start + size
        return self._data[self._start : self._behind]

    def rest(self, size: int) -> bytes:
        """Return bytes behind those that were taken last."""
        return self._data[self._behind : self._behind + size]


class _Base64(_Raw):
    """The same in base64, where head and packed numbers are encoded apart."""

    def take(self, size: int) -> bytes:
        """Return the first bytes; `rest` goes on behind them."""
        return base64.b64decode(super().take(4 * math.ceil(size / 3)))[:size]

    def rest(self, size: int) -> bytes:
        """Return bytes behind those that were taken last."""
        return base64.b64decode(super().rest(4 * math.ceil(size / 3)))[:size]


def reads(path: Path) -> bool:
    """Tell whether a VTK XML file needs this reader, and not meshlane or meshio.

    Raises
    ------
    UnreadableFile, UnsafeFile
        When it is not XML, or not safe.
    """
    root = safe_xml.parse(path, stop_at="AppendedData")
    bytes_behind = root.find("AppendedData")
    usual = (None, "vtkZLibDataCompressor")
    return (
        path.suffix.lower() == ".vtp"
        or root.get("type") == "PolyData"
        or (bytes_behind is not None and bytes_behind.get("encoding") == "raw")
        or root.get("compressor") not in usual
        or root.get("version", "1.0") not in ("0.1", "1.0")
    )
