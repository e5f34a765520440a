"""``openprc demo``: one small run of every producer, from its own format to a score."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from openprc.cli.console import console, json_option, print_json, spinner, table
from openprc.errors import MissingDependency, OpenPRCError, TaskError
from openprc.hooks.faults import owned_by
from openprc.hooks.importing import ProducedRun, import_file
from openprc.hooks.protocols import Sample
from openprc.hooks.registry import Registered, Registry, default_registry, resolve
from openprc.hooks.running import run_experiment
from openprc.hooks.validating import validate_run
from openprc.schema.derive import attach_input
from openprc.schema.trajectory import Trajectory


@dataclass
class Row:
    """One producer's line of the table. ``state``: ok, static, unavailable or failed."""

    producer: str
    way: str
    state: str = "ok"
    nodes: int | None = None
    channels: int | None = None
    frames: int | None = None
    findings: str = ""
    nrmse: float | None = None
    baseline: float | None = None
    esn: float | None = None
    skill: float | None = None
    seconds: float | None = None
    remark: str = ""


@click.command("demo")
@click.option("--order", type=int, default=2, show_default=True, help="Order of the NARMA task.")
@click.option("--keep", type=click.Path(path_type=Path), help="Folder to keep the files in.")
@json_option
@click.pass_context
def command(ctx: click.Context, order: int, keep: Path | None, as_json: bool) -> None:
    """Import, run, validate and score one small body a producer.

    Every producer that brings a sample takes part: third-party recordings are imported, the
    native engine runs its experiment, every file is validated, and a ridge readout is trained
    on a NARMA task and compared with a shift register.
    """
    registry = default_registry()
    items = [item for item in registry.producers if item.spec.sample]
    rows: list[Row] = []
    started = time.perf_counter()
    with _folder(keep) as folder:
        for item in items:
            with spinner(f"{item.name}: {item.spec.summary}", hidden=as_json):
                rows.append(demonstrate(item, folder / item.name, registry=registry, order=order))
        kept = str(folder) if keep else None
    seconds = time.perf_counter() - started
    if as_json:
        print_json({"order": order, "rows": [asdict(r) for r in rows], "seconds": seconds,
                    "folder": kept})  # fmt: skip
    else:
        _show(rows, order, seconds, kept)
    ctx.exit(1 if any(row.state == "failed" for row in rows) else 0)


@contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory(prefix="openprc-demo-") as name:
        yield Path(name)


def demonstrate(item: Registered, folder: Path, *, registry: Registry, order: int) -> Row:
    """Take one producer's sample from its own format to a score."""
    way = "import" if "import" in item.spec.capabilities else "run"
    row = Row(item.name, way)
    started = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        run = _produce(item, folder, way, registry)
        _score(row, run, folder, order=order, registry=registry)
    except MissingDependency as error:
        row.state, row.remark = "unavailable", f"{error.found}; {error.fix}"
    except OpenPRCError as error:
        row.state, row.remark = "failed", error.found
    row.seconds = time.perf_counter() - started
    return row


def _produce(item: Registered, folder: Path, way: str, registry: Registry) -> ProducedRun:
    write_sample = resolve(item, item.spec.sample)
    native = folder / "native"
    native.mkdir(exist_ok=True)
    with owned_by(item.qualified_name, "writing its sample"):
        sample = write_sample(native)
        if not isinstance(sample, Sample):
            raise TypeError(f"it returned a {type(sample).__name__}, not a Sample")
        signals = {name: _signal(given) for name, given in sample.inputs.items()}
    target = folder / "simulation.h5"
    if way == "run":
        return run_experiment(
            sample.path, target, producer=item.qualified_name, overwrite=True, registry=registry
        )
    name = item.qualified_name
    run = import_file(
        sample.path, target, as_name=name, options=sample.options, trust=True, overwrite=True,
        registry=registry,
    )  # fmt: skip
    for name, signal in signals.items():
        if name not in run.inputs:
            driven = folder / "driven.h5"
            attach_input(target, driven, name=name, overwrite=True, **signal)
            driven.replace(target)
    return run


def _signal(given: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "signal": given["sequence"],
        "hold": given["hold"],
        "start": given.get("start", 0.0),
        "unit": given.get("unit", "1"),
        "quantity": given.get("quantity", "force"),
    }


def _score(row: Row, run: ProducedRun, folder: Path, *, order: int, registry: Registry) -> None:
    # scikit-learn takes seconds to import; the help of this command need not wait for it.
    from openprc.analysis.benchmarks.report import score_file  # noqa: PLC0415
    from openprc.analysis.tasks.narma import NarmaTask  # noqa: PLC0415

    report = validate_run(run.path, registry=registry)
    counts = [sum(f.level == level for f in report.findings) for level in ("error", "warning")]
    row.findings = "valid" if not any(counts) else f"{counts[0]} errors, {counts[1]} warnings"
    row.nodes, row.channels, row.frames = run.n_nodes, run.n_channels, run.n_frames
    if not report.ok:
        row.state, row.remark = "failed", report.findings[0].found
        return
    if run.time_kind == "pseudo":
        row.state, row.remark = "static", "quasi-static load steps: there is no memory to score"
        return
    with Trajectory(run.path) as trajectory:
        driven = bool(trajectory.inputs)
    if not driven:
        row.state, row.remark = (
            "undriven",
            "nothing drove the body: there is no input to compute with",
        )
        return
    try:
        score = score_file(run.path, task=NarmaTask(order), experiment_dir=folder)
    except TaskError as error:
        row.state, row.remark = "failed", error.found
        return
    row.nrmse, row.baseline, row.skill = score.nrmse, score.baseline, score.skill
    row.esn = score.esn
    row.remark = "; ".join(score.warnings)


def _show(rows: list[Row], order: int, seconds: float, kept: str | None) -> None:
    out = console()
    columns = ["producer", "by", "state", "nodes", "channels", "frames", "file",
               f"NARMA{order} NRMSE", "shift register", "ESN", "skill", "seconds"]  # fmt: skip
    body: list[list[Any]] = [
        [r.producer, r.way, r.state, r.nodes, r.channels, r.frames, r.findings, r.nrmse,
         r.baseline, r.esn, r.skill, r.seconds]
        for r in rows
    ]  # fmt: skip
    out.print(table(columns, body, title="OpenPRC demo: one small run of every producer"))
    for row in rows:
        if row.remark:
            out.print(f"{row.producer}: {row.remark}", markup=False)
    out.print(
        "The shift register knows the input's past and computes nothing; a skill above 0 is what "
        "the body adds.",
        markup=False,
    )
    where = f"files: {kept}" if kept else "say --keep FOLDER to keep the files"
    out.print(f"{seconds:.0f} s in all; {where}", markup=False)
