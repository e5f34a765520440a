"""From a simulation.h5 to files of another format."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from openprc.errors import AmbiguousName, PluginError, ResultExists
from openprc.hooks.faults import owned_by
from openprc.hooks.options import check_options
from openprc.hooks.registry import Registered, Registry, default_registry
from openprc.schema.atomic import publish, refuse_existing
from openprc.schema.trajectory import Trajectory


def export_file(
    path: str | Path,
    out: str | Path,
    *,
    to: str | None = None,
    options: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    registry: Registry | None = None,
) -> tuple[Path, ...]:
    """Export a trajectory and return the files made.

    Parameters
    ----------
    path : path-like
        A simulation.h5.
    out : path-like
        The file to write; an exporter that writes several puts the others beside it.
    to : str, optional
        The exporter; by default the one that the ending of `out` names.
    options : mapping, optional
        Options of that exporter (`ExporterSpec.options`).
    overwrite : bool
        Replace existing files, once all of them are written; never the trajectory.

    Raises
    ------
    UnknownName, AmbiguousName
        When there is no such exporter, or more than one.
    ConfigError
        When an option is unknown or has a wrong value.
    MissingDependency
        When the exporter needs a package that is not installed.
    ResultExists
        When a file is there and `overwrite` is false.
    PluginError
        When the exporter fails or writes elsewhere; nothing is left then.
    """
    path, out = Path(path), Path(out)
    registry = registry or default_registry()
    item = _chosen(registry, to, out)
    values = check_options(item.spec, item.spec.options, options or {})
    if not overwrite:
        refuse_existing(out)
    if out.exists() and path.exists() and out.samefile(path):
        raise ResultExists(
            "the export would replace what is exported",
            expected="another name",
            fix="choose another output",
            file=out,
        )
    # The folder is made once it is known that there is something to put there.
    with Trajectory(path) as trajectory, _scratch_beside(out) as folder:
        with owned_by(item.qualified_name, f"exporting {path.name}", file=str(path)):
            exporter = registry.load(item)()
            given = {**values, "final": out}
            made = [
                Path(file) for file in exporter.export(trajectory, folder / out.name, options=given)
            ]
        stray = [file for file in made if file.parent != folder or not file.is_file()]
        if stray or not made:
            raise PluginError(
                f"{item.qualified_name} reported {stray[0] if stray else 'no file'}",
                expected="files beside the one that was asked for",
                fix="report it to the authors of the plugin",
                file=path,
            )
        targets = [out.parent / file.name for file in made]
        if not overwrite:
            for target in targets:
                refuse_existing(target)
        for file, target in zip(made, targets, strict=True):
            publish(file, target)
    return tuple(targets)


def _chosen(registry: Registry, to: str | None, out: Path) -> Registered:
    """Return the exporter named `to`, or the one that the ending of `out` names."""
    if to is None:
        name = out.name.lower()
        fitting = [
            item
            for item in registry.records("openprc_exporters")
            if item.spec.suffixes and name.endswith(item.spec.suffixes)
        ]
        if len(fitting) > 1:
            names = [item.name for item in fitting]
            raise AmbiguousName(
                f"{len(fitting)} exporters write {out.suffix}: {', '.join(names)}",
                expected="one exporter",
                fix=f"say which with --to, for example --to {names[0]}",
                key=out.suffix,
            )
        if fitting:
            return fitting[0]
    return registry.find("openprc_exporters", to or out.suffix.lstrip(".").lower() or out.name)


@contextmanager
def _scratch_beside(out: Path) -> Iterator[Path]:
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".export-") as name:
        yield Path(name)
