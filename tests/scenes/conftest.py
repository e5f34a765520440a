"""Scenes that have been run, for those who ask more than once."""

import pytest

from openprc.hooks.running import run_experiment
from openprc.scenes.catalog import build_scene, write_scene


@pytest.fixture
def run_scene(tmp_path):
    """Return a function that runs a scene and returns it with the file."""

    def run(name, *, producer="demlat", run_options=None, **options):
        scene = build_scene(name, options)
        folder = tmp_path / f"{name}-{producer}"
        write_scene(scene, folder)
        return scene, run_experiment(folder, producer=producer, options=run_options).path

    return run
