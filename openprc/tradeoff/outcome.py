"""Running a setting in memory: frames, CPU time, evaluations; and what the frames are wrong by."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.backends import devices
from openprc.demlat.integrators import find_integrator
from openprc.demlat.models.barhinge.model import BarHingeModel
from openprc.demlat.planning.run_cost import run_cost
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, MissingDependency
from openprc.hooks.running import refuse_unsupported

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

Backend = Literal["cpu", "cuda", "jax"]


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes
    ----------
    positions : (T, N, 3) [m]
        Every stride-th frame, t = 0 first.
    seconds : float [s]
        CPU time of the process, setting up and compiling left out.
    evaluations : int or None
        Of all forces; None where nobody counts them.
    """

    positions: Reals
    seconds: float
    evaluations: int | None


def run_in_memory(experiment: Experiment, *, backend: Backend = "cpu", stride: int = 1) -> Outcome:
    """Run an experiment with the engine and keep every `stride`-th frame.

    Raises
    ------
    UnsupportedScene
        When the engine refuses it.
    MissingDependency
        When the back end is not there: what would run in its place is another setting.
    Diverged
        When the motion blows up.
    """
    refuse_unsupported(BarHingeModel.supports(experiment), producer="demlat")
    _refuse_absent(backend)
    frames, seconds, effort = _timed(experiment, backend, stride)
    steps = experiment.n_frames - 1
    if backend != "cpu" and steps > 1:
        # These compile in every run, with its first step to a frame: what that took is left out.
        first = replace(experiment, duration=experiment.save_interval)
        seconds = max(seconds - _timed(first, backend, 1)[1], 1e-6) * steps / (steps - 1)
    return Outcome(frames, seconds, _evaluations(experiment, effort))


def _refuse_absent(backend: Backend) -> None:
    if backend == "cpu":
        return
    probe = devices.probe_cuda() if backend == "cuda" else devices.probe_jax(only_accelerated=False)
    if not probe.usable:
        raise MissingDependency(
            probe.found,
            expected=probe.missing or f"a machine on which the back end {backend!r} runs",
            fix=f"leave {backend} out, or install what is missing",
            key="backend",
        )


def _timed(
    experiment: Experiment, backend: Backend, stride: int
) -> tuple[Reals, float, dict[str, int]]:
    """Return frames, the time that the steps took [s], and the effort of the scheme."""
    model = BarHingeModel(experiment, backend=backend)
    blocks = model.blocks()
    kept = [_thinned(*next(blocks), stride)]
    # Work on a device is not seen by the clock of this process.
    clock = time.perf_counter if backend == "cuda" else time.process_time
    start = clock()
    kept += [_thinned(first, block, stride) for first, block in blocks]
    return np.concatenate(kept), clock() - start, model.effort


def _thinned(first: int, block: Any, stride: int) -> Reals:
    frames = block.x[-first % stride :: stride]
    space = np.zeros((*frames.shape[:2], 3))
    space[..., : frames.shape[2]] = frames
    return space


def _evaluations(experiment: Experiment, effort: dict[str, int]) -> int | None:
    if "evaluations" in effort:
        return effort["evaluations"]
    scheme = find_integrator(experiment.integrator)
    if scheme.name == "midpoint":
        return None  # as many as its iterations take
    return run_cost(experiment, step_limit(experiment)).evaluations


def bare(experiment: Experiment) -> Experiment:
    """Return the experiment as the engine takes it word for word: nothing is chosen for it."""
    # An accuracy that is asked for would replace the setting that is to be measured.
    given = {"accuracy": None} if "accuracy" in {f.name for f in fields(experiment)} else {}
    return replace(experiment, path=None, sources=(), **given)


# --- errors -----------------------------------------------------------------------------------


def displacement_scale(reference: Reals) -> float:
    """Return the rms over frames and nodes of the distance from the first frame [m].

    Raises
    ------
    ConfigError
        When nothing moves, so that no error can be put in proportion.
    """
    moved = 0.0
    for block in _blocks(len(reference)):
        moved += float(np.sum((reference[block] - reference[0]) ** 2))
    scale = float(np.sqrt(moved / reference[..., 0].size))
    if not scale > 0.0:
        raise ConfigError(
            "nothing moves in this scene",
            expected="a body that moves: errors are measured in its displacement",
            fix="drive it, or start it away from rest",
            key="simulation.duration",
        )
    return scale


def error_over_time(positions: Reals, reference: Reals) -> Reals:
    """Return the rms over nodes of the position error, over `displacement_scale`: (T,) [1].

    Parameters
    ----------
    positions, reference : (T, N, 3) [m]
    """
    scale = displacement_scale(reference)
    wrong = [
        np.sqrt(np.mean(np.sum((positions[block] - reference[block]) ** 2, axis=2), axis=1))
        for block in _blocks(len(reference))
    ]
    profile: Reals = np.concatenate(wrong) / scale
    return profile


def relative_error(positions: Reals, reference: Reals) -> float:
    """Return the largest, over frames, of `error_over_time`.

    Examples
    --------
    >>> import numpy as np
    >>> from openprc.tradeoff.outcome import relative_error
    >>> reference = np.zeros((3, 1, 3))
    >>> reference[1:, 0, 0] = np.sqrt(1.5)
    >>> positions = reference + [[[0, 0, 0]], [[0, 0.01, 0]], [[0, 0.03, 0]]]
    >>> round(relative_error(positions, reference), 12)
    0.03
    """
    return float(error_over_time(positions, reference).max())


def _blocks(count: int) -> Iterator[slice]:
    size = 4096
    return (slice(first, first + size) for first in range(0, count, size))
