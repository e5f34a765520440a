"""Scenes that are run, and the command line in this process."""

import warnings

import pytest
from command_line import called

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


@pytest.fixture
def call(capsys, monkeypatch, tmp_path):
    """Return a function that calls the command line with words, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)

    def said(*words):
        return called(capsys, *words)

    return said
