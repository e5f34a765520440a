"""A check: a number to quote, a sentence, and a function that looks."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from openprc.errors import OpenPRCError
from openprc.hooks.registry import absent_packages
from openprc.testing.outcome import CheckFailed, NotApplicable, Outcome, State

if TYPE_CHECKING:
    from openprc.testing.cases import Case

Kind = Literal["importer", "runner", "recorder", "exporter"]
KINDS: tuple[Kind, ...] = ("importer", "runner", "recorder", "exporter")

#: Modules that hold the checks, in the order in which a plugin is looked at.
_FAMILIES = (
    "checks_spec", "checks_light", "checks_sniff", "checks_import", "checks_value",
    "checks_repeat", "checks_robust", "checks_run", "checks_scene", "checks_phys",
    "checks_record", "checks_pipe", "checks_export",
)  # fmt: skip

#: Families that look at a plugin whether or not what it drives is installed.
_WITHOUT_BACK_END = ("SPEC", "LIGHT")

#: Of a case of one of the kinds named beside it, and a folder to work in.
Function = Callable[[Any, Path], None]


@dataclass(frozen=True)
class Check:
    """One thing that every plugin of some kind has to do.

    Parameters
    ----------
    id : str
        Family and number, such as "ROBUST-3"; stable, so that issues may quote it.
    says : str
        What it looks for, in one sentence.
    kinds : tuple of {"importer", "runner", "recorder", "exporter"}
    apart : bool
        Whether it starts processes of its own, which takes a second or so.
    """

    id: str
    says: str
    kinds: tuple[Kind, ...]
    function: Function
    apart: bool = False

    @property
    def family(self) -> str:
        """The part of the id before the number."""
        return self.id.rpartition("-")[0]

    def __call__(self, case: Case, folder: Path) -> None:
        """Look at `case`, with `folder` to work in.

        Raises
        ------
        CheckFailed
            With what was found, what was expected and how to mend it.
        NotApplicable
            When there is nothing to look at.
        """
        folder = Path(folder)
        absent = absent_packages(case.needs)
        if absent and self.family not in _WITHOUT_BACK_END:
            raise NotApplicable(f"{', '.join(absent)} is not installed")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.function(case, folder)
        except CheckFailed as failure:
            raise CheckFailed(
                failure.found,
                expected=failure.expected,
                fix=failure.fix,
                key=f"{self.id} of {case.name}",
            ) from failure.__cause__
        except OpenPRCError as error:
            raise CheckFailed(
                f"{type(error).__name__}: {error.found}",
                expected=error.expected or self.says,
                fix=error.fix or "see what raised it",
                key=f"{self.id} of {case.name}",
            ) from error

    def run(self, case: Case, folder: Path) -> Outcome:
        """Look at `case` and return what came of it; only Ctrl-C gets out.

        An expected failure is strict: when the check passes, that is a failure, too.
        """
        started = time.perf_counter()
        state: State = "passed"
        found = expected = fix = reason = ""
        allowed = case.expected_failures.get(self.id)
        try:
            self(case, folder)
        except NotApplicable as remark:
            state, reason = "skipped", str(remark)
        except CheckFailed as failure:
            state = "failed" if allowed is None else "expected"
            found, expected, fix = failure.found, failure.expected, failure.fix
            reason = allowed or ""
        except Exception as error:  # noqa: BLE001 - a plugin may raise anything; the report goes on
            state = "failed" if allowed is None else "expected"
            found = f"{type(error).__name__}: {' '.join(str(error).split())}"
            expected, fix, reason = self.says, "see what raised it", allowed or ""
        else:
            if allowed is not None:
                state, found = "failed", f"it passes, and was expected to fail: {allowed}"
                expected, fix = "a failure", f"take {self.id} out of expected_failures"
        seconds = time.perf_counter() - started
        return Outcome(self.id, self.says, state, found, expected, fix, reason, seconds)


_CHECKS: dict[str, Check] = {}


def check(
    id: str,
    says: str,
    *kinds: Kind,
    apart: bool = False,
) -> Callable[[Function], Function]:
    """Return a decorator that makes a check of a function."""

    def register(function: Function) -> Function:
        if id in _CHECKS and _CHECKS[id].function.__module__ != function.__module__:
            raise ValueError(f"there are two checks {id}; give each its own number")
        _CHECKS[id] = Check(id, says, kinds, function, apart)
        return function

    return register


def all_checks() -> tuple[Check, ...]:
    """Return every check, in the order in which a plugin is looked at."""
    for family in _FAMILIES:
        import_module(f"openprc.testing.{family}")
    return tuple(_CHECKS.values())


def checks_for(case: Case) -> tuple[Check, ...]:
    """Return the checks for a case of this kind."""
    return tuple(item for item in all_checks() if case.kind in item.kinds)


__all__ = ["KINDS", "Check", "Kind", "all_checks", "check", "checks_for"]
