"""Exports that must leave nothing, or must not begin; see also test_exporting.py."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import PluginError, ResultExists, UnreadableFile
from openprc.hooks import ExporterSpec, Registry
from openprc.hooks.exporting import export_file
from openprc.schema import Provenance, TrajectoryWriter


class Exporter:
    """Writes the number of frames, and a second file beside it."""

    def export(self, trajectory, path, *, options):
        path.write_text(f"{trajectory.n_frames}\n")
        beside = path.with_suffix(".more")
        beside.write_text("more")
        return [path, beside]


def returning(make):
    class Odd(Exporter):
        def export(self, trajectory, path, *, options):
            files = super().export(trajectory, path, options=options)
            return make(path, files)

    return Odd


def raising(error):
    def make(path, files):
        raise error

    return returning(make)


def elsewhere(path, files):
    outside = path.parent.parent / "outside.txt"
    outside.write_text("x")
    return [outside]


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="m")
        writer.append([0.0, 0.1, 0.2], positions=np.zeros((3, 1, 2)))
    return path


@pytest.fixture
def export(make_entry, make_code, run, tmp_path):
    """Return a function that exports the run with an exporter class."""

    def call(exporter=Exporter, *, path=run, out=tmp_path / "out" / "run.fake", **words):
        spec = ExporterSpec("fake", "A fake", make_code("Exporter", exporter))
        registry = Registry([make_entry(openprc_exporters=[spec])])
        return export_file(path, out, registry=registry, **words)

    return call


def names_in(folder):
    return sorted(p.name for p in folder.iterdir()) if folder.exists() else []


@pytest.mark.parametrize(
    ("exporter", "words"),
    [
        (raising(SystemExit(0)), "failed while exporting run.h5: SystemExit"),
        (returning(lambda path, files: [path.with_name("never-written")]), "never-written"),
        (int, "no attribute 'export'"),
    ],
)
def test_an_exporter_that_fails_leaves_nothing(export, tmp_path, exporter, words):
    with pytest.raises(PluginError, match=words):
        export(exporter)
    assert names_in(tmp_path / "out") == []


def test_files_elsewhere_are_not_taken(export, tmp_path):
    with pytest.raises(PluginError, match=r"reported .*outside\.txt"):
        export(returning(elsewhere))
    assert not (tmp_path / "out" / "run.fake").exists()


def test_ctrl_c_leaves_nothing(export, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        export(raising(KeyboardInterrupt()))
    assert names_in(tmp_path / "out") == []


def test_the_trajectory_is_never_replaced(export, run):
    before = run.read_bytes()
    with pytest.raises(ResultExists, match="would replace what is exported"):
        export(out=run, to="fake", overwrite=True)
    assert run.read_bytes() == before


def test_nothing_is_made_for_a_missing_trajectory(export, tmp_path):
    with pytest.raises(UnreadableFile, match="does not exist"):
        export(path=tmp_path / "none.h5")
    assert not (tmp_path / "out").exists()
