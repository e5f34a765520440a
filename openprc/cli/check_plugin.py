"""``openprc check-plugin``."""

from __future__ import annotations

import difflib
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from openprc.cli.console import console, json_option, print_json, progress_bar, table
from openprc.cli.options import pairs_option, parse_pairs
from openprc.hooks.registry import default_registry

if TYPE_CHECKING:
    from openprc.testing import CaseReport, Report
    from openprc.testing.cases import Case

_WORDS = {"passed": "ok", "failed": "FAILED", "skipped": "left out", "expected": "as expected"}


@click.command("check-plugin")
@click.argument("name")
@click.option(
    "--check", "wanted", multiple=True, metavar="ID",
    help="Only these checks or families, such as SNIFF or ROBUST-2; repeat it for several.",
)  # fmt: skip
@pairs_option("runner")
@click.option("--all", "show_all", is_flag=True, help="Show what passed, too.")
@json_option
@click.pass_context
def command(
    ctx: click.Context,
    name: str,
    wanted: tuple[str, ...],
    options: tuple[str, ...],
    show_all: bool,
    as_json: bool,
) -> None:
    """Run the conformance kit on the installed plugin NAME, by its distribution or entry point.

    The kit knows what the records say. What a sample holds in closed form, or the script that a
    recorder needs, is known to the plugin's own tests only, which run the same checks.
    """
    # The kit loads what it drives; listing commands must not.
    from openprc.testing import (  # noqa: PLC0415
        RunnerCase,
        all_checks,
        cases_of,
        check_distribution,
        checks_for,
    )

    known = {part for check in all_checks() for part in (check.id, check.family)}
    stray = sorted(set(wanted) - known)
    if stray:
        near = difflib.get_close_matches(stray[0].upper(), sorted(known), n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise click.BadParameter(f"there is no check {stray[0]!r}.{hint}", param_hint="--check")
    registry = default_registry()
    given = parse_pairs(options)
    cases = [
        # A case keeps what it has looked up, so that it is made anew and not changed.
        replace(case, options=given) if isinstance(case, RunnerCase) and given else case
        for case in cases_of(name, registry=registry)
    ]
    total = sum(len(checks_for(case)) for case in cases)
    done = 0
    with progress_bar(f"checking {name}", hidden=as_json) as progress:

        def tell(case: Case, check: str, says: str) -> None:
            nonlocal done
            progress(done / total, f"{case.name}: {check}, {says}")
            done += 1

        report = check_distribution(name, cases=cases, registry=registry, wanted=wanted, told=tell)
    if as_json:
        print_json(report.as_dict())
    else:
        _show(report, show_all=show_all)
    ctx.exit(0 if report.ok else 1)


def _show(report: Report, *, show_all: bool) -> None:
    out = console()
    if not report.cases:
        out.print(
            f"{report.distribution} {report.version} registers no importer with a sample, runner, "
            "recorder or exporter: there is nothing that the kit checks"
        )
        return
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
