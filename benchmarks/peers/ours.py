"""This package's own loop, as the engine calls it: the only file here that knows its insides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from engine_scenes import Scene, to_experiment

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.integrators.stepping import FixedControl, advance
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, FrameBuffer
from openprc.demlat.planning.run_cost import run_cost
from openprc.demlat.planning.stability import step_limit
from openprc.schema import Experiment
from peers.serving import Run, serve


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
    experiment = to_experiment(scene, duration=scene.dt, save_interval=scene.dt)
    assembly = assemble([experiment])
    body, packing, unit = assembly.body, assembly.packing, assembly.scaler
    settings = Settings(h=scene.dt / unit.time, frame_time=scene.dt / unit.time)
    scheme = INTEGRATORS["rk4"].load().for_body(body, settings)
    geometry = experiment.geometry
    out = FrameBuffer.for_frames(
        1,
        n_nodes=geometry.n_nodes,
        dims=packing.dims,
        n_bars=len(geometry.bars),
        n_hinges=len(geometry.hinges),
    )
    start = [np.array(column) for column in assembly.state]
    energy = np.zeros(4 * LEDGER_STRIDE)

    def run(n_steps: int) -> np.ndarray:
        for column, first in zip(assembly.state, start, strict=True):
            column[...] = first
        control = FixedControl(settings.frame_time, n_steps, settings.h, np.inf)
        advance(scheme, body, assembly.state, energy, control, 0, 1, unit.output, out)
        return np.array(out.x[0])

    return run


def prepare_integration(experiment: Experiment) -> Callable[[], Callable[[], Outcome]]:
    """Return what begins a run in memory, up to its first frame; that returns the rest of it."""
    model = BarHingeModel(experiment)
    counted = run_cost(experiment, step_limit(experiment)).evaluations

    def begin() -> Callable[[], Outcome]:
        blocks = model.blocks()
        first = next(blocks)[1].x.copy()

        def run() -> Outcome:
            frames = np.concatenate([first, *(out.x.copy() for _, out in blocks)])
            evaluations = model.effort.get("evaluations", counted)
            if experiment.integrator == "midpoint":
                evaluations = None  # as many as its iterations take
            return Outcome(frames, evaluations)

        return run

    return begin


def refusal(experiment: Experiment) -> str:
    """Return why the engine does not run an experiment; empty when it does."""
    return "; ".join(finding.found for finding in supports(experiment))


if __name__ == "__main__":
    serve(ours)
