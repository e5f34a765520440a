"""The paper authors' package, 0.1.1, CPU back end, on a scene of rigid bars.

A negative stiffness tells it that a bar is rigid. A run goes over ``scene.dt`` seconds in as
many steps as it is told and leaves ten frames (10, N, 3) [m] in the file of positions.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from engine_scenes import Scene
from openprc.demlat.core.simulation import Simulation

from openprc.demlat.models.barhinge.model import BarHingeModel
from peers.serving import Run, serve
from peers.upstream import write_folder

N_FRAMES = 10


def prepare(scene: Scene) -> Run:
    """Return a function that takes n steps over the whole time."""
    with tempfile.TemporaryDirectory() as name:
        write_folder(scene, Path(name), n_steps=1)
        model = BarHingeModel(Simulation(name), backend="cpu", precision="float64")
    solver, scaler = model.solver, model.scaler
    duration = scaler.to_sim(scene.dt, "time")
    x0, v0 = scaler.to_sim(scene.positions, "length"), scaler.to_sim(scene.velocities, "velocity")

    def run(n_steps: int) -> None:
        solver.upload_state(x0, v0)
        frames = []
        for step in range(n_steps):
            solver.step(step * duration / n_steps, duration / n_steps, {})
            if (step + 1) % (n_steps // N_FRAMES) == 0:
                frames.append(scaler.from_sim(solver.x.copy(), "length"))
        np.save(sys.argv[2], np.array(frames))

    return run


if __name__ == "__main__":
    serve(prepare)
