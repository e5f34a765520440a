"""Checks that every plugin has to pass, for the test file of its author.

A whole test file::

    from openprc.testing import ImporterCase, parametrize_with_checks
    from openprc_example import openprc_producers

    CASES = [ImporterCase(spec, heavy=("pandas",)) for spec in openprc_producers()]

    @parametrize_with_checks(CASES)
    def test_conforms(case, check, tmp_path):
        check(case, tmp_path)

`check_distribution` does the same without pytest, for the command line. What is looked for is
in `all_checks`; every check has an id to quote, and a message with what was found, what was
expected, and how to mend it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "CaseReport": "outcome",
    "CheckFailed": "outcome",
    "ExporterCase": "cases",
    "ImporterCase": "cases",
    "NotApplicable": "outcome",
    "Outcome": "outcome",
    "RecorderCase": "cases",
    "Report": "outcome",
    "RunnerCase": "cases",
    "all_checks": "check",
    "cases_of": "distribution",
    "check_distribution": "distribution",
    "checks_for": "check",
    "parametrize_with_checks": "pytest_marks",
}

__all__ = list(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(f"openprc.testing.{_LAZY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
