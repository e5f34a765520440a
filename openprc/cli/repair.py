"""``openprc repair``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.blame import reading
from openprc.cli.console import force_option, json_option, print_json
from openprc.schema.derive import repair
from openprc.schema.trajectory import Trajectory


@click.command("repair")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Default: the name without .partial.")
@force_option
@json_option
def command(path: Path, out: Path | None, force: bool, as_json: bool) -> None:
    """Save the committed frames of the unfinished run PATH in a new file.

    PATH itself is left as it is.
    """
    with reading(path):
        target = repair(path, out, overwrite=force)
    with Trajectory(target) as trajectory:
        frames, status = trajectory.n_frames, trajectory.status
    if as_json:
        print_json({"path": str(target), "n_frames": frames, "status": status})
    else:
        click.echo(f"{target}: {frames} frames saved, status {status}")
        click.echo(f"{path} is still there; remove it when you no longer need it")
