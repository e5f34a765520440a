"""Every check on everything that an installed distribution registers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from openprc.errors import UnknownName
from openprc.hooks.registry import Registry, default_registry
from openprc.testing.cases import Case, ExporterCase, ImporterCase, RecorderCase, RunnerCase
from openprc.testing.check import checks_for
from openprc.testing.outcome import CaseReport, Outcome, Report

#: Called before every check with the case, the id of the check, and what it looks for.
Told = Callable[[Case, str, str], None]


def cases_of(distribution: str, *, registry: Registry | None = None) -> tuple[Case, ...]:
    """Return a case for everything that a distribution registers and the kit checks.

    Raises
    ------
    UnknownName
        When no such distribution, or plugin, is installed or works.
    """
    registry = registry or default_registry()
    plugins = [p for p in registry.plugins if distribution in (p.distribution, p.name)]
    if not plugins or all(plugin.state != "ok" for plugin in plugins):
        told = f": {plugins[0].problem}" if plugins else ""
        names = sorted({plugin.distribution for plugin in registry.plugins})
        raise UnknownName(
            f"there is no working plugin {distribution!r}{told}",
            expected="one of " + ", ".join(names),
            fix=(plugins[0].fix if plugins else "") or "install it, or see `openprc plugins`",
            key=distribution,
        )
    owners = {plugin.distribution for plugin in plugins}
    found: list[Case] = []
    for item in registry.producers:
        if item.distribution not in owners:
            continue
        if "import" in item.spec.capabilities and item.spec.sample:
            found.append(ImporterCase(item, registry=registry))
        if "run" in item.spec.capabilities:
            found.append(RunnerCase(item, registry=registry))
        if "record" in item.spec.capabilities:
            found.append(RecorderCase(item, registry=registry))
    for item in registry.records("openprc_exporters"):
        if item.distribution in owners:
            found.append(ExporterCase(item, registry=registry))
    return tuple(found)


def check_distribution(
    name: str,
    *,
    cases: Iterable[Case] | None = None,
    registry: Registry | None = None,
    told: Told | None = None,
    wanted: Iterable[str] = (),
) -> Report:
    """Run the kit on an installed distribution.

    What only its author can know, such as the numbers that a sample holds and scripts that
    record, is in the author's own cases; what needs it is skipped with the reason without them.

    Parameters
    ----------
    name : str
        Of the distribution, or of the plugin.
    cases : iterable of Case, optional
        Instead of those that `cases_of` makes.
    told : callable, optional
        Called before every check.
    wanted : iterable of str
        Ids or families of checks; all of them when empty.

    Returns
    -------
    Report

    Raises
    ------
    UnknownName
        When no such distribution is installed.
    """
    registry = registry or default_registry()
    items = cases_of(name, registry=registry) if cases is None else tuple(cases)
    chosen = set(wanted)
    reports = []
    for case in items:
        outcomes: list[Outcome] = []
        for check in checks_for(case):
            if chosen and not {check.id, check.family} & chosen:
                continue
            if told is not None:
                told(case, check.id, check.says)
            with tempfile.TemporaryDirectory(prefix="openprc-check-") as folder:
                outcomes.append(check.run(case, Path(folder)))
        reports.append(CaseReport(case.name, case.kind, tuple(outcomes)))
    versions = [p.version for p in registry.plugins if name in (p.distribution, p.name)]
    return Report(name, versions[0] if versions else "unknown", tuple(reports))


__all__ = ["cases_of", "check_distribution"]
