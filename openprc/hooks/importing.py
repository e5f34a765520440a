"""From a foreign file to a validated simulation.h5."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from openprc.errors import ResultExists, SchemaError
from openprc.hooks.faults import owned_by
from openprc.hooks.options import resolve_options
from openprc.hooks.registry import Registered, Registry, default_registry
from openprc.hooks.sniff import choose_importer
from openprc.hooks.validating import validate_run
from openprc.schema.findings import Finding
from openprc.schema.provenance import Provenance, typed_command
from openprc.schema.trajectory import Trajectory
from openprc.schema.validate import validate_file
from openprc.schema.writer import TrajectoryWriter


@dataclass(frozen=True)
class ProducedRun:
    """A finished simulation.h5 and what a user wants to know about it."""

    path: Path
    producer: str
    confidence: float
    n_frames: int
    n_nodes: int
    dims: int
    n_channels: int
    inputs: tuple[str, ...]
    time_kind: str
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Return the record as plain values, for JSON output."""
        return {
            "path": str(self.path),
            "producer": self.producer,
            "confidence": self.confidence,
            "n_frames": self.n_frames,
            "n_nodes": self.n_nodes,
            "dims": self.dims,
            "n_channels": self.n_channels,
            "inputs": list(self.inputs),
            "time_kind": self.time_kind,
            "notes": list(self.notes),
            "findings": [finding.as_dict() for finding in self.findings],
            "seconds": self.seconds,
        }


def import_file(
    path: str | Path,
    out: str | Path,
    *,
    as_name: str | None = None,
    options: Mapping[str, Any] | None = None,
    trust: bool = False,
    overwrite: bool = False,
    registry: Registry | None = None,
    configure: Callable[[Any], None] | None = None,
) -> ProducedRun:
    """Import a file or folder of another program.

    Parameters
    ----------
    path : path-like
        What to import.
    out : path-like
        The simulation.h5 to write.
    as_name : str, optional
        The producer to use, when the file does not tell.
    options : mapping, optional
        Options of that producer (`ProducerSpec.options`).
    trust : bool
        Pickles may be read: the caller knows where the file comes from.
    overwrite : bool
        Replace `out`; never what is imported.
    configure : callable, optional
        Given the importer before it reads, to connect a progress bar for example.

    Raises
    ------
    OpenPRCError
        Any of the family: nobody reads the file, its content is wrong, the result would not
        be valid. Nothing is left under the final name then.
    """
    started = time.perf_counter()
    path, out = Path(path), Path(out)
    registry = registry or default_registry()
    if out.exists() and path.exists() and out.samefile(path):
        raise ResultExists(
            "the result would replace what is imported",
            expected="another name for the result",
            fix="choose another output",
            file=out,
        )
    choice = choose_importer(path, registry=registry, as_name=as_name)
    item = choice.item
    values = resolve_options(item.spec, options or {}, trust=trust)
    importer = registry.load(item, capability="import")
    if configure is not None:
        configure(importer)
    config = {k: _nameless(v) for k, v in values.items() if v not in (None, ())}
    provenance = provenance_of(item, config=config)
    findings: list[Finding] = []
    with (
        TrajectoryWriter(
            out,
            provenance=provenance,
            overwrite=overwrite,
            on_failure="discard",
            verify=lambda partial: findings.extend(refuse_invalid(partial, out, registry)),
        ) as writer,
        owned_by(item.qualified_name, f"importing {path.name}", file=str(path)),
    ):
        writer.add_source(path)
        importer.import_run(path, writer, options=values)
    return describe_run(
        out, item, confidence=choice.score, notes=writer.notes, findings=findings,
        seconds=time.perf_counter() - started,
    )  # fmt: skip


def provenance_of(item: Registered, **details: Any) -> Provenance:
    """Return who makes a file: the producer, its plugin, and the command; with details."""
    return Provenance(
        item.name,
        producer_version=item.version,
        plugin=item.distribution,
        plugin_version=item.version,
        command=typed_command(),
        **details,
    )


def _nameless(value: Any) -> Any:
    """Return an option without the folders that it names: files know base names only."""
    if isinstance(value, Path):
        return value.name
    if isinstance(value, tuple):
        return tuple(_nameless(item) for item in value)
    if isinstance(value, str):
        key, equals, tail = value.rpartition("=")
        if tail and Path(tail).exists():
            return f"{key}{equals}{Path(tail).name}"
    return value


def refuse_invalid(partial: Path, final: Path, registry: Registry | None) -> tuple[Finding, ...]:
    """Validate a finished file before it gets its final name; return what is not an error.

    With a registry the checks of its plugins count, too.

    Raises
    ------
    SchemaError
        Naming the first error.
    """
    report = (
        validate_file(partial) if registry is None else validate_run(partial, registry=registry)
    )
    errors = [finding for finding in report.findings if finding.level == "error"]
    if errors:
        first = errors[0]
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise SchemaError(
            f"{first.code}: {first.found}{more}",
            expected=first.expected,
            fix=first.fix,
            file=final,
            key=first.path,
        )
    return report.findings


def describe_run(
    path: Path,
    item: Registered,
    *,
    confidence: float,
    notes: tuple[str, ...],
    findings: list[Finding],
    seconds: float,
) -> ProducedRun:
    """Read the outline of a finished file."""
    with Trajectory(path) as trajectory:
        return ProducedRun(
            path=path,
            producer=item.name,
            confidence=confidence,
            n_frames=trajectory.n_frames,
            n_nodes=trajectory.n_nodes,
            dims=trajectory.dims,
            n_channels=sum(len(trajectory.channel_columns(c)) for c in trajectory.channels),
            inputs=trajectory.inputs,
            time_kind=trajectory.time_kind,
            notes=notes,
            findings=tuple(findings),
            seconds=seconds,
        )


__all__ = ["ProducedRun", "describe_run", "import_file", "provenance_of", "refuse_invalid"]
