"""Plugins check their own subtrees; a faulty check harms nobody."""

import pytest

from openprc.hooks import ExtensionSpec, Registry
from openprc.hooks.validating import validate_run
from openprc.schema import Finding, Provenance, TrajectoryWriter
from openprc.schema.validate import BY_PLUGINS


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="m")
        writer.declare_input("u", ["u"], quantity="force", unit="N")
        writer.declare_extension("openprc-lab", "1.0")
        writer.put_extension("openprc-lab", "gain", [2.0], unit="V")
        for i in range(3):
            writer.append(0.1 * i, positions=[[0.0, i]], inputs={"u": [i]})
    return path


@pytest.fixture
def checking(make_entry, make_code):
    """Return a function that makes a registry with one check of openprc-lab."""

    def make(check):
        spec = ExtensionSpec("openprc-lab", "Gain of the sensor", make_code("check", check))
        return Registry([make_entry("lab", openprc_extensions=[spec])])

    return make


def test_findings_of_the_plugin_are_in_the_report(run, checking):
    def check(trajectory):
        if trajectory.extension("openprc-lab", "gain")[0] > 1:
            yield Finding("LAB-1", "error", "/extensions/openprc-lab/gain", "a gain above 1")

    report = validate_run(run, registry=checking(check))
    assert [finding.code for finding in report.findings] == ["LAB-1"]
    assert not report.ok


def test_a_subtree_that_nobody_knows_is_a_hint(run):
    report = validate_run(run, registry=Registry([]))
    assert [(f.code, f.level) for f in report.findings] == [("OPS-X02", BY_PLUGINS["OPS-X02"][0])]
    assert report.ok


@pytest.mark.parametrize(
    "check",
    [
        lambda trajectory: 1 / 0,
        lambda trajectory: ["not a finding"],
        lambda trajectory: None,
        lambda trajectory: (_ for _ in ()).throw(SystemExit(3)),
    ],
)
def test_a_faulty_check_is_a_warning_about_the_check(run, checking, check):
    report = validate_run(run, registry=checking(check))
    assert [(f.code, f.level) for f in report.findings] == [("OPS-X03", BY_PLUGINS["OPS-X03"][0])]
    assert "openprc-lab" in report.findings[0].found


def test_a_file_that_breaks_the_contract_is_not_shown_to_plugins(tmp_path, checking):
    path = tmp_path / "text.h5"
    path.write_text("text")
    report = validate_run(path, registry=checking(lambda trajectory: 1 / 0))
    assert [finding.code for finding in report.findings] == ["OPS-F01"]
