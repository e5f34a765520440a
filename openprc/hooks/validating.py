"""Validation with the plugins' checks of their own subtrees added."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from openprc.errors import OpenPRCError
from openprc.hooks.faults import owned_by
from openprc.hooks.registry import Registered, Registry, default_registry
from openprc.schema.apart import validate_apart
from openprc.schema.findings import LEVELS, Finding
from openprc.schema.trajectory import Trajectory
from openprc.schema.validate import Profile, Report, validate_file


def validate_run(
    path: str | Path,
    *,
    profile: Profile = "default",
    registry: Registry | None = None,
    apart: bool = False,
) -> Report:
    """Check a trajectory against the contract, and its extensions by their plugins.

    Parameters
    ----------
    path : path-like
    profile : {"default", "benchmark", "archive"}
    registry : Registry, optional
    apart : bool
        Read the file in a process of its own first, which a damaged one may crash.

    Returns
    -------
    Report
        That of `openprc.schema.validate.validate_file`, plus the findings of the plugins,
        ``OPS-X02`` for a subtree that no installed plugin checks, and ``OPS-X03`` for a check
        that failed itself.
    """
    report = (validate_apart if apart else validate_file)(path, profile=profile)
    if not report.ok:
        # The plugins' checks may rely on a file that keeps the contract.
        return report
    registry = registry or default_registry()
    known = {item.name: item for item in registry.records("openprc_extensions")}
    findings = list(report.findings)
    with Trajectory(path, allow_incomplete=True) as trajectory:
        for name in trajectory.extensions:
            item = known.get(name)
            findings += _unchecked(name) if item is None else _checked(item, registry, trajectory)
    findings.sort(key=lambda finding: (LEVELS.index(finding.level), finding.code, finding.path))
    return replace(report, findings=tuple(findings))


def _unchecked(name: str) -> list[Finding]:
    return [
        Finding(
            "OPS-X02",
            "hint",
            f"/extensions/{name}",
            "no installed plugin checks this subtree",
            f"the plugin {name}, with a check registered by openprc_extensions",
            "the rest of the file does not depend on it",
        )
    ]


def _checked(item: Registered, registry: Registry, trajectory: Trajectory) -> list[Finding]:
    try:
        with owned_by(item.qualified_name, "checking its extension", file=str(trajectory.path)):
            found = list(registry.load(item)(trajectory))
            for entry in found:
                if not isinstance(entry, Finding):
                    raise TypeError(f"it yielded a {type(entry).__name__}, not a Finding")
            return found
    except OpenPRCError as error:
        return [
            Finding(
                "OPS-X03",
                "warning",
                f"/extensions/{item.name}",
                f"its check failed: {error.found}",
                "a check that yields findings",
                error.fix,
            )
        ]
