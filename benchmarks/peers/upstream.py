"""The paper authors' package, 0.1.1, CPU back end: what one call of its solver's step costs.

The scene goes through the package's own files, model and scaling, in float64 throughout. Its
scheme is of first order and blows up on undamped modes (its position stages use the velocity
of the step's start), so a run starts again from the scene before numbers overflow.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import h5py
import numpy as np
from engine_scenes import Scene
from openprc.demlat.core.simulation import Simulation

from openprc.demlat.models.barhinge.model import BarHingeModel
from peers.serving import SAVE_EVERY, Run, serve

#: Steps after which a run starts again.
LONGEST_STRETCH = 100


def write_folder(scene: Scene, folder: Path, *, n_steps: int) -> None:
    """Write the package's input files; float64 where it would write float32."""
    inputs = folder / "input"
    inputs.mkdir(parents=True, exist_ok=True)
    tables = {
        "nodes/positions": scene.positions,
        "nodes/masses": scene.masses,
        "nodes/attributes": scene.fixed.astype(np.uint8),
        "elements/bars/indices": scene.bars,
        "elements/bars/stiffness": scene.stiffness,
        "elements/bars/rest_length": scene.rest_length,
        "elements/bars/damping": scene.damping,
        "elements/bars/prestress": np.zeros(len(scene.bars)),
    }
    if len(scene.hinges):
        tables["elements/hinges/indices"] = scene.hinges
        tables["elements/hinges/stiffness"] = scene.hinge_stiffness
        tables["elements/hinges/angle"] = scene.rest_angle
        tables["elements/hinges/damping"] = np.zeros(len(scene.hinges))
    with h5py.File(inputs / "geometry.h5", "w") as file:
        for name, values in tables.items():
            file[name] = values
    with h5py.File(inputs / "signals.h5", "w") as file:
        file.attrs["dt_base"] = scene.dt
    # It takes kg/s at the mean nodal mass, as the drag of the experiment files does.
    damping = float((scene.drag / scene.masses).mean() * scene.masses.mean())
    config = {
        # It takes one step more than fits into the duration, and truncates.
        "simulation": {
            "duration": (n_steps - 0.5) * scene.dt,
            "dt_base": scene.dt,
            "dt_save": (SAVE_EVERY + 0.5) * scene.dt,
        },
        "global_physics": {"gravity": 0.0, "global_damping": damping, "enable_collision": False},
        "material": {"damping_coefficient": damping},
        "actuators": [],
    }
    (inputs / "config.json").write_text(json.dumps(config))


def prepare(scene: Scene) -> Run:
    """Return a function that runs n steps."""
    with tempfile.TemporaryDirectory() as name:
        write_folder(scene, Path(name), n_steps=1)
        model = BarHingeModel(Simulation(name), backend="cpu", precision="float64")
    solver, scaler = model.solver, model.scaler
    dt = scaler.to_sim(scene.dt, "time")
    x0, v0 = scaler.to_sim(scene.positions, "length"), scaler.to_sim(scene.velocities, "velocity")

    def run(n_steps: int) -> np.ndarray:
        for step in range(n_steps):
            if step % LONGEST_STRETCH == 0:
                solver.upload_state(x0, v0)
            solver.step(step * dt, dt, {})
        return scaler.from_sim(solver.x, "length")

    return run


if __name__ == "__main__":
    serve(prepare)
