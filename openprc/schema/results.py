"""readout.h5, metrics.h5 and optimization.h5: one envelope, written whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, SchemaError
from openprc.schema.atomic import atomic_file
from openprc.schema.damage import damage_named
from openprc.schema.layout import KINDS, SCHEMA_VERSION
from openprc.schema.provenance import (
    Provenance,
    new_run_id,
    now,
    read_provenance,
    write_provenance,
)
from openprc.schema.safety import open_hdf5
from openprc.schema.version import check_version

_ENVELOPE = ("openprc_schema", "kind", "status", "run_id", "created")


@dataclass(frozen=True)
class Result:
    """A results file in memory.

    `attrs` and `arrays` are keyed by path without a leading slash: ``"model/weights"``; an
    attribute of a group is ``"narma2/order"``.
    """

    path: Path
    kind: str
    run_id: str
    attrs: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def array(self, name: str) -> NDArray[Any]:
        """Return one array.

        Raises
        ------
        MissingData
            When it is not there.
        """
        if name not in self.arrays:
            raise MissingData(
                "no such array in this file",
                expected="one of " + ", ".join(self.arrays),
                fix="check the name",
                file=self.path,
                key=name,
            )
        return self.arrays[name]


def write_result(
    path: str | Path,
    *,
    kind: str,
    attrs: Mapping[str, Any],
    arrays: Mapping[str, Any],
    provenance: Provenance,
    overwrite: bool = False,
) -> Path:
    """Write a results file atomically and return its path.

    Raises
    ------
    SchemaError
        When `kind` is not a kind of results.
    ResultExists
        When the file is there and `overwrite` is false.
    """
    path = Path(path)
    if kind not in KINDS or kind == "trajectory":
        raise SchemaError(
            f"kind is {kind!r}", expected=" or ".join(KINDS[1:]), fix="name one", file=path
        )
    with atomic_file(path, overwrite=overwrite) as temporary, h5py.File(temporary, "w") as file:
        file.attrs.update(
            {
                "openprc_schema": SCHEMA_VERSION,
                "kind": kind,
                "status": "complete",
                "run_id": new_run_id(),
                "created": now(),
            }
        )
        _put(file, attrs, arrays)
        write_provenance(file, provenance, [], [])
    return path


def add_group(
    path: str | Path,
    group: str,
    *,
    attrs: Mapping[str, Any],
    arrays: Mapping[str, Any],
    provenance: Provenance,
    kind: str = "metrics",
) -> Path:
    """Write one group of a results file, keeping the other groups.

    The file is rewritten as a whole under a temporary name, so readers see the old one or
    the new one.
    """
    path = Path(path)
    kept_attrs: dict[str, Any] = {}
    kept_arrays: dict[str, Any] = {}
    if path.exists():
        old = read_result(path)
        if old.kind != kind:
            raise SchemaError(
                f"this file holds {old.kind}",
                expected=kind,
                fix="choose another output folder",
                file=path,
            )
        kept_attrs = {k: v for k, v in old.attrs.items() if not k.startswith(group + "/")}
        kept_arrays = {k: v for k, v in old.arrays.items() if not k.startswith(group + "/")}
    kept_attrs.update({f"{group}/{name}": value for name, value in attrs.items()})
    kept_arrays.update({f"{group}/{name}": value for name, value in arrays.items()})
    return write_result(
        path,
        kind=kind,
        attrs=kept_attrs,
        arrays=kept_arrays,
        provenance=provenance,
        overwrite=True,
    )


def _put(file: h5py.File, attrs: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    for name, value in arrays.items():
        data = np.asarray(value)
        if data.dtype.kind in "US":
            data = np.asarray(data.astype(object), dtype=h5py.string_dtype())
        try:
            file.create_dataset(name, data=data)
        except (TypeError, ValueError) as error:
            raise SchemaError(
                f"cannot store it: {error}",
                expected="an array of numbers or text, under a name of its own",
                fix="convert it",
                key=name,
            ) from error
    for name, value in attrs.items():
        if value is None:
            continue
        owner, _, key = name.rpartition("/")
        target = file.require_group(owner) if owner and owner not in file else file[owner or "/"]
        if isinstance(value, list | tuple) and all(isinstance(item, str) for item in value):
            target.attrs.create(key, list(value), dtype=h5py.string_dtype())
        else:
            target.attrs[key] = value


def read_result(path: str | Path) -> Result:
    """Read a results file.

    Raises
    ------
    UnreadableFile, UnsafeFile
        As `openprc.schema.safety.open_hdf5`.
    SchemaError
        When it is not a results file of this package.
    """
    path = Path(path)
    attrs: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    with open_hdf5(path) as file, damage_named(path):
        check_version(file, path)
        kind = str(file.attrs.get("kind", ""))
        if kind not in KINDS or kind == "trajectory":
            raise SchemaError(
                f"kind is {kind!r}",
                expected=" or ".join(KINDS[1:]),
                fix="name a results file; trajectories are opened with Trajectory",
                file=path,
            )

        def visit(name: str, item: Any) -> None:
            if name == "provenance" or name.startswith("provenance/"):
                return
            if isinstance(item, h5py.Dataset):
                string = h5py.check_string_dtype(item.dtype) is not None
                arrays[name] = item.asstr()[()] if string else item[()]
            for key, value in item.attrs.items():
                attrs[f"{name}/{key}"] = _plain(value)

        file.visititems(visit)
        for key, value in file.attrs.items():
            if key not in _ENVELOPE:
                attrs[key] = _plain(value)
        run_id = str(file.attrs.get("run_id", ""))
        return Result(path, kind, run_id, attrs, arrays, read_provenance(file))


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return [item.decode() if isinstance(item, bytes) else item for item in value.tolist()]
    return value
