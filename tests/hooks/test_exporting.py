"""Exporting: whose code writes, and what is left when it fails."""

import re

import pytest

from openprc.errors import PluginError, ResultExists, UnknownName
from openprc.hooks import ExporterSpec, Registry
from openprc.hooks.exporting import export_file
from openprc.schema import Provenance, TrajectoryWriter


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="m")
        writer.append([0.0, 0.1], positions=[[[1.0, 2.0]], [[3.0, 4.0]]])
    return path


@pytest.fixture
def exporting(make_entry, make_code):
    """Return a function that makes a registry with one exporter, named txt."""

    def make(export):
        behind = type("Exporter", (), {"export": staticmethod(export)})
        spec = ExporterSpec("txt", "Text", make_code("Exporter", behind))
        return Registry([make_entry("text", openprc_exporters=[spec])])

    return make


def write(trajectory, path, *, options):
    path.write_text(str(trajectory.positions().ravel().tolist()))
    return [path]


def write_two(trajectory, path, *, options):
    other = path.with_suffix(".info")
    other.write_text("info")
    return [*write(trajectory, path, options=options), other]


@pytest.mark.parametrize("to", [None, "txt", "openprc-text/txt"])
def test_the_ending_or_the_name_chooses(run, tmp_path, exporting, to):
    made = export_file(run, tmp_path / "sub" / "out.txt", to=to, registry=exporting(write))
    assert made == (tmp_path / "sub" / "out.txt",)
    assert made[0].read_text() == "[1.0, 2.0, 3.0, 4.0]"
    assert [item.name for item in (tmp_path / "sub").iterdir()] == ["out.txt"]


def test_files_beside_the_one_asked_for(run, tmp_path, exporting):
    made = export_file(run, tmp_path / "out.txt", registry=exporting(write_two))
    assert [item.name for item in made] == ["out.txt", "out.info"]
    assert all(item.is_file() for item in made)


def test_unknown_exporter(run, tmp_path, exporting):
    with pytest.raises(UnknownName, match="no exporter named 'vtu'"):
        export_file(run, tmp_path / "out.vtu", registry=exporting(write))


@pytest.mark.parametrize("name", ["out.txt", "out.info"])
def test_nothing_is_replaced_unless_told(run, tmp_path, exporting, name):
    (tmp_path / name).write_text("old")
    with pytest.raises(ResultExists, match=re.escape(name)):
        export_file(run, tmp_path / "out.txt", registry=exporting(write_two))
    assert (tmp_path / name).read_text() == "old"
    assert sum(item.suffix in (".txt", ".info") for item in tmp_path.iterdir()) == 1
    export_file(run, tmp_path / "out.txt", overwrite=True, registry=exporting(write_two))
    assert (tmp_path / name).read_text() != "old"


def fail_midway(trajectory, path, *, options):
    path.write_text("half")
    raise ZeroDivisionError("no")


def report_elsewhere(trajectory, path, *, options):
    return [path.parent.parent / "run.h5"]


@pytest.mark.parametrize(
    ("export", "words"),
    [
        (fail_midway, "openprc-text/txt failed while exporting run.h5: ZeroDivisionError"),
        (report_elsewhere, "openprc-text/txt reported"),
        (lambda trajectory, path, *, options: [], "reported no file"),
        (lambda trajectory, path, *, options: [path], "openprc-text/txt reported"),
        (lambda trajectory, path, *, options: None, "failed while exporting"),
    ],
)
def test_a_faulty_exporter_leaves_nothing(run, tmp_path, exporting, export, words):
    with pytest.raises(PluginError, match=re.escape(words)):
        export_file(run, tmp_path / "out.txt", registry=exporting(export))
    assert [item.name for item in tmp_path.iterdir()] == ["run.h5"]
