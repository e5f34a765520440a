"""Options of runners and exporters: checked before anything is run or written."""

from __future__ import annotations

import pytest

from openprc.demlat.samples import write_sample
from openprc.errors import AmbiguousName, ConfigError, MissingDependency
from openprc.hooks import ExporterSpec, OptionSpec, ProducerSpec, Registry, export_file
from openprc.hooks.running import run_experiment
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

GAIN = OptionSpec("gain", "How strong", kind="float", default=2.0)


class Runner:
    """Writes its option as a position."""

    def supports(self, experiment):
        return []

    def run(self, experiment, writer, *, seed, progress, options):
        writer.declare_nodes(1, 2, unit="m")
        writer.append([0.0], positions=[[[options["gain"], 0.0]]])


@pytest.fixture
def running(make_entry, make_code):
    spec = ProducerSpec(
        "strong", "Runs", make_code("Runner", Runner), capabilities=("run",), run_options=(GAIN,)
    )
    return Registry([make_entry("strong", openprc_producers=[spec])])


@pytest.mark.parametrize(("given", "gain"), [({}, 2.0), ({"gain": "3.5"}, 3.5)])
def test_a_runner_is_given_its_options(running, tmp_path, given, gain):
    folder = write_sample(tmp_path).path
    run = run_experiment(
        folder, tmp_path / "out.h5", producer="strong", options=given, registry=running
    )
    with Trajectory(run.path) as found:
        assert found.positions()[0, 0, 0] == gain
        assert f'"gain": {gain}' in str(found.provenance) or gain in _values(found.provenance)


def _values(thing):
    if isinstance(thing, dict):
        return [value for item in thing.values() for value in _values(item)]
    return [thing]


@pytest.mark.parametrize(
    ("given", "words"),
    [({"gian": 1}, "did you mean 'gain'"), ({"gain": "much"}, "a finite number")],
)
def test_wrong_options_of_a_runner(running, tmp_path, given, words):
    folder = write_sample(tmp_path).path
    with pytest.raises(ConfigError, match=words):
        run_experiment(
            folder, tmp_path / "out.h5", producer="strong", options=given, registry=running
        )
    assert not (tmp_path / "out.h5").exists()


def test_options_for_a_producer_without_any(tmp_path):
    folder = write_sample(tmp_path).path
    with pytest.raises(ConfigError, match="demlat has no option 'gain'"):
        run_experiment(folder, tmp_path / "out.h5", options={"gain": 1})


def test_records_with_impossible_options():
    with pytest.raises(ValueError, match="has run_options, and cannot run"):
        ProducerSpec("a", "A", "a:B", capabilities=("import",), run_options=(GAIN,))
    with pytest.raises(ValueError, match="two options share a name"):
        ProducerSpec("a", "A", "a:B", capabilities=("run",), run_options=(GAIN, GAIN))
    with pytest.raises(ValueError, match="two options share a name"):
        ExporterSpec("a", "A", "a:B", options=(GAIN, GAIN))
    with pytest.raises(ValueError, match="expected lower case, leading dot"):
        ExporterSpec("a", "A", "a:B", suffixes=("txt",))


class Exporter:
    """Writes its options."""

    def export(self, trajectory, path, *, options):
        path.write_text(f"{options['gain']} {options['final']}")
        return [path]


@pytest.fixture
def exporting(make_entry, make_code):
    def make(**settings):
        behind = make_code("Exporter", Exporter)
        spec = ExporterSpec("strong", "Writes", behind, options=(GAIN,), **settings)
        return Registry([make_entry("strong", openprc_exporters=[spec])])

    return make


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="m")
        writer.append([0.0], positions=[[[1.0, 2.0]]])
    return path


def test_an_exporter_is_given_its_options_and_where_the_file_will_be(run, tmp_path, exporting):
    out = tmp_path / "sub" / "out.strong"
    export_file(run, out, options={"gain": 4}, registry=exporting())
    assert out.read_text() == f"4.0 {out}"
    with pytest.raises(ConfigError, match="strong has no option 'gani'"):
        export_file(run, tmp_path / "b.strong", options={"gani": 1}, registry=exporting())
    assert not (tmp_path / "b.strong").exists()


def test_the_ending_chooses_by_the_suffixes_of_the_record(run, tmp_path, exporting):
    registry = exporting(suffixes=(".bin", ".tar.gz"))
    for name in ("a.bin", "a.TAR.GZ", "a.strong"):
        export_file(run, tmp_path / name, registry=registry)
        assert (tmp_path / name).read_text().startswith("2.0")


def test_two_exporters_of_one_ending_are_told_apart_by_name(run, tmp_path, make_entry, make_code):
    entries = [
        make_entry(
            name,
            openprc_exporters=[
                ExporterSpec(name, "Writes", make_code("Exporter", Exporter), suffixes=(".bin",),
                             options=(GAIN,))
            ],
        )
        for name in ("one", "two")
    ]  # fmt: skip
    registry = Registry(entries)
    with pytest.raises(AmbiguousName, match="one, two"):
        export_file(run, tmp_path / "a.bin", registry=registry)
    export_file(run, tmp_path / "a.bin", to="two", registry=registry)
    assert (tmp_path / "a.bin").exists()


def test_what_an_exporter_needs_is_said(run, tmp_path, exporting):
    registry = exporting(needs=("surely_absent",), install="pip install surely-absent")
    with pytest.raises(MissingDependency, match="strong needs surely_absent to export"):
        export_file(run, tmp_path / "a.strong", registry=registry)
