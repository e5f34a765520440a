"""``openprc validate``."""

from __future__ import annotations

from pathlib import Path

import click

from openprc.cli.console import console, json_option, print_findings, print_json
from openprc.hooks.validating import validate_run
from openprc.schema.findings import LEVELS, Level
from openprc.schema.validate import PROFILES, Profile


@click.command("validate")
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--profile",
    type=click.Choice(PROFILES),
    default="default",
    show_default=True,
    help="What else is demanded: benchmark, a uniform clock and an input; archive, hashes and "
    "no arbitrary units.",
)
@click.option(
    "--level",
    type=click.Choice(LEVELS),
    default="hint",
    show_default=True,
    help="Show findings of this level and worse.",
)
@json_option
@click.pass_context
def command(
    ctx: click.Context, paths: tuple[Path, ...], profile: Profile, level: Level, as_json: bool
) -> None:
    """Check files against the contract.

    Exit code 0: no error. 1: a file breaks the contract. 2: a file cannot be read.
    """
    reports = [validate_run(path, profile=profile, apart=True) for path in paths]
    if as_json:
        data = [
            {**report.as_dict(), "findings": [f.as_dict() for f in report.at_least(level)]}
            for report in reports
        ]
        print_json(data[0] if len(data) == 1 else data)
    else:
        out = console()
        for report in reports:
            shown = report.at_least(level)
            out.print(f"{report.path}: {'valid' if report.ok else 'not valid'}", markup=False)
            print_findings(out, shown)
    unreadable = any(f.code.startswith("OPS-F") and f.level == "error"
                     for report in reports for f in report.findings)  # fmt: skip
    invalid = any(not report.ok for report in reports)
    ctx.exit(2 if unreadable else int(invalid))
