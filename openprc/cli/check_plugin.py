"""``openprc check-plugin``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from openprc.cli.console import console, json_option, print_json, spinner, table
from openprc.hooks.registry import default_registry

if TYPE_CHECKING:
    from openprc.testing import CaseReport, Report

_WORDS = {"passed": "ok", "failed": "FAILED", "skipped": "left out", "expected": "as expected"}


@click.command("check-plugin")
@click.argument("name")
@click.option(
    "--check", "wanted", multiple=True, metavar="ID",
    help="Only these checks or families, such as SNIFF or ROBUST-2; repeat it for several.",
)  # fmt: skip
@click.option("--all", "show_all", is_flag=True, help="Show what passed, too.")
@json_option
@click.pass_context
def command(
    ctx: click.Context, name: str, wanted: tuple[str, ...], show_all: bool, as_json: bool
) -> None:
    """Run the conformance kit on the installed plugin NAME, by its distribution or entry point.

    The kit knows what the records say. What a sample holds in closed form, or the script that a
    recorder needs, is known to the plugin's own tests only, which run the same checks.
    """
    # The kit loads what it drives; listing commands must not.
    from openprc.testing import check_distribution  # noqa: PLC0415

    with spinner(f"checking {name}", hidden=as_json):
        report = check_distribution(name, checks=wanted, registry=default_registry())
    if as_json:
        print_json(report.as_dict())
    else:
        _show(report, show_all=show_all)
    ctx.exit(0 if report.ok else 1)


def _show(report: Report, *, show_all: bool) -> None:
    out = console()
    out.print(
        table(
            ["record", "kind", "passed", "failed", "expected", "left out"],
            [
                [case.name, case.kind,
                 *(case.count(state) for state in ("passed", "failed", "expected", "skipped"))]
                for case in report.cases
            ],
            title=f"{report.distribution} {report.version}",
        )
    )  # fmt: skip
    for case in report.cases:
        _show_case(case, show_all=show_all)
    out.print("conforms" if report.ok else "does not conform")


def _show_case(case: CaseReport, *, show_all: bool) -> None:
    out = console()
    for outcome in case.outcomes:
        if outcome.state == "passed" and not show_all:
            continue
        head = f"{outcome.check} {_WORDS[outcome.state]}, {case.name} ({case.kind}): "
        if outcome.state in ("passed", "skipped"):
            out.print(head + (outcome.reason or outcome.says), markup=False)
            continue
        out.print(head + outcome.found, markup=False)
        out.print(f"  expected: {outcome.expected}", markup=False)
        out.print(f"  to do: {outcome.fix}", markup=False)
        if outcome.reason:
            out.print(f"  known: {outcome.reason}", markup=False)
