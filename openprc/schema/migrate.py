"""Carrying files from one major version of the contract to the next, in copies.

A step is a function that changes an open copy from major version n to n + 1. There is one
major version so far, so `STEPS` is empty; the way there is tested with a made-up step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import h5py

from openprc.errors import SchemaError, SchemaTooNew, SchemaTooOld
from openprc.schema.atomic import atomic_file
from openprc.schema.layout import SCHEMA_MAJOR
from openprc.schema.safety import open_hdf5
from openprc.schema.version import parse_version

Step = Callable[[h5py.File], None]

#: Major version to the step that leaves it.
STEPS: dict[int, Step] = {}


def stated_version(path: str | Path) -> tuple[int, int]:
    """Return the version that a file states.

    Raises
    ------
    SchemaError
        When it states none: such files are imported, not migrated.
    """
    path = Path(path)
    with open_hdf5(path) as file:
        if "openprc_schema" not in file.attrs:
            raise SchemaError(
                "the file states no version of the contract",
                expected="the root attribute openprc_schema",
                fix="convert it with `openprc import`",
                file=path,
                key="openprc_schema",
            )
        return parse_version(file.attrs["openprc_schema"], path)


def migrate(
    source: str | Path,
    target: str | Path,
    *,
    to: int = SCHEMA_MAJOR,
    steps: Mapping[int, Step] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a copy of `source` in major version `to`.

    Raises
    ------
    SchemaTooNew
        When the file is newer than `to`.
    SchemaTooOld
        When there is no step for one of the versions on the way.
    SchemaError
        When the file is at that version already.
    """
    source, target = Path(source), Path(target)
    known = STEPS if steps is None else steps
    major, minor = stated_version(source)
    if major == to:
        raise SchemaError(
            f"the file is at version {major}.{minor} already",
            expected=f"a version below {to}",
            fix="use it as it is",
            file=source,
            key="openprc_schema",
        )
    if major > to:
        raise SchemaTooNew(
            f"the file follows schema {major}.{minor}",
            expected=f"schema {to} or older",
            fix="update openprc",
            file=source,
            key="openprc_schema",
        )
    missing = [version for version in range(major, to) if version not in known]
    if missing:
        raise SchemaTooOld(
            f"there is no way from schema {missing[0]} to {missing[0] + 1}",
            expected="a file of a version with a migration",
            fix="open it with the openprc that wrote it, or import its source again",
            file=source,
            key="openprc_schema",
        )
    with (
        open_hdf5(source) as old,
        atomic_file(target, overwrite=overwrite) as temporary,
        h5py.File(temporary, "w") as new,
    ):
        for name in old:
            old.copy(name, new)
        new.attrs.update(dict(old.attrs))
        for version in range(major, to):
            known[version](new)
            new.attrs["openprc_schema"] = f"{version + 1}.0"
    return target
