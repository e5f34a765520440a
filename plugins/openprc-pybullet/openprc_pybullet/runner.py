"""Experiments run by PyBullet: it integrates point masses, and OpenPRC gives the forces."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import Diverged
from openprc.hooks.protocols import Modelled
from openprc_pybullet.client import direct_client
from openprc_pybullet.runner_scope import as_leapfrog, refusals, scene_remarks

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.tables import FrameBuffer
    from openprc.demlat.producer import FrameRecorder
    from openprc.hooks.protocols import Progress
    from openprc.schema import Experiment, Finding, TrajectoryWriter
    from openprc_pybullet.half_kick import HalfKickLoop

#: Frames are handed on after this time [s], or when this much has gathered.
FLUSH_S, FLUSH_BYTES = 0.5, 4 << 20
#: Steps between two looks at whether the body is still in sight.
GUARD_STEPS = 100


class Runner:
    """Runs experiments in PyBullet; offers `openprc.hooks.protocols.Runner`."""

    def supports(self, experiment: Experiment) -> Sequence[Finding]:
        """Return what cannot be modelled in `experiment`; empty means all of it."""
        return list(refusals(experiment))

    def models(self, experiment: Experiment) -> Modelled:
        """Return nothing: its point masses feel OpenPRC's forces, all of them and no others."""
        del experiment
        return Modelled()

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None,
        progress: Progress,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Simulate `experiment` and append every frame, t = 0 first.

        `seed` changes nothing: no random numbers are drawn.

        Raises
        ------
        MissingDependency
            When PyBullet is not installed.
        Diverged
            When the integration blows up; the frames before that are appended.
        """
        del seed
        half_kick = (options or {}).get("start", "half-kick") == "half-kick"
        # Compiled code is loaded when something runs.
        from openprc.demlat.forces import ForceField  # noqa: PLC0415
        from openprc.demlat.producer import FrameRecorder  # noqa: PLC0415
        from openprc_pybullet.half_kick import HalfKickLoop  # noqa: PLC0415

        with direct_client("running an experiment") as (pybullet, client):
            for remark in _remarks(experiment, half_kick=half_kick):
                writer.note(remark)
            recorder = FrameRecorder(experiment, writer)
            recorder.declare()
            field = ForceField(experiment)
            loop = HalfKickLoop(
                pybullet, client, experiment=experiment, field=field, half_kick=half_kick
            )
            _Frames(experiment, loop, recorder).run(progress)


class _Frames:
    """Takes the steps between frames, and hands frames on in blocks."""

    def __init__(self, experiment: Experiment, loop: HalfKickLoop, recorder: FrameRecorder) -> None:
        from openprc.demlat.models.barhinge.run_watch import RunWatch  # noqa: PLC0415
        from openprc.demlat.models.barhinge.support import (  # noqa: PLC0415
            ESCAPE_FACTOR,
            scene_size,
        )

        self.experiment = experiment
        self.loop = loop
        self.recorder = recorder
        self.reach = ESCAPE_FACTOR * scene_size(experiment)
        # Without the half kick stored velocities lag half a step behind the positions.
        self.watch = RunWatch(as_leapfrog(experiment), scheme="PyBullet", balanced=loop.half_kick)
        frame_bytes = sum(column.nbytes for column in loop.field.frames(1))
        rows = max(1, min(experiment.n_frames, FLUSH_BYTES // frame_bytes))
        self.buffer: FrameBuffer = loop.field.frames(rows)
        self.first = self.waiting = 0

    def run(self, progress: Progress) -> None:
        """Step through all frames."""
        experiment = self.experiment
        progress(0.0, "t = 0 s")
        flushed = time.monotonic()
        try:
            self._save()
            for frame in range(1, experiment.n_frames):
                self._next_frame()
                self._save()
                if self.waiting == len(self.buffer.x) or time.monotonic() - flushed > FLUSH_S:
                    self._flush()
                    flushed = time.monotonic()
                    now = f"t = {self.loop.time:g} s of {experiment.duration:g} s"
                    progress((frame + 1) / experiment.n_frames, now)
        finally:
            # What has been computed is kept, also of a run that was stopped.
            self._flush()
        self.watch.close()
        for remark in self.watch.remarks():
            self.recorder.writer.note(remark)
        progress(1.0, f"t = {experiment.duration:g} s of {experiment.duration:g} s")

    def _next_frame(self) -> None:
        left = self.experiment.steps_per_frame
        while left:
            count = min(left, GUARD_STEPS)
            self.loop.advance(count)
            left -= count
            self._guard()

    def _save(self) -> None:
        loop, row = self.loop, self.waiting
        loop.field.observe(loop.positions, loop.velocities, buffer=self.buffer, row=row)
        self.buffer.ledger[row] = loop.balance
        self.waiting += 1

    def _flush(self) -> None:
        if not self.waiting:
            return
        count, self.waiting = self.waiting, 0
        first, self.first = self.first, self.first + count
        block = type(self.buffer)(*(part[:count] for part in self.buffer))
        sound = self.watch.sound(first, block)
        if sound:
            self.recorder.append(first, type(block)(*(part[:sound] for part in block)))
        if sound < count:
            rest = type(block)(*(part[sound:] for part in block))
            raise self.watch.not_finite(first + sound, rest)

    def _guard(self) -> None:
        sound = np.abs(self.loop.positions) < self.reach  # False for NaN
        if sound.all():
            return
        from openprc.demlat.models.barhinge.divergence import strained_most  # noqa: PLC0415
        from openprc.demlat.planning.stability import step_limit  # noqa: PLC0415

        node, axis = (int(number) for number in np.argwhere(~sound)[0])
        limit = step_limit(as_leapfrog(self.experiment))
        strained = strained_most(self.experiment, self.loop.positions, node)
        raise Diverged(
            f"node {node} left the range of plausible positions along {'xyz'[axis]}"
            f" by t = {self.loop.time:.6g} s{strained}",
            expected=f"coordinates below {self.reach:.3g} m",
            fix=f"use a smaller dt than {self.experiment.dt:g} s (the stability limit at the start"
            f" is {limit.limit:.3g} s, set by {limit.setter}); frames up to then are in the partial"
            " file",
            key="simulation.dt",
        )


def _remarks(experiment: Experiment, *, half_kick: bool) -> list[str]:
    step = experiment.save_interval / experiment.steps_per_frame
    start = (
        "leapfrog, of second order: velocities were put half a step back at the start, and the"
        " stored ones are those at the time of the frame; forces that depend on velocity were"
        " given the velocity predicted for the instant, which keeps the order"
        if half_kick
        else "semi-implicit Euler, of first order: velocities are Bullet's, which lag half a step"
        " behind the positions in the leapfrog reading, and forces that depend on velocity were"
        " given those"
    )
    return [
        f"PyBullet {version('pybullet')} integrated {experiment.geometry.n_nodes} point masses in"
        f" steps of {step:g} s; all forces (bars, hinges, bends, weight, drag, actuators) are"
        " OpenPRC's, applied at every step; gravity, damping, sleeping and limits on velocity of"
        " PyBullet were off",
        start,
        *scene_remarks(experiment),
    ]
