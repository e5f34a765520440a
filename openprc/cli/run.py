"""``openprc run``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import force_option, json_option, print_json, progress_bar
from openprc.cli.import_run import show_run
from openprc.hooks.running import run_experiment


@click.command("run")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--producer", default="demlat", show_default=True, help="Who simulates.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Default: FOLDER/output/simulation.h5."
)
@click.option("--seed", type=int, help="For producers that draw random numbers.")
@force_option
@json_option
def command(
    folder: Path, producer: str, out: Path | None, seed: int | None, force: bool, as_json: bool
) -> None:
    """Simulate the experiment in FOLDER (input/geometry.h5, signals.h5, config.json)."""
    with progress_bar(f"running {folder.name}", hidden=as_json) as progress:
        run = run_experiment(
            folder, out, producer=producer, seed=seed, overwrite=force, progress=progress
        )
    if as_json:
        print_json(run.as_dict())
    else:
        show_run(run)
