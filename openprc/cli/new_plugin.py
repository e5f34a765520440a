"""``openprc new-plugin``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import json_option, print_json
from openprc.cli.scaffold import PARTS, create_plugin


@click.command("new-plugin")
@click.argument("name")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(tuple(PARTS)),
    default=("import",),
    show_default=True,
    help="What the plugin does; repeat it for several.",
)
@click.option(
    "--out",
    default=Path(),
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to put it in; here by default.",
)
@json_option
def command(name: str, kinds: tuple[str, ...], out: Path, as_json: bool) -> None:
    """Write a plugin NAME that works as it is: records, code, a sample, and its tests."""
    folder = create_plugin(name, out, kinds=kinds)
    made = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    if as_json:
        print_json({"folder": str(folder), "files": made})
        return
    click.echo(f"{folder}:")
    for file in made:
        click.echo(f"  {file}")
    click.echo("next:")
    click.echo(f'  pip install -e "{folder}[test]"')
    click.echo(f"  openprc check-plugin {folder.name}")
