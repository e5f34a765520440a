"""One experiment on several producers: each run, or the reason why there is none."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from openprc.errors import (
    ConfigError,
    Diverged,
    MissingDependency,
    NotConverged,
    OpenPRCError,
    UnknownName,
    UnsupportedScene,
)
from openprc.hooks.importing import provenance_of
from openprc.hooks.options import check_options
from openprc.hooks.registry import Registry, default_registry
from openprc.hooks.running import silent, simulate
from openprc.schema.atomic import refuse_existing
from openprc.schema.experiment import Stored
from openprc.schema.experiment_checks import check_experiment

if TYPE_CHECKING:
    from openprc.compare.runs.requests import Request
    from openprc.hooks.protocols import Progress
    from openprc.hooks.registry import Registered
    from openprc.schema.experiment import Experiment

Status = Literal["ok", "refused", "missing", "diverged", "failed"]
#: How costs are measured, for readers of the table.
COST_TEXT = (
    "CPU time of this process over all its threads, from the checked scene to the validated"
    " file; a run of two steps beforehand took the compiling, and a second one says how much of"
    " it any run takes"
)


@dataclass(frozen=True, kw_only=True)
class ProducerRun:
    """What became of one request.

    Parameters
    ----------
    name : str
        Of the request, as typed.
    producer : str
    status : {"ok", "refused", "missing", "diverged", "failed"}
        "refused": it cannot model the scene; "missing": a package is not installed.
    reason : str
        Why there is no run; empty when there is one.
    path : Path or None
        The simulation.h5.
    cpu_seconds, fixed_seconds : float or None [s]
        Of the run, and of a run of two steps; see `COST_TEXT`.
    settings : mapping
        What differs from the experiment, and the options of the producer.
    elements : tuple of str
        What it can model at all, in the words of `openprc.hooks.specs.ELEMENTS`.
    leaves_out, adds : tuple of str
        How its model differs from the scene.
    notes : tuple of str
        What the run says about itself, and what was found odd about the scene.
    """

    name: str
    producer: str
    status: Status
    reason: str = ""
    path: Path | None = None
    cpu_seconds: float | None = None
    fixed_seconds: float | None = None
    settings: Mapping[str, Any]
    elements: tuple[str, ...] = ()
    leaves_out: tuple[str, ...] = ()
    adds: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "name": self.name,
            "producer": self.producer,
            "status": self.status,
            "reason": self.reason,
            "file": None if self.path is None else self.path.name,
            "cpu_seconds": self.cpu_seconds,
            "fixed_seconds": self.fixed_seconds,
            "settings": dict(self.settings),
            "elements": list(self.elements),
            "leaves_out": list(self.leaves_out),
            "adds": list(self.adds),
            "notes": list(self.notes),
        }


def run_producers(
    experiment: Experiment,
    requests: Sequence[Request],
    folder: str | Path,
    *,
    overwrite: bool = False,
    warm_up: bool = True,
    progress: Progress = silent,
    registry: Registry | None = None,
) -> tuple[ProducerRun, ...]:
    """Run an experiment as every request wants it, one after the other.

    A request that is refused, fails or diverges is told in its record, and the others run all
    the same.

    Parameters
    ----------
    experiment : Experiment
    requests : sequence of Request
    folder : path-like
        Gets a file ``NAME.h5`` for every request.
    overwrite : bool
        Replace such files.
    warm_up : bool
        Let every producer take two steps first, so that its cost is without compiling.

    Raises
    ------
    ResultExists
        When one of the files is there already; nothing is run then.
    """
    folder = Path(folder)
    registry = registry or default_registry()
    paths = _targets(requests, folder)
    if not overwrite:
        for path in paths:
            refuse_existing(path)
    folder.mkdir(parents=True, exist_ok=True)
    runs = []
    for number, (request, path) in enumerate(zip(requests, paths, strict=True)):

        def within(fraction: float, message: str, *, k: int = number) -> None:
            progress((k + fraction) / len(requests), f"{requests[k].name}: {message}")

        within(0.0, "starts")
        runs.append(
            _run(
                experiment, request, path, overwrite=overwrite, warm_up=warm_up,
                progress=within, registry=registry,
            )
        )  # fmt: skip
    return tuple(runs)


def run_once(
    experiment: Experiment,
    request: Request,
    path: Path,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    registry: Registry | None = None,
) -> tuple[float, tuple[str, ...]]:
    """Run one request into `path` and return its CPU time [s] and its notes.

    Raises
    ------
    OpenPRCError
        Whatever keeps it from running, see `openprc.hooks.running.run_experiment`.
    """
    registry = registry or default_registry()
    item = registry.producer(request.producer)
    values = check_options(item.spec, item.spec.run_options, request.options)
    runner = registry.load(item, capability="run")
    changed = request.changed(experiment)
    check_experiment(changed)
    provenance = provenance_of(
        item,
        deterministic=True if item.distribution == "openprc" else None,
        config={**changed.settings(), **({"options": values} if values else {})},
    )
    started = time.process_time()
    notes, findings = simulate(
        changed, runner, target=path, provenance=provenance, owner=item.qualified_name,
        options=values, overwrite=overwrite, progress=progress, registry=registry,
    )  # fmt: skip
    seconds = time.process_time() - started
    remarks = [f"{finding.level}: {finding.found}" for finding in findings]
    return seconds, (*notes, *remarks)


def _run(
    experiment: Experiment,
    request: Request,
    path: Path,
    *,
    overwrite: bool,
    warm_up: bool,
    progress: Progress,
    registry: Registry,
) -> ProducerRun:
    item = registry.producer(request.producer)
    settings = {**request.changes, **request.options}
    base = ProducerRun(
        name=request.name, producer=request.producer, status="failed", settings=settings,
        elements=item.spec.elements,
    )  # fmt: skip
    fixed: float | None = None
    notes: tuple[str, ...] = ()
    try:
        changed = request.changed(experiment)
        check_experiment(changed)
        base = _modelled(base, changed, item, registry)
        if warm_up:
            fixed, notes = _warm_up(changed, request, registry)
        seconds, said = run_once(
            experiment, request, path, overwrite=overwrite, progress=progress, registry=registry
        )
    except OpenPRCError as error:
        found = error.found.removeprefix(f"{item.name} cannot model it: ")
        told = f"{found}; {error.fix}" if error.fix else found
        return replace(base, status=_status(error), reason=told)
    return replace(
        base, status="ok", path=path, cpu_seconds=seconds, fixed_seconds=fixed,
        notes=(*said, *notes),
    )  # fmt: skip


def _status(error: OpenPRCError) -> Status:
    if isinstance(error, Diverged):
        return "diverged"
    if isinstance(error, MissingDependency):
        return "missing"
    if isinstance(error, UnsupportedScene | ConfigError | UnknownName):
        return "refused"
    return "failed"


def _modelled(
    run: ProducerRun, experiment: Experiment, item: Registered, registry: Registry
) -> ProducerRun:
    """Add what the producer's model leaves out of the scene and adds to it."""
    from openprc.scenes.requirements import producer_verdicts  # noqa: PLC0415 - asks plugins

    for verdict in producer_verdicts(experiment, registry=registry):
        if verdict.producer in (item.name, item.qualified_name):
            return replace(run, leaves_out=verdict.leaves_out, adds=verdict.adds)
    return run


def _warm_up(
    experiment: Experiment, request: Request, registry: Registry
) -> tuple[float | None, tuple[str, ...]]:
    """Take two steps, twice, into files that are thrown away; return what the second cost [s]."""
    few = replace(
        experiment, duration=2.0 * experiment.dt, save_interval=experiment.dt, stored=Stored()
    )
    plain = replace(request, changes={})
    with tempfile.TemporaryDirectory(prefix="openprc-") as scratch:
        try:
            run_once(few, plain, Path(scratch) / "first.h5", registry=registry)
            fixed, _ = run_once(few, plain, Path(scratch) / "second.h5", registry=registry)
        except (Diverged, NotConverged, ConfigError) as error:
            # What two steps meet says nothing about the run.
            why = f"the cost may hold compiling: two steps beforehand failed ({error.found})"
            return None, (why,)
    return fixed, ()


def _targets(requests: Sequence[Request], folder: Path) -> list[Path]:
    """Return a file for every request; names that differ in odd characters only get numbers."""
    stems: list[str] = []
    for request in requests:
        stem, number = request.file_stem, 2
        while stem in stems:
            stem, number = f"{request.file_stem}-{number}", number + 1
        stems.append(stem)
    return [folder / f"{stem}.h5" for stem in stems]


__all__ = ["COST_TEXT", "ProducerRun", "Status", "run_once", "run_producers"]
