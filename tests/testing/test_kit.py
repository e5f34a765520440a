"""How the kit reports: outcomes, expected failures, tests made of checks, distributions."""

from __future__ import annotations

import json

import faulty_plugin
import pytest
import wire_code
import wire_plugin

from openprc.errors import UnknownName
from openprc.testing import (
    CheckFailed,
    ExporterCase,
    ImporterCase,
    NotApplicable,
    RecorderCase,
    RunnerCase,
    all_checks,
    cases_of,
    check_distribution,
    checks_for,
    parametrize_with_checks,
)


def good(**more):
    return ImporterCase(wire_plugin.producer(), entry_module="wire_plugin", **more)


def bad(name, **more):
    return ImporterCase(
        faulty_plugin.importer_record(name), make_sample=wire_code.write_sample,
        entry_module="faulty_plugin", **more,
    )  # fmt: skip


def check_of(name):
    return next(check for check in all_checks() if check.id == name)


# --- checks ------------------------------------------------------------------------------------


def test_ids_are_unique_and_sentences_are_sentences():
    names = [check.id for check in all_checks()]
    assert len(set(names)) == len(names)
    assert {check.family for check in all_checks()} == {
        "SPEC", "LIGHT", "SNIFF", "IMPORT", "VALUE", "REPEAT", "ROBUST", "RUN", "PHYS", "RECORD",
        "PIPE", "EXPORT",
    }  # fmt: skip
    for check in all_checks():
        assert len(check.says.split()) >= 4, check.id
        assert check.kinds, check.id


def test_every_kind_of_case_has_its_checks():
    for case, family in (
        (good(), "IMPORT"),
        (RunnerCase(wire_plugin.runner()), "PHYS"),
        (RecorderCase(wire_plugin.recorder()), "RECORD"),
        (ExporterCase(wire_plugin.exporter()), "EXPORT"),
    ):
        families = {check.family for check in checks_for(case)}
        assert {"SPEC", "LIGHT", family} <= families


def test_a_failure_says_where_what_and_how(tmp_path):
    with pytest.raises(CheckFailed, match="SNIFF-1 of importer-shy") as caught:
        check_of("SNIFF-1")(bad("Shy"), tmp_path)
    error = caught.value
    assert error.found == "sniff() is 0.3 sure of its own sample"
    assert error.expected == "at least 0.5"
    assert "content" in error.fix
    assert isinstance(error, AssertionError)


def test_an_error_of_the_family_is_a_failure_with_its_words(tmp_path):
    outcome = check_of("IMPORT-1").run(bad("Refusing"), tmp_path)
    assert outcome.state == "failed"
    assert "PluginError" in outcome.found
    assert "KeyError: 'positions'" in outcome.found


def test_what_does_not_apply_is_skipped_with_the_reason(tmp_path):
    outcome = check_of("VALUE-1").run(good(), tmp_path)
    assert (outcome.state, outcome.found) == ("skipped", "")
    assert "states no truth for positions" in outcome.reason
    with pytest.raises(NotApplicable, match="states no truth"):
        check_of("VALUE-1")(good(), tmp_path)


def test_without_its_back_end_nothing_but_record_and_listing_is_looked_at(tmp_path):
    spec = wire_plugin.producer(needs={"import": ("no_such_package_zq",)}, install="pip it")
    case = ImporterCase(spec)
    outcome = check_of("IMPORT-1").run(case, tmp_path)
    assert (outcome.state, outcome.reason) == ("skipped", "no_such_package_zq is not installed")
    assert check_of("SPEC-4").run(case, tmp_path).state == "passed"


# --- expected failures -------------------------------------------------------------------------


def test_an_expected_failure_is_told_as_such(tmp_path):
    case = bad("Shy", expected_failures={"SNIFF-1": "the format has no signature"})
    outcome = check_of("SNIFF-1").run(case, tmp_path)
    assert (outcome.state, outcome.reason) == ("expected", "the format has no signature")


def test_an_expected_failure_that_passes_is_a_failure(tmp_path):
    case = good(expected_failures={"SNIFF-1": "the format has no signature"})
    outcome = check_of("SNIFF-1").run(case, tmp_path)
    assert outcome.state == "failed"
    assert outcome.found == "it passes, and was expected to fail: the format has no signature"
    assert outcome.fix == "take SNIFF-1 out of expected_failures"


def test_expected_failures_of_unknown_checks_are_refused():
    with pytest.raises(ValueError, match=r"names \['SNIF-1'\]; expected ids of checks"):
        good(expected_failures={"SNIF-1": "?"})
    with pytest.raises(ValueError, match=r"names \['PHYS-1'\]"):
        good(expected_failures={"PHYS-1": "an importer has no physics"})


# --- tests made of checks ----------------------------------------------------------------------


def parameters(*cases):
    return {item.id: item for item in parametrize_with_checks(cases).args[1]}


def test_one_test_for_each_case_and_check():
    case = good(slow=("ROBUST", "PIPE-1"))
    made = parameters(case)
    assert list(made) == [f"wire-importer-{check.id}" for check in checks_for(case)]
    slow = {name for name, item in made.items() if item.marks}
    assert slow == {f"wire-importer-ROBUST-{n}" for n in range(1, 8)} | {"wire-importer-PIPE-1"}


def test_tests_fail_skip_and_expect(tmp_path):
    def call(case, name):
        made = parameters(case)[f"{case.name}-importer-{name}"]
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        made.values[1](case, folder)

    call(good(), "SNIFF-1")
    with pytest.raises(CheckFailed, match="SNIFF-1"):
        call(bad("Shy"), "SNIFF-1")
    with pytest.raises(pytest.skip.Exception, match="VALUE-1: the case states no truth"):
        call(good(), "VALUE-1")
    expecting = {"expected_failures": {"SNIFF-1": "known"}}
    with pytest.raises(pytest.xfail.Exception, match="SNIFF-1: known"):
        call(bad("Shy", **expecting), "SNIFF-1")
    with pytest.raises(CheckFailed, match="it passes, and was expected to fail: known"):
        call(good(**expecting), "SNIFF-1")


# --- distributions -----------------------------------------------------------------------------


def test_a_distribution_is_checked_without_pytest():
    report = check_distribution("openprc-example", wanted=("SPEC", "IMPORT-1"))
    assert report.ok
    assert (report.cases[0].name, report.cases[0].kind) == ("csv", "importer")
    ids = [outcome.check for outcome in report.cases[0].outcomes]
    assert ids == ["SPEC-1", "SPEC-2", "SPEC-3", "SPEC-4", "SPEC-5", "IMPORT-1"]
    plain = json.loads(json.dumps(report.as_dict()))
    assert plain["distribution"] == "openprc-example"
    assert plain["cases"][0]["outcomes"][0]["state"] == "passed"
    assert plain["ok"] is True


def test_the_report_of_a_faulty_case_is_not_ok():
    told = []
    report = check_distribution(
        "openprc-example", cases=[bad("Shy")], wanted=("SNIFF-1", "SPEC-2"),
        told=lambda case, name, says: told.append((case.name, name)),
    )  # fmt: skip
    assert not report.ok
    ((case, outcome),) = report.failures
    assert (case.name, outcome.check, case.count("passed")) == ("importer-shy", "SNIFF-1", 1)
    assert told == [("importer-shy", "SPEC-2"), ("importer-shy", "SNIFF-1")]


def test_a_distribution_that_is_not_there():
    with pytest.raises(UnknownName, match="there is no working plugin 'openprc-nobody'") as caught:
        cases_of("openprc-nobody")
    assert "openprc-example" in caught.value.expected


def test_an_empty_report_is_not_ok():
    assert not check_distribution("openprc-example", cases=[]).ok
