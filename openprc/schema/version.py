"""Which versions of the contract this package reads."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import h5py

from openprc.errors import SchemaError, SchemaTooNew, SchemaTooOld
from openprc.schema.layout import SCHEMA_MAJOR, SCHEMA_VERSION


class NewerSchemaWarning(UserWarning):
    """The file follows a newer minor version: what is new in it goes unread."""


def parse_version(text: object, path: Path) -> tuple[int, int]:
    """Return (major, minor) of a version string.

    Raises
    ------
    SchemaError
        When it is not MAJOR.MINOR.
    """
    if isinstance(text, bytes):
        text = text.decode(errors="replace")
    found = re.fullmatch(r"([0-9]{1,6})\.([0-9]{1,6})", text) if isinstance(text, str) else None
    if found is None:
        raise SchemaError(
            f"the version is {text!r}",
            expected=f"MAJOR.MINOR such as {SCHEMA_VERSION!r}",
            fix="write the file with TrajectoryWriter",
            file=path,
            key="openprc_schema",
        )
    return int(found[1]), int(found[2])


def check_version(file: h5py.File, path: Path) -> tuple[int, int]:
    """Accept the same major version; warn about a newer minor one.

    Raises
    ------
    SchemaError
        When the file does not name a version.
    SchemaTooNew, SchemaTooOld
        When the major version is another one.
    """
    if "openprc_schema" not in file.attrs:
        raise SchemaError(
            "the root attribute openprc_schema is missing: not a file of this contract",
            expected=f"a file of schema {SCHEMA_MAJOR}.x",
            fix="convert it with `openprc import`",
            file=path,
            key="openprc_schema",
        )
    major, minor = parse_version(file.attrs["openprc_schema"], path)
    if major > SCHEMA_MAJOR:
        raise SchemaTooNew(
            f"the file follows schema {major}.{minor}",
            expected=f"schema {SCHEMA_MAJOR}.x, which this version of openprc reads",
            fix="update openprc",
            file=path,
            key="openprc_schema",
        )
    if major < SCHEMA_MAJOR:
        raise SchemaTooOld(
            f"the file follows schema {major}.{minor}",
            expected=f"schema {SCHEMA_MAJOR}.x",
            fix="convert a copy with `openprc migrate`",
            file=path,
            key="openprc_schema",
        )
    known_minor = parse_version(SCHEMA_VERSION, path)[1]
    if minor > known_minor:
        warnings.warn(
            f"{path.name}: schema {major}.{minor} is newer than {SCHEMA_VERSION}; "
            "what was added since goes unread",
            NewerSchemaWarning,
            stacklevel=3,
        )
    return major, minor
