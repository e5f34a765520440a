"""Reading single datasets and attributes of input files, with messages that name them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from openprc.errors import ConfigError, SchemaTooNew
from openprc.schema.units import conversion_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Version of the present layout of geometry.h5 and signals.h5.
SCHEMA = "1.0"


class DatasetReader:
    """Reads datasets of one file as SI arrays, with messages that name file and dataset."""

    def __init__(self, file: h5py.File, path: Path) -> None:
        self.file = file
        self.path = path

    def has(self, key: str) -> bool:
        """Say whether there is a dataset or group of that name."""
        return key in self.file

    def get(self, key: str, *, kind: str, unit: str | None = None) -> NDArray[Any]:
        """Return a dataset; `kind` is "number", "integer" or "switch".

        Raises
        ------
        ConfigError
            When it is missing or of another kind.
        """
        node = self.file.get(key)
        if not isinstance(node, h5py.Dataset):
            raise ConfigError(
                "the dataset is missing" if node is None else "this is a group",
                expected="a dataset",
                fix="write the file with openprc.schema.save_experiment",
                file=self.path,
                key=key,
            )
        allowed = {"number": "fiu", "integer": "iu", "switch": "biu"}[kind]
        if node.dtype.kind not in allowed:
            raise ConfigError(
                f"the type {node.dtype}", expected=f"a {kind} type", file=self.path, key=key
            )
        values: NDArray[Any] = node[()]
        if kind == "integer" and values.size and np.abs(values.astype("f8")).max() > 2**31 - 1:
            raise ConfigError(
                "a number beyond 32 bits", expected="node numbers", file=self.path, key=key
            )
        if kind == "number":
            values = np.asarray(values, dtype="f8")
        stored = read_text(node.attrs.get("unit"))
        if unit is not None and stored is not None and stored != unit:
            values = values * conversion_factor(stored, unit, file=str(self.path), key=key)
        return values


def read_text(value: object) -> str | None:
    """Return a text attribute, or None when it is absent or not text."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else None


def is_new_layout(file: h5py.File, path: Path, kind: str) -> bool:
    """Say whether `file` declares the present layout.

    Raises
    ------
    SchemaTooNew, ConfigError
        When it declares another version or another kind of file.
    """
    version = read_text(file.attrs.get("openprc_schema"))
    if version is None:
        return False
    if version.partition(".")[0] != SCHEMA.partition(".")[0]:
        raise SchemaTooNew(
            f"layout version {version}",
            expected=f"version {SCHEMA} or another 1.x",
            fix="install a newer openprc",
            file=path,
            key="openprc_schema",
        )
    stored = read_text(file.attrs.get("kind"))
    if stored != kind:
        raise ConfigError(
            f"the file says it is of kind {stored!r}", expected=repr(kind), file=path, key="kind"
        )
    return True


def read_number(value: object, path: Path, key: str) -> float:
    """Return a scalar attribute as a float.

    Raises
    ------
    ConfigError
        When it is missing or not one number.
    """
    array = None if value is None else np.asarray(value)
    if array is None or array.size != 1 or array.dtype.kind not in "fiu":
        raise ConfigError(
            "the attribute is missing" if array is None else f"found {value!r}",
            expected="one number",
            file=path,
            key=key,
        )
    return float(array.reshape(()))
