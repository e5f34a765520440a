"""This package's own loop, as the engine calls it: the only file that knows its insides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from engine_scenes import Scene, to_experiment

from openprc.demlat.integrators.rk4 import advance
from openprc.demlat.models.barhinge.model import BarHingeModel
from openprc.demlat.models.barhinge.tables import FrameBuffer, Work
from openprc.demlat.plan import make_plan
from openprc.schema import Experiment
from peers.serving import Run, serve

#: Force evaluations a step; integrators that are not named here count as unknown.
EVALUATIONS_A_STEP = {"rk4": 4, "verlet": 1, "pefrl": 4}


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes
    ----------
    positions : (T, N, 3) [m]
    evaluations : int or None
        Of the force, where it is known.
    """

    positions: np.ndarray
    evaluations: int | None


def ours(scene: Scene) -> Run:
    """Return a function that runs n steps with nothing saved but the end."""
    plan = make_plan(to_experiment(scene, duration=scene.dt, save_interval=scene.dt))
    n_nodes = len(plan.positions)
    out, work = FrameBuffer.for_frames(1, n_nodes), Work.for_nodes(n_nodes)
    tables = (plan.nodes, plan.bars, plan.hinges, plan.drives, plan.signals)

    def run(n_steps: int) -> np.ndarray:
        x, v, ledger = plan.positions.copy(), plan.velocities.copy(), np.zeros(2)
        limit = plan.escape_limit
        advance(x, v, ledger, work, *tables, 0, 1, n_steps, plan.step, limit, out)
        return x

    return run


def prepare_integration(experiment: Experiment) -> Callable[[], Outcome]:
    """Return what runs an experiment in memory, from t = 0 each time, all frames kept."""
    model = BarHingeModel(experiment)
    each = EVALUATIONS_A_STEP.get(experiment.integrator)
    steps = experiment.steps_per_frame * (experiment.n_frames - 1)

    def run() -> Outcome:
        frames = np.concatenate([out.x.copy() for _, out in model.blocks()])
        return Outcome(frames, None if each is None else each * steps)

    return run


if __name__ == "__main__":
    serve(ours)
