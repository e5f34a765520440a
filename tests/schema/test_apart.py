"""A validator that a damaged file cannot take down."""

import os
import signal

import pytest

from openprc.errors import SchemaError
from openprc.schema import apart
from openprc.schema.validate import OPENING, Report, validate_file

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process of its own")


def test_the_report_is_that_of_the_same_process(complete):
    assert apart.validate_apart(complete, profile="archive") == validate_file(
        complete, profile="archive"
    )


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_crash_of_the_library_is_a_finding(complete, monkeypatch, number):
    monkeypatch.setattr(apart, "validate_file", lambda *_, **__: os.kill(os.getpid(), number))
    report = apart.validate_apart(complete)
    assert [finding.code for finding in report.findings] == [apart.CRASHED]
    assert apart.CRASHED in OPENING
    assert signal.Signals(number).name in report.findings[0].found
    assert not report.ok


def test_a_child_that_says_nothing(complete, monkeypatch):
    monkeypatch.setattr(apart, "validate_file", lambda *_, **__: os._exit(3))
    assert "exit code 3" in apart.validate_apart(complete).findings[0].found


def test_errors_come_through(complete):
    with pytest.raises(SchemaError, match="profile 'strict'"):
        apart.validate_apart(complete, profile="strict")


def test_a_long_report_comes_through(complete, monkeypatch):
    many = Report(complete, "default", validate_file(complete).findings * 1 + tuple(
        apart._crash(signal.SIGSEGV) for _ in range(5000)))  # fmt: skip
    monkeypatch.setattr(apart, "validate_file", lambda *_, **__: many)
    assert len(apart.validate_apart(complete).findings) >= 5000
