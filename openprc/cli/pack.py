"""``openprc pack``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.blame import reading
from openprc.cli.console import force_option, json_option, print_json, spinner
from openprc.schema.derive import pack


@click.command("pack")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Default: NAME.packed.h5 beside it.")
@force_option
@json_option
def command(path: Path, out: Path | None, force: bool, as_json: bool) -> None:
    """Write a compressed copy of PATH and verify that it holds the same numbers."""
    target = out or path.with_name(f"{path.stem}.packed.h5")
    with spinner(f"packing {path.name}", hidden=as_json), reading(path):
        pack(path, target, overwrite=force)
    before, after = path.stat().st_size, target.stat().st_size
    if as_json:
        print_json({"path": str(target), "bytes_before": before, "bytes_after": after})
    else:
        click.echo(f"{target}: {after:,} bytes, {after / before:.0%} of {before:,}; verified")
