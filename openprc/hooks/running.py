"""From an experiment folder to a validated simulation.h5."""

from __future__ import annotations

import time
from pathlib import Path

from openprc.errors import UnsupportedScene
from openprc.hooks.faults import owned_by
from openprc.hooks.importing import ProducedRun, describe_run, refuse_invalid
from openprc.hooks.protocols import Progress
from openprc.hooks.registry import Registry, default_registry
from openprc.schema.experiment import load_experiment
from openprc.schema.findings import Finding
from openprc.schema.provenance import Provenance, typed_command
from openprc.schema.writer import TrajectoryWriter


def _silent(fraction: float, message: str) -> None:
    """Take progress and show nothing."""


def run_experiment(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    producer: str = "demlat",
    seed: int | None = None,
    overwrite: bool = False,
    progress: Progress = _silent,
    registry: Registry | None = None,
) -> ProducedRun:
    """Simulate the experiment in `folder` and return the finished run.

    Parameters
    ----------
    folder : path-like
        Holds ``input/{geometry.h5, signals.h5, config.json}``.
    out : path-like, optional
        ``FOLDER/output/simulation.h5`` by default.
    producer : str
        Who simulates.
    seed : int, optional
        For producers that draw random numbers.
    overwrite : bool
        Replace a finished result; ``export.overwrite`` in config.json asks for the same.

    Raises
    ------
    ConfigError
        When the experiment is wrong.
    UnsupportedScene
        When the producer cannot model something in it.
    PluginError
        When the producer fails.
    Diverged
        When the integration blew up; the frames before are kept in the partial file.
    """
    started = time.perf_counter()
    folder = Path(folder)
    registry = registry or default_registry()
    item = registry.producer(producer)
    runner = registry.load(item, capability="run")
    experiment = load_experiment(folder)
    home = experiment.path or folder  # `folder` may be the input folder itself
    target = Path(out) if out is not None else home / "output" / "simulation.h5"
    with owned_by(item.qualified_name, "looking at the scene", file=str(folder)):
        remarks = list(runner.supports(experiment))
        for remark in remarks:
            if not isinstance(remark, Finding):
                raise TypeError(f"supports() returned a {type(remark).__name__}, not a Finding")
    for finding in remarks:
        if finding.level == "error":
            raise UnsupportedScene(
                f"{item.name} cannot model it: {finding.found}",
                expected=finding.expected,
                fix=finding.fix,
                file=folder,
                key=finding.path,
            )
    provenance = Provenance(
        item.name,
        producer_version=item.version,
        plugin=item.distribution,
        plugin_version=item.version,
        command=typed_command(),
        seed=seed,
        # Of strangers' producers nobody here can promise it.
        deterministic=True if item.distribution == "openprc" else None,
        config=experiment.settings(),
    )
    findings: list[Finding] = remarks
    with (
        TrajectoryWriter(
            target,
            provenance=provenance,
            overwrite=overwrite or experiment.overwrite,
            verify=lambda partial: findings.extend(refuse_invalid(partial, target, registry)),
        ) as writer,
        owned_by(item.qualified_name, "running", file=str(folder)),
    ):
        for source in experiment.sources:
            writer.add_source(source, role=source.stem)
        runner.run(experiment, writer, seed=seed, progress=progress)
    return describe_run(
        target, item, confidence=1.0, notes=writer.notes, findings=findings,
        seconds=time.perf_counter() - started,
    )  # fmt: skip
