"""``openprc import``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import (
    console,
    force_option,
    json_option,
    print_findings,
    print_json,
    spinner,
    table,
)
from openprc.cli.options import pairs_option, parse_pairs
from openprc.hooks.importing import ProducedRun, import_file


@click.command("import")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Default: NAME.simulation.h5 here.")
@click.option("--as", "as_name", metavar="NAME", help="Producer to use; see `openprc plugins`.")
@pairs_option("importer")
@click.option("--trust", is_flag=True, help="Pickles may be read: you know who made the file.")
@force_option
@json_option
def command(
    path: Path,
    out: Path | None,
    as_name: str | None,
    options: tuple[str, ...],
    trust: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Turn another program's file or folder PATH into a simulation.h5."""
    target = out or Path(f"{path.resolve().name.split('.')[0]}.simulation.h5")
    with spinner(f"importing {path.name}", hidden=as_json):
        run = import_file(
            path, target, as_name=as_name, options=parse_pairs(options), trust=trust,
            overwrite=force,
        )  # fmt: skip
    if as_json:
        print_json(run.as_dict())
    else:
        show_run(run)


def show_run(run: ProducedRun) -> None:
    """Print the outline of a finished run."""
    out = console()
    out.print(
        table(
            ["producer", "sure", "nodes", "dims", "frames", "channels", "time", "inputs", "file"],
            [
                [
                    run.producer,
                    run.confidence,
                    run.n_nodes,
                    run.dims,
                    run.n_frames,
                    run.n_channels,
                    run.time_kind,
                    ", ".join(run.inputs) or "none",
                    str(run.path),
                ]
            ],
        )
    )
    for note in run.notes:
        out.print(f"note: {note}", markup=False)
    print_findings(out, run.findings)
