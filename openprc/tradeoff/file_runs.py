"""Running a setting into a file: what storage costs, and what other simulators give."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import UnsupportedScene
from openprc.hooks.importing import provenance_of
from openprc.hooks.options import check_options
from openprc.hooks.registry import Registry, default_registry
from openprc.hooks.running import simulate
from openprc.schema.trajectory import Trajectory
from openprc.tradeoff.outcome import Outcome

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def run_to_file(
    experiment: Experiment,
    target: Path,
    *,
    producer: str = "demlat",
    registry: Registry | None = None,
) -> float:
    """Let a producer run an experiment into `target`, and return the CPU time [s].

    Raises
    ------
    OpenPRCError
        As `openprc.hooks.running.run_experiment`.
    """
    registry = registry or default_registry()
    item = registry.producer(producer)
    values = check_options(item.spec, item.spec.run_options, {})
    runner = registry.load(item, capability="run")
    start = time.process_time()
    simulate(
        experiment,
        runner,
        target=target,
        provenance=provenance_of(item, config=experiment.settings()),
        owner=item.qualified_name,
        options=values,
        overwrite=True,
        registry=registry,
    )
    return time.process_time() - start


def read_outcome(
    path: Path, experiment: Experiment, *, stride: int, seconds: float, producer: str
) -> Outcome:
    """Return the frames of a file that belong to an experiment.

    Raises
    ------
    UnsupportedScene
        When the file has other nodes, or other instants.
    """
    with Trajectory(path) as trajectory:
        times = experiment.frame_times
        same = trajectory.n_frames == len(times) and np.allclose(
            trajectory.time, times, rtol=1e-9, atol=1e-6 * experiment.save_interval
        )
        if not same or trajectory.n_nodes != experiment.geometry.n_nodes:
            raise UnsupportedScene(
                f"{producer} gives {trajectory.n_frames} frames of {trajectory.n_nodes} nodes",
                expected=f"{len(times)} of {experiment.geometry.n_nodes}, at the times of the"
                " scene",
                fix="compare its files with `openprc compare`, which matches nodes and times",
            )
        frames = np.asarray(trajectory.positions(), dtype=np.float64)[::stride]
    space = np.zeros((*frames.shape[:2], 3))
    space[..., : frames.shape[2]] = frames
    return Outcome(space, seconds, None)
