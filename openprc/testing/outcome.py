"""What a check has to say: passed, failed and how to mend it, or left out and why."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, NoReturn

from openprc.errors import OpenPRCError

State = Literal["passed", "failed", "skipped", "expected"]


class CheckFailed(OpenPRCError, AssertionError):
    """A plugin does not do what a check asks for."""

    exit_code = 1


class NotApplicable(Exception):
    """A check has nothing to look at in this case; the text says why."""


def fail(found: str, *, expected: str, fix: str, key: str | None = None) -> NoReturn:
    """Raise `CheckFailed`."""
    raise CheckFailed(found, expected=expected, fix=fix, key=key)


@dataclass(frozen=True)
class Outcome:
    """The result of one check on one case.

    ``state`` is "passed", "failed", "skipped" (`reason` says why) or "expected": it failed as
    the author of the plugin said it would, for the `reason` given there.
    """

    check: str
    says: str
    state: State
    found: str = ""
    expected: str = ""
    fix: str = ""
    reason: str = ""
    seconds: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON output."""
        return asdict(self)


@dataclass(frozen=True)
class CaseReport:
    """Every check on one case; ``kind`` is importer, runner, recorder or exporter."""

    name: str
    kind: str
    outcomes: tuple[Outcome, ...]

    def count(self, state: State) -> int:
        """Return how many checks ended in `state`."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def ok(self) -> bool:
        """Whether nothing failed."""
        return not self.count("failed")

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON output."""
        return {
            "name": self.name,
            "kind": self.kind,
            "outcomes": [outcome.as_dict() for outcome in self.outcomes],
        }


@dataclass(frozen=True)
class Report:
    """The kit's report on a distribution."""

    distribution: str
    version: str
    cases: tuple[CaseReport, ...]

    @property
    def ok(self) -> bool:
        """Whether there was something to check and nothing failed."""
        return bool(self.cases) and all(case.ok for case in self.cases)

    @property
    def failures(self) -> tuple[tuple[CaseReport, Outcome], ...]:
        """Every failed check with its case."""
        return tuple(
            (case, outcome)
            for case in self.cases
            for outcome in case.outcomes
            if outcome.state == "failed"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values, for JSON output."""
        return {
            "distribution": self.distribution,
            "version": self.version,
            "ok": self.ok,
            "cases": [case.as_dict() for case in self.cases],
        }


__all__ = ["CaseReport", "CheckFailed", "NotApplicable", "Outcome", "Report", "State", "fail"]
