"""``openprc run``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import (
    console,
    force_option,
    json_option,
    print_findings,
    print_json,
    progress_bar,
    table,
)
from openprc.cli.import_run import show_run
from openprc.cli.options import pairs_option, parse_pairs
from openprc.hooks.running import plan_experiment, run_experiment


@click.command("run")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--producer", default="demlat", show_default=True, help="Who simulates.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Default: FOLDER/output/simulation.h5."
)
@click.option("--integrator", help="Instead of the one in config.json.")
@click.option(
    "--accuracy",
    type=float,
    help="Choose integrator and step for this error, relative to the displacement.",
)
@click.option("--verify", is_flag=True, help="Estimate the error of the run and note it.")
@pairs_option("producer")
@click.option("--seed", type=int, help="For producers that draw random numbers.")
@click.option("--plan", "only_plan", is_flag=True, help="Say what a run would do; run nothing.")
@force_option
@json_option
def command(
    folder: Path,
    producer: str,
    out: Path | None,
    integrator: str | None,
    accuracy: float | None,
    verify: bool,
    options: tuple[str, ...],
    seed: int | None,
    only_plan: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Simulate the experiment in FOLDER (input/geometry.h5, signals.h5, config.json)."""
    if only_plan:
        show_plan(folder, producer, integrator=integrator, accuracy=accuracy, as_json=as_json)
        return
    with progress_bar(f"running {folder.name}", hidden=as_json) as progress:
        run = run_experiment(
            folder,
            out,
            producer=producer,
            integrator=integrator,
            accuracy=accuracy,
            verify=verify,
            options=parse_pairs(options),
            seed=seed,
            overwrite=force,
            progress=progress,
        )
    if as_json:
        print_json(run.as_dict())
    else:
        show_run(run)


def show_plan(
    folder: Path,
    producer: str,
    *,
    integrator: str | None,
    accuracy: float | None,
    as_json: bool,
) -> None:
    """Print what a run would do and cost, and what is odd about the scene."""
    plan = plan_experiment(folder, producer=producer, integrator=integrator, accuracy=accuracy)
    if as_json:
        print_json(plan.as_dict())
        return
    out = console()
    out.print(table(["plan", str(folder)], plan.rows()))
    for remark in plan.remarks:
        out.print(f"note: {remark}", markup=False)
    print_findings(out, plan.findings)
