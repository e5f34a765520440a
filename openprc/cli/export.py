"""``openprc export``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import force_option, json_option, print_json, spinner
from openprc.cli.options import pairs_option, parse_pairs
from openprc.hooks.exporting import export_file


@click.command("export")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The file to write.")
@click.option("--to", help="Exporter; see `openprc plugins`. Default: the ending of --out.")
@pairs_option("exporter")
@force_option
@json_option
def command(
    path: Path,
    out: Path,
    to: str | None,
    options: tuple[str, ...],
    force: bool,
    as_json: bool,
) -> None:
    """Write the trajectory PATH in another format."""
    with spinner(f"exporting {path.name}", hidden=as_json):
        made = export_file(path, out, to=to, options=parse_pairs(options), overwrite=force)
    sizes = {str(file): file.stat().st_size for file in made}
    if as_json:
        print_json({"files": sizes})
    else:
        for name, size in sizes.items():
            click.echo(f"{name}: {size:,} bytes")
