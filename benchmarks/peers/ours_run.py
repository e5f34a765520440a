"""This package from its input files to its output file."""

from __future__ import annotations

import tempfile
from pathlib import Path

from engine_scenes import Scene, to_experiment

from openprc.hooks import run_experiment
from openprc.schema import save_experiment
from peers.serving import SAVE_EVERY, Run, serve


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps and writes every hundredth."""

    def run(n_steps: int) -> None:
        interval = min(SAVE_EVERY, n_steps) * scene.dt
        experiment = to_experiment(scene, duration=n_steps * scene.dt, save_interval=interval)
        with tempfile.TemporaryDirectory() as name:
            save_experiment(experiment, Path(name))
            run_experiment(Path(name))

    return run


if __name__ == "__main__":
    serve(prepare)
