"""XDMF data items: numbers in the XML itself, in HDF5, or in raw binary files.

Model and format: https://www.xdmf.org/index.php/XDMF_Model_and_Format
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema import safety
from openprc.schema.damage import DAMAGE, damage_named
from openprc_meshio.safe_xml import inside

_KINDS = {"float": "f", "int": "i", "uint": "u", "char": "i", "uchar": "u", "short": "i"}
_SIZES = {"char": 1, "uchar": 1, "short": 2}
_ENDIAN = {"native": "=", "little": "<", "big": ">"}


class DataItems:
    """Reads the data items of one XDMF file; heavy files are checked and opened once.

    Parameters
    ----------
    path : Path
        The XDMF file.
    resolve : callable
        Gives the element that ``Reference="XML"`` means.
    stack : ExitStack
        Closes the heavy files.
    """

    def __init__(
        self, path: Path, *, resolve: Callable[[Element], Element], stack: ExitStack
    ) -> None:
        self._path = path
        self._resolve = resolve
        self._stack = stack
        self._files: dict[str, h5py.File] = {}
        self._datasets: dict[str, h5py.Dataset] = {}
        self._inline: dict[int, NDArray[Any]] = {}
        #: Heavy files that were read, in the order of reading.
        self.sources: list[Path] = []

    def key(self, item: Element) -> object:
        """Return what two items that name the same numbers have in common."""
        item = self._resolve(item)
        kind, text = _kind(item), (item.text or "").strip()
        if kind == "hyperslab":
            return tuple(
                (child.text or "").split() if number == 0 else self.key(child)
                for number, child in enumerate(self._children(item))
            ).__repr__()
        if kind == "uniform" and _format(item) != "xml":
            return f"{_format(item)} {text} {item.get('Seek', '0')}"
        return id(item)

    def read(self, item: Element) -> NDArray[Any]:
        """Return the numbers of an item in the shape that it states.

        Raises
        ------
        UnreadableFile
            When they are not there, or are not as many as stated.
        UnsafeFile
            When a heavy file lies outside the folder, or cannot be trusted.
        """
        item = self._resolve(item)
        kind = _kind(item)
        if kind == "uniform":
            data = self._uniform(item)
        elif kind == "hyperslab":
            data = self._hyperslab(item)
        else:
            raise self._wrong(
                f"a data item of type {item.get('ItemType')!r}",
                "numbers, or a HyperSlab of some",
                "export plain arrays",
            )
        shape = self._shape(item)
        if shape is None or data.shape == shape:
            return data
        if math.prod(shape) != data.size:
            raise self._wrong(
                f"an item says Dimensions {item.get('Dimensions')!r} and holds "
                f"{' x '.join(map(str, data.shape))} numbers",
                "as many numbers as it says",
                "export it again",
            )
        return data.reshape(shape)

    # --- one method a way of storing -----------------------------------------------------------

    def _uniform(self, item: Element) -> NDArray[Any]:
        form = _format(item)
        if form == "hdf":
            return self._whole(item)
        if form == "xml":
            if id(item) not in self._inline:
                self._inline[id(item)] = self._numbers(item)
            return self._inline[id(item)]
        if form == "binary":
            return self._binary(item)
        raise self._wrong(
            f"a data item of format {item.get('Format')!r}", "XML, HDF or Binary", "export as HDF"
        )

    def _numbers(self, item: Element) -> NDArray[Any]:
        dtype = self._dtype(item).newbyteorder("=")
        try:
            return np.array((item.text or "").split(), dtype=dtype)
        except (ValueError, OverflowError) as error:
            raise self._wrong(
                f"numbers in the text cannot be read: {error}",
                f"numbers of type {dtype}",
                "export it again",
            ) from None

    def _binary(self, item: Element) -> NDArray[Any]:
        if item.get("Compression", "Raw").lower() != "raw":
            raise self._wrong(
                f"binary data compressed by {item.get('Compression')}", "Raw", "export as HDF"
            )
        file = inside(item.text or "", of=self._path)
        self._remember(file)
        dtype, shape = self._dtype(item), self._shape(item)
        try:
            seek = int(item.get("Seek", "0"))
        except ValueError:
            seek = -1
        room = file.stat().st_size - seek
        count = room // dtype.itemsize if shape is None else math.prod(shape)
        if seek < 0 or count * dtype.itemsize > room:
            raise self._wrong(
                f"{file.name} has {file.stat().st_size} bytes",
                f"{count} numbers of {dtype.itemsize} bytes from byte {item.get('Seek', 0)} on",
                "copy or export it again",
            )
        return np.fromfile(file, dtype=dtype, count=count, offset=seek)

    def _hyperslab(self, item: Element) -> NDArray[Any]:
        children = self._children(item)
        if len(children) != 2:
            raise self._wrong(
                f"a HyperSlab of {len(children)} items", "a selection and what it selects from",
                "export it again",
            )  # fmt: skip
        source = self._resolve(children[1])
        in_file = _kind(source) == "uniform" and _format(source) == "hdf"
        whole = self._dataset(source) if in_file else self.read(source)
        numbers = self.read(children[0]).astype(np.int64).reshape(-1)
        rank = len(whole.shape)
        if numbers.size != 3 * rank:
            raise self._wrong(
                f"a selection of {numbers.size} numbers from {rank} dimensions",
                "start, stride and count of each", "export it again",
            )  # fmt: skip
        start, stride, count = numbers.reshape(3, rank)
        last = start + stride * (count - 1)
        if (
            (start < 0).any()
            or (stride < 1).any()
            or (count < 1).any()
            or (last >= np.array(whole.shape)).any()
        ):
            raise self._wrong(
                f"a selection {numbers.tolist()} from {whole.shape}",
                "a selection inside of it", "export it again",
            )  # fmt: skip
        window = tuple(
            slice(int(a), int(z) + 1, int(s)) for a, z, s in zip(start, last, stride, strict=True)
        )
        with damage_named(self._path):
            return np.asarray(whole[window])

    # --- what they rest on ----------------------------------------------------------------------

    def _dataset(self, item: Element) -> h5py.Dataset:
        """Return a dataset that is read in parts; it stays open, and keeps its cache."""
        text = " ".join((item.text or "").split())
        if text not in self._datasets:
            self._datasets[text] = h5py.Dataset(self._identifier(text))
        return self._datasets[text]

    def _whole(self, item: Element) -> NDArray[Any]:
        """Read a dataset below h5py's objects and selections, which cost more than small reads."""
        text = " ".join((item.text or "").split())
        found = self._identifier(text)
        with damage_named(self._path, text):
            out = np.empty(found.shape, dtype=found.dtype)
            if out.size:
                found.read(h5py.h5s.ALL, h5py.h5s.ALL, out)
        return out

    def _identifier(self, text: str) -> h5py.h5d.DatasetID:
        name, colon, inner = text.rpartition(":")
        if not colon or not inner.strip("/"):
            raise self._wrong(f"an HDF item says {text!r}", "FILE:/PATH/IN/IT", "export it again")
        file = self._open(name)
        try:
            found = h5py.h5d.open(file.id, inner.encode())
            numbers = found.dtype.kind in "fiu" and found.shape is not None
        except DAMAGE:
            numbers = False
        if not numbers:
            raise self._wrong(
                f"there are no numbers at {inner!r} in {name!r}",
                "a dataset of numbers",
                "export it again; the run that wrote it may have been cut off",
            )
        return found

    def _open(self, name: str) -> h5py.File:
        if name not in self._files:
            target = inside(name, of=self._path)
            self._files[name] = self._stack.enter_context(safety.open_hdf5(target))
            self._remember(target)
        return self._files[name]

    def _remember(self, file: Path) -> None:
        if file not in self.sources:
            self.sources.append(file)

    def _children(self, item: Element) -> list[Element]:
        return [child for child in item if child.tag == "DataItem"]

    def _shape(self, item: Element) -> tuple[int, ...] | None:
        text = item.get("Dimensions")
        if text is None:
            return None
        try:
            shape = tuple(int(word) for word in text.split())
        except ValueError:
            shape = ()
        if not shape or min(shape) < 0:
            raise self._wrong(f"Dimensions {text!r}", "whole numbers", "export it again")
        return shape

    def _dtype(self, item: Element) -> np.dtype[Any]:
        name = (item.get("NumberType") or item.get("DataType") or "Float").lower()
        kind = _KINDS.get(name)
        size = item.get("Precision") or str(_SIZES.get(name, 4))
        endian = _ENDIAN.get(item.get("Endian", "Native").lower())
        if (
            kind is None
            or endian is None
            or size not in ("1", "2", "4", "8")
            or kind + size == "f1"
        ):
            raise self._wrong(
                f"numbers of type {name!r}, precision {size!r}, endian {item.get('Endian')!r}",
                "Float, Int, UInt, Char or UChar of 1, 2, 4 or 8 bytes",
                "export it again",
            )
        return np.dtype(f"{endian}{kind}{size}")

    def _wrong(self, found: str, expected: str, fix: str) -> UnreadableFile:
        return UnreadableFile(found, expected=expected, fix=fix, file=self._path, key="DataItem")


def _kind(item: Element) -> str:
    return (item.get("ItemType") or item.get("Type") or "Uniform").lower()


def _format(item: Element) -> str:
    return (item.get("Format") or "XML").lower()
