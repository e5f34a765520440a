"""This package's ensembles: a block of scenes in vector lanes for each of two threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from engine_scenes import Scene, to_experiment

from openprc.demlat.compiled.scene_packing import WIDTH
from openprc.demlat.ensemble import SceneBuffer
from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.integrators.stepping import FixedControl, advance_scenes
from openprc.demlat.models.barhinge.assembly import assemble
from peers.serving import Run, serve

THREADS = 2


def sweep(precision: Any) -> Callable[[Scene], Run]:
    """Return what prepares two blocks of copies of a scene, designs spread by 10 %."""

    def prepare(scene: Scene) -> Run:
        experiment = to_experiment(scene, duration=scene.dt, save_interval=scene.dt)
        experiment = replace(experiment, precision=precision)
        blocks = [_block(experiment, seed) for seed in range(THREADS)]
        pool = ThreadPoolExecutor(THREADS)

        def run(n_steps: int) -> np.ndarray:
            list(pool.map(lambda block: block(n_steps), blocks))
            return blocks[0](0)

        return run

    return prepare


def _block(experiment: Any, seed: int) -> Callable[[int], np.ndarray]:
    width = WIDTH[experiment.precision]
    rng = np.random.default_rng(seed)
    bars = experiment.geometry.bars
    # The first scene stays as it is, to be compared.
    factors = [1.0, *rng.uniform(0.9, 1.1, width - 1)]
    scenes = [
        replace(
            experiment,
            geometry=replace(
                experiment.geometry, bars=replace(bars, stiffness=bars.stiffness * factor)
            ),
        )
        for factor in factors
    ]
    assembly = assemble(scenes, dims=3, ledger=False)
    unit = assembly.scaler
    h = experiment.dt / unit.time
    settings = Settings(h=h, frame_time=h, ledger=False)
    scheme = INTEGRATORS["rk4"].load().for_body(assembly.body, settings)
    shape = (width, 1, experiment.geometry.n_nodes, 3)
    buffer = SceneBuffer(np.empty(shape), np.empty(shape))
    start = [np.array(column) for column in (assembly.state.x, assembly.state.v)]

    def run(n_steps: int) -> np.ndarray:
        if n_steps:
            assembly.state.x[...], assembly.state.v[...] = start
            control = FixedControl(h, n_steps, h, 0.0)
            scale = unit.length, unit.velocity
            state = assembly.state
            advance_scenes(scheme, assembly.body, state, control, 0, 1, scale, buffer)
        return buffer.x[0, 0] + assembly.reference[0]

    return run


if __name__ == "__main__":
    serve(sweep("float64"), threads=THREADS, scenes=THREADS * WIDTH["float64"])
