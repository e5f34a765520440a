"""``openprc check-plugin``: the kit on the command line, as a table and as JSON."""

from __future__ import annotations

import pytest

from openprc.hooks import FeatureSpec, OptionSpec, ProducerSpec


@pytest.fixture
def greedy(install):
    """Install a plugin whose importer claims every file."""
    from openprc_example import openprc_producers
    from openprc_example.importer import CsvImporter

    class Greedy(CsvImporter):
        def sniff(self, path):
            return 1.0

    (csv,) = openprc_producers()
    spec = install.importer(
        "greedy", Greedy, suffixes=(".csv",), options=csv.options, sample=csv.sample,
        citation="A. Author (2026)",
    )  # fmt: skip
    install(greedy={"openprc_producers": [spec]})


@pytest.mark.usefixtures("greedy")
def test_a_fault_is_told_with_what_to_do(openprc):
    done = openprc("check-plugin", "openprc-greedy", "--check", "SNIFF")
    assert done.code == 1
    assert "FAILED, greedy (importer)" in done.text
    assert "to do: " in done.text
    assert done.text.endswith("does not conform")


@pytest.mark.usefixtures("greedy")
def test_what_passes_is_counted_and_shown_on_demand(openprc):
    done = openprc("check-plugin", "greedy", "--check", "IMPORT-1", "--all")
    assert done.code == 0, done.text
    assert "IMPORT-1 ok, greedy (importer)" in done.text
    assert done.text.endswith(" conforms")


@pytest.mark.usefixtures("greedy")
def test_json_has_every_outcome(openprc):
    done = openprc("check-plugin", "greedy", "--check", "SNIFF", "--json")
    assert (done.data["ok"], done.code) == (False, 1)
    outcomes = done.data["cases"][0]["outcomes"]
    assert {entry["check"].partition("-")[0] for entry in outcomes} == {"SNIFF"}
    assert any(entry["state"] == "failed" and entry["fix"] for entry in outcomes)


@pytest.mark.usefixtures("greedy")
def test_wrong_calls(openprc):
    done = openprc("check-plugin", "greedy", "--check", "SNIF")
    assert done.code == 2
    assert "Did you mean 'SNIFF'" in done.text
    done = openprc("check-plugin", "absent")
    assert done.code == 2
    assert "no working plugin 'absent'" in done.text


def test_options_reach_the_runner(openprc, install):
    seen = []

    class Runner:
        def supports(self, experiment):
            return []

        def run(self, experiment, writer, *, seed, progress, options):
            seen.append(options["gain"])
            raise ValueError("on purpose")

    spec = ProducerSpec(
        "strong", "Runs", install.code("Runner", Runner), capabilities=("run",),
        run_options=(OptionSpec("gain", "How strong", kind="float", default=1.0),),
        citation="A. Author (2026)",
    )  # fmt: skip
    install(strong={"openprc_producers": [spec]})
    done = openprc("check-plugin", "strong", "--check", "RUN-1", "-o", "gain=2.5")
    assert (done.code, set(seen)) == (1, {2.5})
    assert "ValueError: on purpose" in done.text


def test_a_plugin_without_anything_to_check(openprc, install):
    install(shy={"openprc_features": [FeatureSpec("shy", "Shy", "a.b:C")]})
    done = openprc("check-plugin", "shy")
    assert done.code == 1
    assert "nothing that the kit checks" in done.text
