"""From an experiment folder to a validated simulation.h5."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import UnsupportedScene
from openprc.hooks.faults import owned_by
from openprc.hooks.importing import ProducedRun, describe_run, provenance_of, refuse_invalid
from openprc.hooks.options import check_options
from openprc.hooks.protocols import Planner, Progress, Runner, RunPlan
from openprc.hooks.registry import Registry, default_registry
from openprc.schema.experiment import load_experiment
from openprc.schema.findings import Finding
from openprc.schema.provenance import Provenance
from openprc.schema.writer import TrajectoryWriter

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def silent(fraction: float, message: str) -> None:
    """Take progress and show nothing."""


def run_experiment(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    producer: str = "demlat",
    integrator: str | None = None,
    options: Mapping[str, Any] | None = None,
    seed: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
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
    integrator : str, optional
        Instead of the one in config.json, in which older folders name none.
    options : mapping, optional
        Options of that producer (`ProducerSpec.run_options`).
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
    values = check_options(item.spec, item.spec.run_options, options or {})
    runner = registry.load(item, capability="run")
    experiment = _loaded(folder, integrator)
    home = experiment.path or folder  # `folder` may be the input folder itself
    target = Path(out) if out is not None else home / "output" / "simulation.h5"
    provenance = provenance_of(
        item,
        seed=seed,
        # Of strangers' producers nobody here can promise it.
        deterministic=True if item.distribution == "openprc" else None,
        config={**experiment.settings(), **({"options": values} if values else {})},
    )
    notes, findings = simulate(
        experiment,
        runner,
        target=target,
        provenance=provenance,
        owner=item.qualified_name,
        options=values,
        seed=seed,
        overwrite=overwrite or experiment.overwrite,
        progress=progress,
        registry=registry,
    )
    return describe_run(
        target, item, confidence=1.0, notes=notes, findings=findings,
        seconds=time.perf_counter() - started,
    )  # fmt: skip


def plan_experiment(
    folder: str | Path,
    *,
    producer: str = "demlat",
    integrator: str | None = None,
    registry: Registry | None = None,
) -> RunPlan:
    """Return what a run of the experiment in `folder` would do; nothing is run or written.

    Parameters are those of `run_experiment`.

    Raises
    ------
    ConfigError
        When the experiment is wrong.
    UnsupportedScene
        When the producer makes no plans.
    """
    registry = registry or default_registry()
    item = registry.producer(producer)
    runner = registry.load(item, capability="run")
    if not isinstance(runner, Planner):
        raise UnsupportedScene(
            f"the producer {producer!r} makes no plans",
            expected="a producer with a method plan(experiment)",
            fix="run it, or plan with --producer demlat",
        )
    experiment = _loaded(folder, integrator)
    with owned_by(item.qualified_name, "planning", file=str(folder)):
        return runner.plan(experiment)


def _loaded(folder: str | Path, integrator: str | None) -> Experiment:
    experiment = load_experiment(folder)
    return experiment if integrator is None else replace(experiment, integrator=integrator)


def simulate(
    experiment: Experiment,
    runner: Runner,
    *,
    target: Path,
    provenance: Provenance,
    owner: str,
    options: Mapping[str, Any] | None = None,
    seed: int | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
    registry: Registry | None = None,
) -> tuple[tuple[str, ...], list[Finding]]:
    """Let a runner simulate an experiment into `target`; every run goes through here.

    Parameters
    ----------
    owner : str
        Whose code the runner is, for errors.
    options : mapping, optional
        Every option of the runner, if it has some.
    registry : Registry, optional
        Whose checks of extensions the result has to pass, too.

    Returns
    -------
    notes, findings
        Remarks of the runner, and what the scene and the result gave rise to.

    Raises
    ------
    UnsupportedScene, PluginError, Diverged, SchemaError
        See `run_experiment`.
    """
    scene = None if experiment.path is None else str(experiment.path)
    with owned_by(owner, "looking at the scene", file=scene):
        findings = list(runner.supports(experiment))
        for remark in findings:
            if not isinstance(remark, Finding):
                raise TypeError(f"supports() returned a {type(remark).__name__}, not a Finding")
    refuse_unsupported(findings, producer=provenance.producer, file=scene)
    with (
        TrajectoryWriter(
            target,
            provenance=provenance,
            overwrite=overwrite,
            verify=lambda partial: findings.extend(refuse_invalid(partial, target, registry)),
        ) as writer,
        owned_by(owner, "running", file=scene),
    ):
        for source in experiment.sources:
            writer.add_source(source, role=source.stem)
        # A runner without options does not have the argument.
        given = {"options": dict(options)} if options else {}
        runner.run(experiment, writer, seed=seed, progress=progress, **given)
    return writer.notes, findings


def refuse_unsupported(
    findings: Sequence[Finding], *, producer: str, file: str | None = None
) -> None:
    """Raise `UnsupportedScene` with every finding of level "error"."""
    errors = [finding for finding in findings if finding.level == "error"]
    if not errors:
        return
    if len(errors) == 1:
        only = errors[0]
        raise UnsupportedScene(
            f"{producer} cannot model it: {only.found}",
            expected=only.expected,
            fix=only.fix,
            file=file,
            key=only.path,
        )
    lines = "".join(
        f"\n  - {item.path}: {item.found}; expected {item.expected} ({item.fix})" for item in errors
    )
    raise UnsupportedScene(
        f"{producer} cannot model {len(errors)} things in this scene{lines}",
        expected="a scene without them",
        fix="change them as said above, or use another producer",
        file=file,
        key=", ".join(dict.fromkeys(item.path for item in errors)),
    )
