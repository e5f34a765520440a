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
from openprc.hooks.protocols import Planner, Progress, Runner, RunPlan, Settler
from openprc.hooks.registry import Registry, default_registry
from openprc.schema.experiment import AUTO, DEFAULT_INTEGRATOR, load_experiment
from openprc.schema.experiment_checks import check_experiment
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
    accuracy: float | None = None,
    verify: bool = False,
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
    accuracy : float in (0, 1), optional
        Choose the step for this error, and the integrator unless `integrator` names one,
        instead of what config.json says; see `Experiment.accuracy`.
    verify : bool
        Estimate the error of the run, and note it.
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
    asked = with_requests(load_experiment(folder), integrator=integrator, accuracy=accuracy)
    with owned_by(item.qualified_name, "choosing its step", file=str(folder)):
        experiment = settle(asked, runner, producer=producer, verify=verify)
    home = experiment.path or folder  # `folder` may be the input folder itself
    target = Path(out) if out is not None else home / "output" / "simulation.h5"
    provenance = provenance_of(
        item,
        seed=seed,
        # Of strangers' producers nobody here can promise it.
        deterministic=True if item.distribution == "openprc" else None,
        config={**settings_of(experiment, asked), **({"options": values} if values else {})},
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
    accuracy: float | None = None,
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
    experiment = with_requests(load_experiment(folder), integrator=integrator, accuracy=accuracy)
    with owned_by(item.qualified_name, "planning", file=str(folder)):
        return runner.plan(experiment)


def with_requests(
    experiment: Experiment, *, integrator: str | None, accuracy: float | None
) -> Experiment:
    """Return the experiment with what is asked for instead of what config.json says.

    Raises
    ------
    ConfigError
        When the accuracy is none, or nothing chooses what is left open.
    """
    if accuracy is not None:
        # What config.json says beside an accuracy of its own was meant with it.
        named = experiment.integrator if experiment.accuracy is not None else AUTO
        experiment = replace(experiment, accuracy=accuracy, integrator=named)
    if integrator is not None:
        experiment = replace(experiment, integrator=integrator)
    check_experiment(experiment)
    return experiment


def settle(
    experiment: Experiment, runner: Runner, *, producer: str, verify: bool = False
) -> Experiment:
    """Return the experiment with nothing left to an accuracy, before it is run.

    Producers that do not choose run with the step that was stated, and the notes say so.

    Raises
    ------
    UnsupportedScene
        When the producer cannot choose and there is no step, or it cannot estimate errors.
    """
    if isinstance(runner, Settler):
        chosen: Experiment = runner.settled(experiment, verify=verify)
        return chosen
    if verify:
        raise UnsupportedScene(
            f"the producer {producer!r} does not estimate the error of a run",
            expected="a producer that does, such as demlat",
            fix="leave --verify out, or compare runs with two time steps",
        )
    accuracy = experiment.accuracy
    if accuracy is None:
        return experiment
    if not experiment.dt_stated:
        raise UnsupportedScene(
            f"an accuracy of {accuracy:g} and no time step: {producer} does not choose one",
            expected="simulation.dt in config.json",
            fix="state a dt, or run it with --producer demlat, which chooses it",
            file=experiment.path,
            key="simulation.accuracy",
        )
    note = (
        f"the accuracy of {accuracy:g} is not {producer}'s to choose a step for: it ran with the"
        f" dt that was stated, {experiment.dt:g} s"
    )
    named = DEFAULT_INTEGRATOR if experiment.integrator == AUTO else experiment.integrator
    return replace(experiment, accuracy=None, integrator=named, notes=(*experiment.notes, note))


def settings_of(experiment: Experiment, asked: Experiment) -> dict[str, Any]:
    """Return the settings of a run as its provenance keeps them, with the accuracy asked for."""
    settings = experiment.settings()
    if asked.accuracy is not None:
        settings["asked"] = {"accuracy": asked.accuracy}
    return settings


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
