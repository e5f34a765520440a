"""Scenes that are run, and the command line in this process."""

import json
from dataclasses import dataclass

import pytest

from openprc.cli.main import main
from openprc.hooks.running import run_experiment
from openprc.scenes.catalog import build_scene, write_scene


@pytest.fixture
def run_scene(tmp_path):
    """Return a function that runs a scene and returns it with the file."""
    folders = []

    def run(name, *, producer="demlat", run_options=None, **options):
        scene = build_scene(name, options)
        folder = tmp_path / f"{len(folders)}-{name}"
        folders.append(folder)
        write_scene(scene, folder)
        return scene, run_experiment(folder, producer=producer, options=run_options).path

    return run


@dataclass
class Said:
    """What a call of the command line did."""

    code: int
    out: str
    err: str

    @property
    def text(self):
        """All that was printed, on one line."""
        return " ".join((self.out + self.err).split())

    @property
    def data(self):
        """What was printed as JSON."""
        return json.loads(self.out)


@pytest.fixture
def call(capsys, monkeypatch, tmp_path):
    """Return a function that calls the command line with words, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("warnings.showwarning", __import__("warnings").showwarning)

    def said(*words):
        with pytest.raises(SystemExit) as stop:
            main([str(word) for word in words])
        printed = capsys.readouterr()
        return Said(stop.value.code, printed.out, printed.err)

    return said
