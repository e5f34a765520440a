"""`BarHingeModel`: one experiment, stepped block by block."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from openprc.demlat.backends.choose import Choice, choose_backend
from openprc.demlat.integrators import Settings, find_integrator
from openprc.demlat.models.barhinge.divergence import strained_most, way_out
from openprc.demlat.models.barhinge.run_watch import RunWatch
from openprc.demlat.models.barhinge.support import ESCAPE_FACTOR, remarks, scene_size, supports
from openprc.demlat.models.barhinge.tables import (
    BEND_ENERGY,
    ENERGY_ROWS,
    LEDGER_STRIDE,
    FrameBuffer,
)
from openprc.demlat.planning.phase_drift import tolerance_remarks
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, Diverged

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.assembly import Assembly
    from openprc.schema.experiment import Experiment
    from openprc.schema.findings import Finding

Backend = Literal["auto", "cpu", "cuda", "jax"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

#: Saved frames are handed on when about this much has gathered ...
BLOCK_BYTES = 4 << 20
#: ... or after about this many element updates, so that progress shows and Ctrl-C works.
BLOCK_WORK = 20_000_000


class BarHingeModel:
    """Nodes with mass, bars with axial springs, hinges and bends with torsional springs.

    Parameters
    ----------
    experiment : Experiment
        One for which `supports` is empty.
    backend : {"auto", "cpu", "cuda", "jax"}
    """

    name = "barhinge"

    def __init__(self, experiment: Experiment, *, backend: Backend = "auto") -> None:
        if backend not in BACKENDS:
            raise ConfigError(
                f"the backend {backend!r}", expected="one of " + ", ".join(BACKENDS), key="backend"
            )
        self.experiment = experiment
        self.backend = backend
        self.integrator = find_integrator(experiment.integrator)
        self._scheme: Any = None
        self._watch: RunWatch | None = None

    @staticmethod
    def supports(experiment: Experiment) -> list[Finding]:
        """Return what this model cannot represent; empty means all of it."""
        return supports(experiment)

    def remarks(self) -> Iterator[str]:
        """Yield what a reader of the result should know."""
        yield from remarks(self.experiment)
        yield from self.choice.reasons

    @cached_property
    def choice(self) -> Choice:
        """The back end that runs the experiment, and why."""
        return choose_backend(self.experiment, self.backend)

    def blocks(self) -> Iterator[tuple[int, FrameBuffer]]:
        """Integrate, yielding (number of the first frame, block of frames).

        The first block is the frame t = 0. The arrays are reused: copy what should stay.

        Raises
        ------
        Diverged
            When a coordinate leaves the range of plausible numbers, some number is not finite, or
            the scheme makes most of the energy; the frames before that have been yielded.
        """
        watch = self._watch = RunWatch(self.experiment)
        for first, block in self._integrated():
            sound = watch.sound(first, block)
            if sound < len(block.x):
                if sound:
                    yield first, FrameBuffer(*(column[:sound] for column in block))
                rest = FrameBuffer(*(column[sound:] for column in block))
                raise watch.not_finite(first + sound, rest)
            yield first, block
        watch.close()

    def closing_remarks(self) -> Iterator[str]:
        """Yield what a reader of the result should know once all frames are there."""
        if self._watch is not None:
            yield from self._watch.remarks()
        if steps := self.effort.get("steps", 0):
            yield from tolerance_remarks(self.experiment, steps)

    def _integrated(self) -> Iterator[tuple[int, FrameBuffer]]:
        # Compiled code is loaded when something runs, not when an experiment is built.
        if self.choice.name == "cuda":
            from openprc.demlat.backends.cuda_run import cuda_blocks  # noqa: PLC0415

            yield from cuda_blocks(self.experiment)
            return
        if self.choice.name == "jax":
            from openprc.demlat.backends.jax_run import jax_blocks  # noqa: PLC0415

            yield from jax_blocks(self.experiment)
            return
        if self.integrator.step == "legacy":
            yield from self.integrator.load()(self.experiment)
            return
        from openprc.demlat.contact.hook import OVERFULL  # noqa: PLC0415
        from openprc.demlat.contact.table import Rewind  # noqa: PLC0415
        from openprc.demlat.integrators.stepping import FAILED, advance  # noqa: PLC0415
        from openprc.demlat.models.barhinge.assembly import assemble  # noqa: PLC0415

        experiment = self.experiment
        assembly = assemble([experiment])
        settings = self._settings(assembly)
        scheme = self._scheme = self.integrator.load().for_body(assembly.body, settings)
        control = make_control(self.integrator.step, settings, experiment.steps_per_frame)
        body, state, scale = assembly.body, assembly.state, assembly.scaler.output
        energy = np.zeros(ENERGY_ROWS * LEDGER_STRIDE, body.mass.dtype)
        out = self._buffer(assembly)
        advance(scheme, body, state, energy, control, -1, 1, scale, out)
        yield 0, self._finished(assembly, out, 1)
        frame = 0
        while frame < experiment.n_frames - 1:
            count = min(len(out.x), experiment.n_frames - 1 - frame)
            rewind = Rewind(body, state, scheme)
            done, escaped, time = advance(
                scheme, body, state, energy, control, frame, count, scale, out
            )
            if escaped == OVERFULL:
                body = rewind.repeat(body)
                continue
            if done:
                yield frame + 1, self._finished(assembly, out, done)
            if escaped == FAILED:
                raise scheme.explain(experiment, assembly, time * assembly.scaler.time)
            if escaped >= 0:
                raise self._diverged(assembly, escaped, time * assembly.scaler.time)
            frame += done

    @property
    def effort(self) -> dict[str, int]:
        """Steps and evaluations so far, of an integrator that chooses its steps; else empty."""
        return getattr(self._scheme, "effort", {})

    def _settings(self, assembly: Assembly) -> Settings:
        experiment, unit = self.experiment, assembly.scaler
        frame_time = experiment.save_interval / unit.time
        return Settings(
            h=frame_time / experiment.steps_per_frame,
            frame_time=frame_time,
            tolerance=experiment.tolerance or Settings._field_defaults["tolerance"],
            constraint_tolerance=experiment.constraint_tolerance
            or Settings._field_defaults["constraint_tolerance"],
            limit=ESCAPE_FACTOR * scene_size(experiment) / unit.length,
        )

    def _buffer(self, assembly: Assembly) -> FrameBuffer:
        experiment, geometry = self.experiment, self.experiment.geometry
        angles = len(geometry.hinges) + len(geometry.bends)
        elements = len(geometry.bars) + 4 * angles + geometry.n_nodes
        frame_bytes = 48 * geometry.n_nodes + 16 * (len(geometry.bars) + angles)
        frame_work = self.integrator.stages * experiment.steps_per_frame * elements
        most = min(BLOCK_BYTES // frame_bytes, BLOCK_WORK // frame_work)
        return FrameBuffer.for_frames(
            max(1, min(experiment.n_frames, most)),
            n_nodes=geometry.n_nodes,
            dims=assembly.packing.dims,
            n_bars=len(geometry.bars),
            n_hinges=len(geometry.hinges),
            n_bends=len(geometry.bends),
        )

    def _finished(self, assembly: Assembly, out: FrameBuffer, count: int) -> FrameBuffer:
        block = FrameBuffer(*(column[:count] for column in out))
        if assembly.reference.any():
            block.x[...] += assembly.reference[0, :, : assembly.packing.dims]
            block.energy[:, 3] -= assembly.reference_work
        for kind, energy in zip((1, 2, BEND_ENERGY), assembly.idle_energy, strict=True):
            if energy:
                block.energy[:, kind] += energy
        return block

    def _diverged(self, assembly: Assembly, coordinate: int, time: float) -> Diverged:
        experiment = self.experiment
        axis, node = divmod(coordinate, assembly.packing.stride)
        limit = step_limit(experiment)
        bound = ESCAPE_FACTOR * scene_size(experiment)
        positions = assembly.packing.nodes(assembly.state.x)[0] * assembly.scaler.length
        positions = positions + assembly.reference[0, :, : assembly.packing.dims]
        return Diverged(
            f"node {node} left the range of plausible positions along {'xyz'[axis]}"
            f" by t = {time:.6g} s{strained_most(experiment, positions, node)}",
            expected=f"coordinates below {bound:.3g} m",
            fix=f"{way_out(limit, experiment.dt)}; frames up to then are in the partial file",
            key="simulation.dt",
        )


def make_control(kind: str, settings: Settings, steps_per_frame: int) -> Any:
    """Return what tells the compiled loop how to get from frame to frame."""
    if kind == "adaptive":
        from openprc.demlat.integrators.adaptive import AdaptiveControl  # noqa: PLC0415  compiles

        return AdaptiveControl(settings.frame_time, settings.h, settings.limit)
    from openprc.demlat.integrators.stepping import FixedControl  # noqa: PLC0415  compiles

    return FixedControl(settings.frame_time, steps_per_frame, settings.h, settings.limit)
