"""`validate_file`: run every check and report findings with stable codes."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from openprc.errors import OpenPRCError, SchemaError, SchemaTooNew, SchemaTooOld, UnsafeFile
from openprc.schema.damage import DAMAGE
from openprc.schema.findings import LEVELS, Finding, Level
from openprc.schema.safety import open_hdf5
from openprc.schema.version import NewerSchemaWarning, check_version
from openprc.schema.view import View

Profile = Literal["default", "benchmark", "archive"]
PROFILES: tuple[Profile, ...] = get_args(Profile)

#: What a check yields: path, found, expected, fix.
Complaint = tuple[str, str, str, str]


@dataclass(frozen=True)
class Check:
    """One check: its stable code, its level, one line on what it demands, and the function."""

    code: str
    level: Level
    demand: str
    function: Callable[[View], Iterator[Complaint]]
    profile: Profile


CHECKS: dict[str, Check] = {}

#: Modules that register checks when they are imported.
_ROOMS = ("checks_envelope", "checks_layout", "checks_content", "checks_profiles")

#: Codes of what goes wrong before any check can run.
OPENING: dict[str, str] = {
    "OPS-F01": "the file can be read",
    "OPS-F02": "nothing in the file leads outside it or claims data that it does not hold",
    "OPS-F03": "the file follows a version of the contract that is understood",
    "OPS-F04": "the file says that it follows the contract",
    "OPS-F05": "the data can be read and match their checksums",
    "OPS-F06": "the HDF5 library does not crash on the file (`openprc validate`)",
}


#: Codes that come in when plugins check their own subtrees (`openprc.hooks.validating`).
BY_PLUGINS: dict[str, tuple[Level, str]] = {
    "OPS-X02": ("hint", "an installed plugin checks every extension"),
    "OPS-X03": ("warning", "the check of an extension does not fail itself"),
}


def check(
    code: str, level: Level, demand: str, *, profile: Profile = "default"
) -> Callable[[Callable[[View], Iterator[Complaint]]], Callable[[View], Iterator[Complaint]]]:
    """Register a check. `demand` says what has to be true, in one line."""

    def register(
        function: Callable[[View], Iterator[Complaint]],
    ) -> Callable[[View], Iterator[Complaint]]:
        if code in CHECKS:
            raise ValueError(f"two checks share the code {code}")
        CHECKS[code] = Check(code, level, demand, function, profile)
        return function

    return register


def all_checks() -> dict[str, Check]:
    """Return every check by code."""
    for room in _ROOMS:
        importlib.import_module(f"openprc.schema.{room}")
    return dict(sorted(CHECKS.items()))


@dataclass(frozen=True)
class Report:
    """What validation found in one file."""

    path: Path
    profile: Profile
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not any(finding.level == "error" for finding in self.findings)

    def at_least(self, level: Level) -> tuple[Finding, ...]:
        """Return the findings of a level or worse."""
        keep = LEVELS[: LEVELS.index(level) + 1]
        return tuple(finding for finding in self.findings if finding.level in keep)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        counts = {lv: sum(f.level == lv for f in self.findings) for lv in LEVELS}
        return {
            "path": str(self.path),
            "profile": self.profile,
            "ok": self.ok,
            "counts": counts,
            "findings": [finding.as_dict() for finding in self.findings],
        }


def validate_file(path: str | Path, *, profile: Profile = "default") -> Report:
    """Check a trajectory file against the contract.

    Parameters
    ----------
    path : path-like
    profile : {"default", "benchmark", "archive"}
        ``benchmark`` also demands a uniform physical clock and an input; ``archive`` hashes
        and no arbitrary units.

    Returns
    -------
    Report
        Also for files that cannot be opened: those have one finding ``OPS-F..``.

    Raises
    ------
    SchemaError
        When the profile is unknown.
    """
    path = Path(path)
    if profile not in PROFILES:
        raise SchemaError(
            f"profile {profile!r}", expected=" or ".join(PROFILES), fix="name one of these"
        )
    checks = all_checks()
    findings: list[Finding] = []
    try:
        file = open_hdf5(path)
    except OpenPRCError as error:
        code = "OPS-F02" if isinstance(error, UnsafeFile) else "OPS-F01"
        return Report(path, profile, (_opening(code, error),))
    with file:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", NewerSchemaWarning)
                check_version(file, path)
        except SchemaError as error:
            known = isinstance(error, SchemaTooNew | SchemaTooOld)
            return Report(path, profile, (_opening("OPS-F03" if known else "OPS-F04", error),))
        except DAMAGE as error:
            return Report(path, profile, (_unreadable("version", error),))
        findings += [
            Finding("OPS-F03", "warning", "/", str(w.message), "", "update openprc")
            for w in caught
            if issubclass(w.category, NewerSchemaWarning)
        ]
        view = View(file, path)
        wanted = {"default", profile}
        for item in checks.values():
            if item.profile in wanted:
                findings += _run(item, view)
    findings.sort(key=lambda finding: (LEVELS.index(finding.level), finding.code, finding.path))
    return Report(path, profile, tuple(findings))


def _run(item: Check, view: View) -> list[Finding]:
    try:
        return [Finding(item.code, item.level, *complaint) for complaint in item.function(view)]
    except DAMAGE as error:
        # HDF5 reports a checksum that does not match, or a block cut off, while reading; types
        # and shapes that no check expects come from files that other checks refuse.
        return [_unreadable(item.code, error)]


def _unreadable(code: str, error: Exception) -> Finding:
    return Finding(
        "OPS-F05",
        "error",
        "/",
        f"data cannot be read ({code}): {' '.join(str(error).split())}",
        "data as they were written",
        "copy the file again from where it was made",
    )


def _opening(code: str, error: OpenPRCError) -> Finding:
    return Finding(code, "error", error.key or "/", error.found, error.expected, error.fix)
