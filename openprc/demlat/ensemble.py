"""Many designs or inputs of one topology at once: scenes in vector lanes and over threads.

Eight scenes in float64, or sixteen in float32, share every instruction; threads take blocks of
that many. What a scene gives does not depend on which lane, block or thread it was in.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from openprc.demlat.compiled.scene_packing import WIDTH
from openprc.demlat.integrators import Settings, find_integrator
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning.step_choice import refuse_open_step
from openprc.errors import ConfigError, Diverged, UnsupportedScene
from openprc.schema.experiment_checks import check_experiment

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.schema.experiment import Experiment, Precision

Progress = Callable[[float, str], None]


class SceneBuffer(NamedTuple):
    """Saved frames of the scenes of a block: (S, T, N, dims) each [m], [m/s]."""

    x: NDArray[np.float64]
    v: NDArray[np.float64]


@dataclass(frozen=True)
class EnsembleResult:
    """Trajectories of an ensemble.

    Attributes
    ----------
    time : (T,) [s]
    positions, velocities : (S, T, N, D) [m], [m/s]
    diverged : (S,) [s]
        When a scene left the range of plausible positions; NaN where it did not. Its frames
        from then on are NaN.
    """

    time: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    diverged: NDArray[np.float64]


def run_ensemble(
    experiments: Sequence[Experiment],
    *,
    precision: Precision | None = None,
    threads: int | None = None,
    on_divergence: str = "raise",
    progress: Progress | None = None,
) -> EnsembleResult:
    """Simulate experiments that differ in numbers only.

    Parameters
    ----------
    experiments : sequence of S Experiment
        With the same elements between the same nodes, the same laws, times and integrator.
        Positions, masses, stiffnesses, dampings, rest values, fixed nodes, signals and
        actuators may differ.
    precision : {"float64", "float32"}, optional
        As the experiments say unless given. float32 takes half the time and keeps some six
        digits of the displacements.
    threads : int, optional
        All processors unless given.
    on_divergence : {"raise", "mark"}
        "mark" keeps the other scenes.
    progress : callable, optional
        Called as ``progress(fraction, message)``.

    Raises
    ------
    ConfigError
        When an experiment is wrong, or not of the first one's topology.
    UnsupportedScene
        When the engine cannot model one, or not in an ensemble.
    Diverged
        When a scene blows up, unless ``on_divergence="mark"``.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from openprc.demlat import run_ensemble
    >>> from openprc.schema import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> def oscillator(stiffness):
    ...     bars = Bars(indices=[[0, 1]], stiffness=[stiffness], rest_length=[1.0])
    ...     ends = [[0, 0, 0], [1.1, 0, 0]]
    ...     body = Geometry(positions=ends, masses=[1, 1], fixed=[1, 0], bars=bars)
    ...     return Experiment(geometry=body, duration=1.0, dt=0.01, save_interval=0.1)
    >>> result = run_ensemble([oscillator(k) for k in (1.0, 4.0, 9.0)])
    >>> result.positions.shape
    (3, 11, 2, 3)
    """
    if not experiments:
        raise ConfigError("no experiments", expected="at least one", key="experiments")
    if on_divergence not in ("raise", "mark"):
        raise ConfigError(repr(on_divergence), expected="'raise' or 'mark'", key="on_divergence")
    if threads is not None and threads < 1:
        raise ConfigError(f"{threads} threads", expected="at least one", key="threads")
    if precision is not None:
        experiments = [replace(experiment, precision=precision) for experiment in experiments]
    _check(experiments)
    first = experiments[0]
    width = WIDTH[first.precision]
    n_scenes, n_nodes = len(experiments), first.geometry.n_nodes
    dims = 2 if all(experiment.planar for experiment in experiments) else 3
    shape = (n_scenes, first.n_frames, n_nodes, dims)
    out = SceneBuffer(np.empty(shape), np.empty(shape))
    starts = range(0, n_scenes, width)
    workers = min(threads or _processors(), len(starts))
    done = 0
    with ThreadPoolExecutor(workers) as pool:
        runs = pool.map(lambda start: _run_block(experiments, start, width, dims, out), starts)
        for _ in runs:
            done = min(done + width, n_scenes)
            if progress is not None:
                progress(done / n_scenes, f"{done} of {n_scenes} scenes")
    result = EnsembleResult(
        first.frame_times, out.x, out.v, _mark_diverged(experiments, out, first.frame_times)
    )
    bad = np.flatnonzero(np.isfinite(result.diverged))
    if len(bad) and on_divergence == "raise":
        raise Diverged(
            f"{len(bad)} of {n_scenes} scenes left the range of plausible positions, the first"
            f" being scene {bad[0]} by t = {result.diverged[bad[0]]:.6g} s",
            expected="bounded motion",
            fix="use a smaller dt, or on_divergence='mark' to keep the others",
            key="simulation.dt",
        )
    return result


def _check(experiments: Sequence[Experiment]) -> None:
    first = experiments[0]
    for number, experiment in enumerate(experiments):
        check_experiment(experiment)
        refuse_open_step(experiment, where="an ensemble")
        found = supports(experiment)
        if experiment.collision.enabled and experiment.geometry.collidable.any():
            raise UnsupportedScene(
                f"scene {number} has contact",
                expected="an ensemble without contact, which differs from scene to scene",
                fix="run such scenes one by one",
            )
        if found:
            raise UnsupportedScene(
                f"scene {number}: {found[0].found}", expected=found[0].expected, fix=found[0].fix
            )
        difference = _difference(first, experiment)
        if difference:
            raise ConfigError(
                f"scene {number} has {difference} than scene 0",
                expected="scenes that differ in numbers only",
                fix="run one ensemble for each topology",
                key=f"experiments[{number}]",
            )
    scheme = find_integrator(first.integrator)
    if (
        scheme.step != "fixed"
        or first.geometry.bars.rigid.any()
        or first.geometry.hinges.rigid.any()
    ):
        raise UnsupportedScene(
            f"the integrator {scheme.name!r}" if scheme.step != "fixed" else "rigid elements",
            expected="a fixed step and soft elements, which all scenes can share",
            fix="use rk4 or verlet, or run the scenes one by one",
        )


def _difference(first: Experiment, other: Experiment) -> str:
    """Say what keeps two experiments from sharing one loop; empty when nothing does."""
    for name in ("duration", "dt", "save_interval", "integrator", "precision", "bar_damping"):
        if getattr(first, name) != getattr(other, name):
            return f"another {name}"
    one, two = first.geometry, other.geometry
    if one.n_nodes != two.n_nodes:
        return "another number of nodes"
    for kind in ("bars", "hinges", "bends"):
        left, right = getattr(one, kind), getattr(two, kind)
        for column in ("indices",) if kind == "bends" else ("indices", "law", "rigid"):
            if not np.array_equal(getattr(left, column), getattr(right, column)):
                return f"other {kind} ({column})"
    return ""


def _run_block(
    experiments: Sequence[Experiment], start: int, width: int, dims: int, out: SceneBuffer
) -> None:
    """Step the scenes from number `start` on, as many as there are lanes."""
    from openprc.demlat.integrators.stepping import FixedControl, advance_scenes  # noqa: PLC0415
    from openprc.demlat.models.barhinge.assembly import assemble  # noqa: PLC0415

    stop = min(start + width, len(experiments))
    # Lanes that are left over repeat the last scene.
    chosen = [experiments[min(start + lane, len(experiments) - 1)] for lane in range(width)]
    first = chosen[0]
    assembly = assemble(chosen, dims=dims, ledger=False)
    unit = assembly.scaler
    frame_time = first.save_interval / unit.time
    h = frame_time / first.steps_per_frame
    settings = Settings(h=h, frame_time=frame_time, ledger=False)
    scheme = find_integrator(first.integrator).load().for_body(assembly.body, settings)
    control = FixedControl(frame_time, first.steps_per_frame, h, 0.0)
    rows = max(1, min(first.n_frames, (8 << 20) // (16 * width * first.geometry.n_nodes * dims)))
    shape = (width, rows, first.geometry.n_nodes, dims)
    buffer = SceneBuffer(np.empty(shape), np.empty(shape))
    begin = 0
    while begin < first.n_frames:
        count = min(rows, first.n_frames - begin)
        advance_scenes(
            scheme,
            assembly.body,
            assembly.state,
            control,
            begin - 1,
            count,
            (unit.length, unit.velocity),
            buffer,
        )
        _collect(assembly, buffer, out, (start, stop), (begin, begin + count))
        begin += count


def _collect(
    assembly: Assembly,
    buffer: SceneBuffer,
    out: SceneBuffer,
    scenes: tuple[int, int],
    frames: tuple[int, int],
) -> None:
    start, stop = scenes
    begin, end = frames
    dims = buffer.x.shape[3]
    out.x[start:stop, begin:end] = buffer.x[: stop - start, : end - begin]
    out.v[start:stop, begin:end] = buffer.v[: stop - start, : end - begin]
    if assembly.reference.any():
        out.x[start:stop, begin:end] += assembly.reference[: stop - start, None, :, :dims]


def _mark_diverged(
    experiments: Sequence[Experiment], out: SceneBuffer, time: NDArray[np.float64]
) -> NDArray[np.float64]:
    from openprc.demlat.models.barhinge.support import ESCAPE_FACTOR, scene_size  # noqa: PLC0415

    diverged = np.full(len(experiments), np.nan)
    for scene, experiment in enumerate(experiments):
        limit = ESCAPE_FACTOR * scene_size(experiment)
        with np.errstate(invalid="ignore"):
            sound = (np.abs(out.x[scene]) < limit).all(axis=(1, 2))
        if not sound.all():
            frame = int(np.argmin(sound))
            diverged[scene] = time[frame]
            out.x[scene, frame:] = np.nan
            out.v[scene, frame:] = np.nan
    return diverged


def _processors() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
