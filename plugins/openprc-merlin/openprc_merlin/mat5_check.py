"""A check of every element of a level 5 file before SciPy decodes it.

SciPy looks data types up in a table without asking whether they are in it: one wrong byte in
an uncompressed file ends the process. Here every tag is visited, and nothing is copied out.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

#: Data types of numbers and of text; 14 and 15 hold other elements.
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_TEXT = _NUMBERS | {16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 0x0800
_MATRIX = 14
_MAX_DEPTH = 32


def check_matrix(data: bytes, order: str) -> None:
    """Visit every tag inside the payload of one matrix element.

    Parameters
    ----------
    data : bytes
        The payload, decompressed, without its own tag.
    order : ``"<"`` or ``">"``

    Raises
    ------
    ValueError
        When a type is unknown, an element does not fit, or a container promises more members
        than there are bytes.
    """
    _Walk(data, order).matrix(0, len(data), 0)


class _Walk:
    """Visits elements; offsets count from the beginning of `data`."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data = data
        self._order = order

    def matrix(self, begin: int, end: int, depth: int) -> None:
        """Check the payload of a matrix element between two offsets."""
        if begin == end:
            return
        if depth > _MAX_DEPTH:
            raise ValueError(f"arrays nest deeper than {_MAX_DEPTH}")
        parts = self._elements(begin, end)
        flags = self._numbers(next(parts, None), "array flags")[0]
        kind = flags & 0xFF
        if kind == _OPAQUE:
            for what in ("name", "type system", "class"):
                self._typed(next(parts, None), _TEXT, what)
            self._members(parts, 1, depth)
            return
        shape = self._numbers(next(parts, None), "dimensions")
        if not shape or len(shape) > 32 or min(shape) < 0:
            raise ValueError(f"dimensions {shape[:4]}")
        n_elements = math.prod(shape)
        self._typed(next(parts, None), _TEXT, "name")
        if kind == _CELL:
            self._members(parts, n_elements, depth, room=end - begin)
        elif kind in (_STRUCT, _OBJECT):
            if kind == _OBJECT:
                self._typed(next(parts, None), _TEXT, "class name")
            width = self._numbers(next(parts, None), "length of field names")
            _, first, last = self._typed(next(parts, None), _TEXT, "field names")
            if not width or width[0] < 1:
                raise ValueError("field names of no length")
            n_fields = (last - first) // width[0]
            self._members(parts, n_elements * n_fields, depth, room=end - begin)
        elif kind == _FUNCTION:
            self._members(parts, 1, depth)
        elif kind == _CHAR:
            self._typed(next(parts, None), _TEXT, "text")
        elif kind == _SPARSE:
            for what in ("rows", "columns", "values"):
                self._typed(next(parts, None), _NUMBERS, what)
            if flags & _COMPLEX:
                self._typed(next(parts, None), _NUMBERS, "imaginary part")
        elif 6 <= kind <= 15:
            self._typed(next(parts, None), _NUMBERS, "values")
            if flags & _COMPLEX:
                self._typed(next(parts, None), _NUMBERS, "imaginary part")
        else:
            raise ValueError(f"array class {kind}")

    def _members(
        self,
        parts: Iterator[tuple[int, int, int]],
        count: int,
        depth: int,
        *,
        room: int | None = None,
    ) -> None:
        if room is not None and 8 * count > room:
            raise ValueError(f"{count} members in {room} bytes")
        for _ in range(count):
            _, begin, end = self._typed(next(parts, None), {_MATRIX}, "member")
            self.matrix(begin, end, depth + 1)

    def _elements(self, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Yield type, first and last offset of the payload of each sub-element."""
        offset = begin
        while offset + 8 <= end:
            (word,) = struct.unpack_from(self._order + "I", self._data, offset)
            if word >> 16:  # a small element shares its tag
                kind, size, first, step = word & 0xFFFF, word >> 16, offset + 4, 8
                if size > 4:
                    raise ValueError(f"a small element of {size} bytes")
            else:
                (size,) = struct.unpack_from(self._order + "I", self._data, offset + 4)
                kind, first, step = word, offset + 8, 8 + -(-size // 8) * 8
            if first + size > end:
                raise ValueError(f"an element of {size} bytes in {end - first}")
            yield kind, first, first + size
            offset += step

    def _typed(
        self, part: tuple[int, int, int] | None, kinds: frozenset[int] | set[int], what: str
    ) -> tuple[int, int, int]:
        if part is None:
            raise ValueError(f"the {what} are missing")
        if part[0] not in kinds:
            raise ValueError(f"the {what} have the unknown type {part[0]}")
        return part

    def _numbers(self, part: tuple[int, int, int] | None, what: str) -> tuple[int, ...]:
        """Read an element of int32 or uint32."""
        kind, first, last = self._typed(part, {5, 6}, what)
        letter = "i" if kind == 5 else "I"
        count = (last - first) // 4
        if count == 0:
            raise ValueError(f"the {what} are empty")
        return struct.unpack_from(f"{self._order}{count}{letter}", self._data, first)
