"""The paper authors' package, 0.1.1, from its input files to its output file: `Engine.run`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from engine_scenes import Scene
from openprc.demlat.core.engine import Engine
from openprc.demlat.core.simulation import Simulation

from openprc.demlat.models.barhinge.model import BarHingeModel
from peers.serving import Run, serve
from peers.upstream import write_folder


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps and writes every hundredth."""

    def run(n_steps: int) -> None:
        with tempfile.TemporaryDirectory() as name:
            write_folder(scene, Path(name), n_steps=n_steps)
            Engine(BarHingeModel, backend="cpu").run(Simulation(name))

    return run


if __name__ == "__main__":
    serve(prepare)
