"""The kit as parametrised tests; pytest is imported here and nowhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from openprc.testing.cases import Case
from openprc.testing.check import Check, checks_for
from openprc.testing.outcome import CheckFailed, NotApplicable


class _Test:
    """A check as a test calls it: what does not apply is skipped, expected failures are marked."""

    def __init__(self, check: Check) -> None:
        self.check = check

    def __call__(self, case: Case, folder: Path) -> None:
        reason = case.expected_failures.get(self.check.id)
        try:
            self.check(case, folder)
        except NotApplicable as remark:
            pytest.skip(f"{self.check.id}: {remark}")
        except Exception:
            if reason is None:
                raise
            pytest.xfail(f"{self.check.id}: {reason}")
        if reason is not None:
            raise CheckFailed(
                f"it passes, and was expected to fail: {reason}",
                expected="a failure",
                fix=f"take {self.check.id} out of expected_failures",
                key=f"{self.check.id} of {case.name}",
            )

    def __repr__(self) -> str:
        return f"<{self.check.id}: {self.check.says}>"


def parametrize_with_checks(cases: Iterable[Case]) -> Callable[[Any], Any]:
    """Return a decorator that makes one test of every case and check.

    The test takes ``case``, ``check`` and a folder::

        @parametrize_with_checks(CASES)
        def test_conforms(case, check, tmp_path):
            check(case, tmp_path)
    """
    parameters = [
        pytest.param(
            case, _Test(item), id=f"{case.name}-{case.kind}-{item.id}",
            marks=[pytest.mark.slow] if case.is_slow(item.id) else [],
        )
        for case in cases
        for item in checks_for(case)
    ]  # fmt: skip
    return pytest.mark.parametrize(("case", "check"), parameters)


__all__ = ["parametrize_with_checks"]
