"""``openprc attach-input``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.blame import reading
from openprc.cli.console import force_option, json_option, print_json
from openprc.cli.options import FINITE
from openprc.cli.signal_file import read_signal
from openprc.schema.derive import attach_input


@click.command("attach-input")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--signal",
    required=True,
    type=click.Path(path_type=Path),
    help="CSV, text, .npy or .npz with the values.",
)
@click.option(
    "--column",
    "columns",
    multiple=True,
    help="Columns of the CSV, or the array of the .npz, to take.",
)
@click.option("--name", default="u", show_default=True, help="Name of the input.")
@click.option("--unit", default="1", show_default=True, help="Unit of the values.")
@click.option("--quantity", default="force", show_default=True, help="What was prescribed.")
@click.option("--target", "targets", multiple=True, help="What it acted on.")
@click.option(
    "--hold",
    type=FINITE,
    help="Duration of one symbol in the file's unit of time. "
    "Without it the signal has one value a frame.",
)
@click.option("--start", type=FINITE, help="When symbol 0 begins. Default: the first frame.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The file to write.")
@force_option
@json_option
def command(
    path: Path,
    signal: Path,
    columns: tuple[str, ...],
    name: str,
    unit: str,
    quantity: str,
    targets: tuple[str, ...],
    hold: float | None,
    start: float | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Write a copy of PATH that also says what drove the body.

    Finished files are not changed; the copy names PATH's run as its parent.
    """
    values, names = read_signal(signal, columns=columns)
    with reading(path):
        attach_input(
            path, out, name=name, signal=values, unit=unit, quantity=quantity, hold=hold,
            start=start, columns=names, targets=targets, signal_file=signal, overwrite=force,
        )  # fmt: skip
    kind = "values" if hold is None else f"symbols of {hold:g}"
    if as_json:
        print_json({"path": str(out), "input": name, "length": len(values), "hold": hold})
    else:
        click.echo(f"{out}: input {name} attached, {len(values)} {kind}")
