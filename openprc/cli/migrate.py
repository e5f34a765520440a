"""``openprc migrate``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import force_option, json_option, print_json
from openprc.schema.layout import SCHEMA_MAJOR, SCHEMA_VERSION
from openprc.schema.migrate import migrate, stated_version


@click.command("migrate")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="The copy to write.")
@force_option
@json_option
def command(path: Path, out: Path, force: bool, as_json: bool) -> None:
    """Copy PATH, a file of an older schema, to the present one.

    A file that is at the present version already is left alone, and nothing is written.
    """
    major, minor = stated_version(path)
    if major == SCHEMA_MAJOR:
        message = f"{path}: schema {major}.{minor} is read as it is; nothing to do"
        if as_json:
            print_json({"path": str(path), "schema": f"{major}.{minor}", "migrated": False})
        else:
            click.echo(message)
        return
    migrate(path, out, overwrite=force)
    if as_json:
        print_json({"path": str(out), "schema": SCHEMA_VERSION, "migrated": True})
    else:
        click.echo(f"{out}: schema {major}.{minor} carried to {SCHEMA_VERSION}")
