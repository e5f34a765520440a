"""Experiments run by PyElastica: chains of bars and bends as Cosserat rods."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import Diverged, MissingDependency, UnsupportedScene
from openprc.hooks.running import refuse_unsupported
from openprc_pyelastica.divergence import MAX_STRETCH
from openprc_pyelastica.rod_material import checked_options
from openprc_pyelastica.runner_scope import findings, shortest_limit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.hooks.protocols import Progress
    from openprc.schema import Experiment, TrajectoryWriter
    from openprc_pyelastica.rod_frames import RodFrames
    from openprc_pyelastica.rod_scene import RodScene
    from openprc_pyelastica.rod_step_limit import StepLimit

#: Frames are handed on after this time [s], or when this much has gathered.
FLUSH_S, FLUSH_BYTES = 0.5, 4 << 20
#: Share of the stability limit that ``substeps=auto`` stays below: deformation lowers it.
SAFE_SHARE = 0.8


def run(
    experiment: Experiment,
    writer: TrajectoryWriter,
    *,
    progress: Progress,
    options: Mapping[str, Any],
) -> None:
    """Simulate `experiment` and append every frame, t = 0 first.

    Raises
    ------
    UnsupportedScene
        When a rod cannot model something, or the time step is too long.
    MissingDependency
        When PyElastica is not installed.
    Diverged
        When the integration blows up; the frames before that are appended.
    """
    refuse_unsupported(list(findings(experiment)), producer="pyelastica")
    chosen = checked_options(options)
    limit = shortest_limit(experiment, options=chosen)
    substeps = _substeps(experiment, limit, chosen["substeps"])
    try:
        from openprc_pyelastica.rod_scene import RodScene  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingDependency(
            f"{error.name} is not installed",
            expected="PyElastica, for running an experiment",
            fix="pip install 'pyelastica>=0.3.3,<2'",
        ) from error
    from openprc_pyelastica.rod_frames import RodFrames  # noqa: PLC0415

    dt = experiment.save_interval / (experiment.steps_per_frame * substeps)
    scene = RodScene(experiment, options=chosen, dt=dt)
    thinning = chosen["section"] == "thinning"
    frames = RodFrames(experiment, writer, thinning=thinning)
    for remark in _remarks(experiment, scene, limit):
        writer.note(remark)
    frames.declare()
    loop = _Loop(experiment, scene, frames, limit)
    loop.run(progress, steps=experiment.steps_per_frame * substeps)
    law = (
        "the section of a rod thins as it is drawn out: at the strain e its tension is "
        "EA e / (1 + e), not EA e (section=constant makes up for it)"
        if thinning
        else "springs beside the elements make up for the section that thins in PyElastica, so "
        "that the tension is EA e at the strain e"
    )
    law += ", and its couples are 1 / (1 + e)^3 of those without strain"
    writer.note(f"{law}; the largest strain of a frame is {frames.largest_strain:.3g}")


def _substeps(experiment: Experiment, limit: StepLimit, wanted: int | str) -> int:
    if wanted == "auto":
        return max(1, math.ceil(experiment.dt / (SAFE_SHARE * limit.step)))
    step = experiment.dt / int(wanted)
    if step > limit.step and experiment.step_check == "refuse":
        raise UnsupportedScene(
            f"pyelastica cannot model it: steps of {step:g} s would blow up; {limit.setter} set"
            " the stability limit",
            expected=f"at most {limit.step:.4g} s",
            fix=f"take a dt of {SAFE_SHARE * limit.step:.3g} s or less, say substeps=auto, or set"
            " simulation.step_check to 'warn'",
            file=None if experiment.path is None else str(experiment.path),
            key="simulation.dt",
        )
    return int(wanted)


class _Loop:
    """Takes the steps between frames, and hands frames on in blocks."""

    def __init__(
        self, experiment: Experiment, scene: RodScene, frames: RodFrames, limit: StepLimit
    ) -> None:
        self.experiment, self.scene, self.frames, self.limit = experiment, scene, frames, limit
        shape = (experiment.geometry.n_nodes, 3)
        room = max(1, min(experiment.n_frames, FLUSH_BYTES // (48 * shape[0])))
        self.positions: NDArray[np.float64] = np.empty((room, *shape))
        self.velocities: NDArray[np.float64] = np.empty((room, *shape))
        self.first = self.waiting = 0

    def run(self, progress: Progress, *, steps: int) -> None:
        """Take `steps` steps from each frame to the next."""
        experiment = self.experiment
        progress(0.0, "t = 0 s")
        flushed = time.monotonic()
        try:
            self._save()
            for frame in range(1, experiment.n_frames):
                # Numbers that overflow are noticed below, in words.
                with np.errstate(all="ignore"):
                    self.scene.advance(steps)
                self._save()
                if self.waiting == len(self.positions) or time.monotonic() - flushed > FLUSH_S:
                    self._flush()
                    flushed = time.monotonic()
                    now = f"t = {frame * experiment.save_interval:g} s of {experiment.duration:g} s"
                    progress((frame + 1) / experiment.n_frames, now)
        finally:
            # What has been computed is kept, also of a run that was stopped.
            self._flush()
        progress(1.0, f"t = {experiment.duration:g} s of {experiment.duration:g} s")

    def _save(self) -> None:
        row = self.waiting
        self.scene.state(self.positions[row], self.velocities[row])
        self._check(self.positions[row], self.velocities[row])
        self.waiting = row + 1

    def _check(self, positions: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        bars = self.experiment.geometry.bars
        with np.errstate(all="ignore"):
            arms = positions[bars.indices[:, 1]] - positions[bars.indices[:, 0]]
            ratio = np.sqrt((arms**2).sum(axis=1)) / bars.relaxed_length
            sound = ratio.max() < MAX_STRETCH and np.isfinite(velocities).all()
        if sound:
            return
        worst = int(np.argmax(np.where(np.isfinite(ratio), ratio, np.inf)))
        at = (self.first + self.waiting) * self.experiment.save_interval
        raise Diverged(
            f"bar {worst} is {ratio[worst]:.3g} times its rest length at t = {at:.6g} s",
            expected=f"bars no longer than {MAX_STRETCH:g} times that, and finite velocities",
            fix=f"take shorter steps than {self.scene.dt:g} s (the stability limit at the start is"
            f" {self.limit.step:.3g} s, set by {self.limit.setter}); frames up to then are in the"
            " partial file",
            key="simulation.dt",
        )

    def _flush(self) -> None:
        if not self.waiting:
            return
        count, self.waiting = self.waiting, 0
        first, self.first = self.first, self.first + count
        self.frames.append(first, self.positions[:count], self.velocities[:count])


def _remarks(experiment: Experiment, scene: RodScene, limit: StepLimit) -> list[str]:
    counts = ", ".join(str(part.chain.n_elements) for part in scene.parts)
    notes = [
        f"PyElastica {version('pyelastica')} integrated {len(scene.parts)} rod(s) of {counts}"
        f" elements by position Verlet in steps of {scene.dt:g} s; the stability limit at the start"
        f" is {limit.step:.3g} s, set by {limit.setter}",
        "a bar of stiffness k is an element of EA = k l,"
        " a bend of stiffness k a vertex of EI = k l",
    ]
    if any(actuator.type == "force" for actuator in experiment.actuators):
        notes.append("forces of signals act as they are in the middle of a step")
    for number, part in enumerate(scene.parts):
        material = part.material
        name = f"rod {number}" if len(scene.parts) > 1 else "the rod"
        share = material.shear_share
        shear = (
            "nothing resists its bending, and the shear stiffness ties elements to the line of"
            " their nodes"
            if math.isinf(share)
            else f"a cantilever of it loaded at its end would sink by {share:.3g} of its bending"
            " deflection more than bars, through shear"
        )
        notes.append(
            f"{name} has the radius {material.radius:.4g} m: its elements have rotary inertia,"
            f" and {shear}"
        )
        carried = part.chain.nodes[part.held.carried]
        if len(carried):
            notes.append(
                f"node(s) {', '.join(map(str, carried))} are fixed in the experiment; here they"
                " are carried by the clamped element beside them and move with its shear and"
                " stretch (clamp=nodes holds them)"
            )
    return notes
