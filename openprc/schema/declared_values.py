"""Turning what a producer declares into values that the contract can store, or refusing it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import SchemaError, UnitError
from openprc.schema import units
from openprc.schema.layout import PHYSICAL_DIMENSIONS
from openprc.schema.plain_text import storable

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]*\Z")


class DeclaredValues:
    """The checks of `Declarations`, each naming the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def _unit(self, symbol: str, key: str) -> dict[str, Any]:
        found = units.unit(symbol, file=str(self.path), key=key)
        allowed = PHYSICAL_DIMENSIONS.get(key)
        if allowed and found.dimension not in allowed:
            raise UnitError(
                f"{symbol!r}, a unit of {found.dimension}",
                expected=f"a unit of {' or '.join(allowed)}",
                fix="correct the call",
                file=self.path,
                key=key,
            )
        return {"unit": symbol, "si_factor": found.si_factor}

    def _floats(self, key: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
        array = self._numbers(key, values)
        self._shape(key, array.shape, shape)
        if not np.isfinite(array).all():
            raise self._error(key, "NaN or infinite values", "finite numbers")
        return array

    def _numbers(self, key: str, values: ArrayLike) -> NDArray[np.float64]:
        try:
            array = np.asarray(values)
            if array.dtype.kind not in "fiub":
                raise TypeError(f"type {array.dtype}")
        except (TypeError, ValueError) as error:
            raise self._error(key, f"not real numbers: {error}", "real numbers") from error
        return array.astype("f8")

    def _constants(self, key: str, values: ArrayLike) -> NDArray[Any]:
        """Return constants in one of the types of the table: f8, f4, i4, u1 or text."""
        if is_text(values):
            return self._text(key, values)
        array = np.asarray(values)
        if array.dtype.kind == "b":
            return array.astype("u1")
        if array.dtype.kind in "iu":
            narrow = array.astype("i4")
            if not np.array_equal(narrow, array):
                raise self._error(key, "an integer beyond 32 bits", "smaller numbers, or floats")
            return narrow
        return array if array.dtype == "f4" else self._numbers(key, values)

    def _text(self, key: str, values: Any) -> NDArray[Any]:
        words = [storable(item, key=key, file=self.path) for item in values]
        return np.array(words, dtype=h5py.string_dtype())

    def _shape(self, key: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
        if tuple(found) != tuple(wanted):
            raise self._error(key, f"shape {tuple(found)}", f"{tuple(wanted)}")

    def _unique(self, key: str, values: list[Any], n: int) -> None:
        self._shape(key, (len(values),), (n,))
        if len(set(values)) != n:
            double = next(v for i, v in enumerate(values) if v in values[:i])
            raise self._error(key, f"{double!r} twice", "unique values")

    def _columns(self, key: str, columns: Sequence[str]) -> tuple[str, ...]:
        wanted = "a list of unique names"
        if isinstance(columns, str) or not len(columns):
            raise self._error(key, f"columns {columns!r}", wanted)
        names = tuple(self._text(key, columns).tolist())
        if len(set(names)) != len(names) or not all(names):
            raise self._error(key, f"columns {columns!r}", wanted)
        return names

    def _name(self, name: str, key: str) -> str:
        if not isinstance(name, str) or not _NAME.match(name):
            raise self._error(key, f"the name {name!r}", "letters, digits, '_', '-', '.', ' '")
        return name

    def _error(self, key: str, found: str, expected: str) -> SchemaError:
        return SchemaError(
            found,
            expected=expected,
            fix="correct the call",
            file=self.path,
            key=key or None,
        )


def is_text(values: ArrayLike) -> bool:
    """Tell whether values are a list or an array of text."""
    if isinstance(values, list | tuple):
        return bool(values) and all(isinstance(item, str) for item in values)
    return isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "US"
