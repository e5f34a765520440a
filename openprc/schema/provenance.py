"""Where a file came from: who made it, from what, with which versions."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from openprc import __version__
from openprc.errors import SchemaError, UnreadableFile
from openprc.schema.plain_text import storable
from openprc.schema.units import UNITS

#: Row of /provenance/inputs.
SOURCE_DTYPE = np.dtype(
    [
        ("role", h5py.string_dtype()),
        ("name", h5py.string_dtype()),
        ("bytes", "i8"),
        ("sha256", h5py.string_dtype()),
    ]
)
UNKNOWN_VERSION = "unknown"


@dataclass(frozen=True)
class Source:
    """A file that was read: its role, base name, size in bytes and SHA-256."""

    role: str
    name: str
    bytes: int
    sha256: str

    @classmethod
    def of(cls, path: str | Path, *, role: str) -> Source:
        """Hash the file at `path`, or every file below it when it is a folder.

        Raises
        ------
        UnreadableFile
            When there is nothing at `path`.
        """
        path = Path(path)
        if not path.exists():
            raise UnreadableFile(
                "the source does not exist",
                expected="a file that was read",
                fix="check the path",
                file=path,
            )
        digest = hashlib.sha256()
        size = 0
        if path.is_dir():
            for member in sorted(item for item in path.rglob("*") if item.is_file()):
                digest.update(member.relative_to(path).as_posix().encode() + b"\0")
                size += _feed(digest, member)
        else:
            size = _feed(digest, path)
        return cls(role, _base_name(path), size, digest.hexdigest())


def _base_name(path: Path) -> str:
    # Names may hold bytes that are no UTF-8, and backslashes, which would read as a path.
    return path.resolve().name.encode(errors="replace").decode().replace("\\", "_")


def _feed(digest: Any, path: Path) -> int:
    size = 0
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
            size += len(block)
    return size


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Who made a file and how. What the machine can tell is filled in while writing.

    Parameters
    ----------
    producer : str
        Name of the producer; the only thing that has to be said.
    producer_version, plugin, plugin_version : str
    command : str, optional
        What was typed; `typed_command` gives it without paths.
    seed : int, optional
    deterministic : bool, optional
        Whether the same inputs give the same bytes.
    config : mapping, optional
        Settings, stored as sorted JSON.
    parents : sequence of str
        ``run_id`` of the files that this one is derived from.
    """

    producer: str = field(kw_only=False)
    producer_version: str = UNKNOWN_VERSION
    plugin: str = "openprc"
    plugin_version: str = UNKNOWN_VERSION
    command: str | None = None
    seed: int | None = None
    deterministic: bool | None = None
    config: Mapping[str, Any] | None = None
    parents: tuple[str, ...] = ()

    def attributes(self) -> dict[str, str | int]:
        """Return the attributes of /provenance."""
        values: dict[str, str | int] = {
            "producer": self.producer,
            "producer_version": self.producer_version or UNKNOWN_VERSION,
            "plugin": self.plugin,
            "plugin_version": self.plugin_version or UNKNOWN_VERSION,
            "openprc_version": __version__,
            "python": platform.python_version(),
            "platform": f"{platform.system()} {platform.machine()}",
        }
        if self.command:
            values["command"] = self.command
        if self.seed is not None:
            values["seed"] = int(self.seed)
        if self.deterministic is not None:
            values["deterministic"] = int(self.deterministic)
        return {
            name: storable(value, key=f"/provenance@{name}") if isinstance(value, str) else value
            for name, value in values.items()
        }

    def config_json(self) -> str | None:
        """Return the settings as sorted JSON, or None.

        Raises
        ------
        SchemaError
            When they hold NaN, infinite numbers, or keys of several types.
        """
        if self.config is None:
            return None
        try:
            return json.dumps(self.config, sort_keys=True, default=_plain, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise SchemaError(
                f"the settings cannot be stored as JSON: {error}",
                expected="text keys, finite numbers, text, lists and mappings",
                fix="correct the config of the Provenance",
                key="/provenance/config",
            ) from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return value.name
    if isinstance(value, Mapping):
        return dict(value)
    return str(value)


def new_run_id() -> str:
    """Return a fresh UUID, version 4."""
    return str(uuid.uuid4())


def now() -> str:
    """Return the present instant as ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def typed_command(arguments: list[str] | None = None) -> str:
    """Return the command line with every path cut down to its base name."""
    words = sys.argv if arguments is None else arguments
    return " ".join(_without_folders(word) for word in words)


def _without_folders(word: str) -> str:
    """Return ``PATH`` or ``KEY=PATH`` without the folders; units such as N/m stay as they are."""
    parts = [part.rstrip("/\\") if part not in UNITS else part for part in word.split("=")]
    return "=".join(part if part in UNITS else re.split(r"[/\\]", part)[-1] for part in parts)


def write_provenance(
    file: h5py.File, provenance: Provenance, sources: list[Source], notes: list[str]
) -> None:
    """Write the group /provenance anew."""
    if "provenance" in file:
        del file["provenance"]
    group = file.create_group("provenance")
    group.attrs.update(provenance.attributes())
    table = np.array(
        [(item.role, item.name, item.bytes, item.sha256) for item in sources], dtype=SOURCE_DTYPE
    )
    group.create_dataset("inputs", data=table, dtype=SOURCE_DTYPE)
    config = provenance.config_json()
    text = h5py.string_dtype()
    if config is not None:
        group.create_dataset("config", data=config, dtype=text)
    if provenance.parents:
        group.create_dataset("parents", data=list(provenance.parents), dtype=text)
    if notes:
        group.create_dataset("notes", data=notes, dtype=text)


def read_provenance(file: h5py.File) -> dict[str, Any]:
    """Return the group /provenance as plain values; absent parts are left out."""
    group = file.get("provenance")
    if not isinstance(group, h5py.Group):
        return {}
    values: dict[str, Any] = {}
    for name, value in group.attrs.items():
        values[name] = value.item() if isinstance(value, np.generic) else value
    if "inputs" in group:
        values["inputs"] = [
            {
                "role": _text(row["role"]),
                "name": _text(row["name"]),
                "bytes": int(row["bytes"]),
                "sha256": _text(row["sha256"]),
            }
            for row in group["inputs"][()]
        ]
    if "config" in group:
        text = _text(group["config"][()])
        try:
            values["config"] = json.loads(text)
        except ValueError as error:
            raise SchemaError(
                f"the settings are no JSON: {error}",
                expected="an object as JSON",
                fix="make the file again",
                file=file.filename,
                key="/provenance/config",
            ) from error
    for name in ("parents", "notes"):
        values[name] = [_text(item) for item in group[name][()]] if name in group else []
    return values


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
