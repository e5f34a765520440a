"""Converged references for motions without a closed form."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.schema.experiment import Experiment, save_experiment

Reals = NDArray[np.float64]


def converged(build: Callable[[], Experiment], *, tolerance: float = 1e-12) -> Callable[[], Reals]:
    """Return a function that returns the frames of `dop853` at a tight tolerance: (T, N, 3) [m].

    It is run once, at the first call.
    """

    @cache
    def frames() -> Reals:
        experiment = replace(build(), integrator="dop853", tolerance=tolerance, precision="float64")
        experiment = replace(experiment, dt=experiment.save_interval)
        with tempfile.TemporaryDirectory() as name:
            save_experiment(experiment, name)
            with Trajectory(run_experiment(Path(name)).path) as run:
                found = np.zeros((run.n_frames, experiment.geometry.n_nodes, 3))
                positions = run.positions()
                found[..., : positions.shape[2]] = positions
        return found

    return frames
