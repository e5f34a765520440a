"""Running a scene on a CUDA device, block of frames by block of frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import cuda

from openprc.demlat.backends import cuda_kernels as kernels
from openprc.demlat.backends.cuda_tables import DeviceScene, device_frames
from openprc.demlat.backends.frames import diverged, frame_block, head, plausible_size
from openprc.demlat.backends.held_signals import HeldSignals
from openprc.demlat.models.barhinge.assembly import assemble

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.tables import FrameBuffer
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Threads in a block of a launch over elements or nodes, and in the one block of `march`.
THREADS, MARCH_THREADS = 128, 256
#: Bodies with at most this many elements and nodes are stepped by one block without launches
#: between the stages: for them, launching takes longer than computing.
MARCH_LIMIT = 4096
#: Steps between two looks at whether coordinates are still plausible numbers.
GUARD_INTERVAL = 100
#: Shares into which sums over the body are cut.
MOST_SHARES = 1024
FULL_TURN = 2.0 * np.pi


class CudaRun:
    """One scene on the device.

    Parameters
    ----------
    experiment : Experiment
        One that `openprc.demlat.backends.choose.refusals` has nothing to say about.
    one_block : bool, optional
        Whether whole steps are taken by one block of threads; by default for small bodies.
    threads : int
        In that block.
    """

    def __init__(
        self,
        experiment: Experiment,
        *,
        one_block: bool | None = None,
        threads: int = MARCH_THREADS,
    ) -> None:
        self.experiment = experiment
        self.assembly = assemble([experiment], vectors=False)
        self.scene = DeviceScene.from_assembly(self.assembly)
        unit = self.assembly.scaler
        self.h = experiment.save_interval / unit.time / experiment.steps_per_frame
        self.held = HeldSignals(self.assembly.body.drives, self.h)
        self.jump_work = 0.0
        self.threads = threads
        size = self.scene.n_elements + self.scene.n_nodes
        self.one_block = size <= MARCH_LIMIT if one_block is None else one_block
        n_shares = min(max(size // 8, 1), MOST_SHARES)
        self.partial = cuda.to_device(np.zeros((kernels.N_SUMS, n_shares)))

    def forces(self) -> Reals:
        """Return all forces at t = 0: (N, 3) [N]."""
        scene = self.scene
        self.begin()
        force = cuda.to_device(np.zeros((3, scene.n_nodes)))
        self._launch(kernels.push_elements, scene.n_elements, scene.elements, scene.nodes, 0, 0.0)
        arguments = (scene.elements, scene.nodes, scene.drives, 0.0, self.h, force)
        self._launch(kernels.add_forces, scene.n_nodes, *arguments)
        result: Reals = self.assembly.scaler.force * force.copy_to_host().T
        return result

    def blocks(self) -> Iterator[tuple[int, FrameBuffer]]:
        """Integrate, yielding (number of the first frame, block of frames).

        As `BarHingeModel.blocks`.
        """
        out = frame_block(self.experiment)
        geometry = self.experiment.geometry
        frames = device_frames(
            len(out.x),
            n_nodes=geometry.n_nodes,
            n_bars=len(geometry.bars),
            n_hinges=len(geometry.hinges),
        )
        # Two rows more than frames: the energies before and after a jump.
        sums = cuda.to_device(np.zeros((len(out.x) + 2, kernels.N_SUMS)))
        self.begin()
        self._observe(frames, sums, 0)
        self.driven_at_start = 0.0
        self._collect(frames, sums, [0.0], out)
        self.driven_at_start = float(out.ledger[0, 0])
        out.ledger[0, 0] = 0.0
        yield 0, head(out, 1)
        frame, n_frames = 0, self.experiment.n_frames
        while frame < n_frames - 1:
            count = min(len(out.x), n_frames - 1 - frame)
            done, escaped = self._advance(frame, count, frames, sums, out)
            if done:
                yield frame + 1, head(out, done)
            if escaped is not None:
                coordinate, step = escaped
                axis, node = divmod(coordinate, geometry.n_nodes)
                time = step * self.h * self.assembly.scaler.time
                x = self.scene.nodes.motion.copy_to_host()[kernels.X : kernels.X + 3].T
                x = x * self.assembly.scaler.length
                raise diverged(self.experiment, x, node=node, axis=axis, time=time)
            frame += done

    def begin(self) -> None:
        """Put driven coordinates in place."""
        scene = self.scene
        self._launch(kernels.place, scene.n_nodes, scene.nodes, scene.drives, 0.0, self.h)

    # --- a block of frames --------------------------------------------------------------------

    def _advance(
        self, first: int, count: int, frames: Any, sums: Any, out: FrameBuffer
    ) -> tuple[int, tuple[int, int] | None]:
        """Step through `count` frames; return how many are good, and what escaped when."""
        per_frame = self.experiment.steps_per_frame
        limit = plausible_size(self.experiment) / self.assembly.scaler.length
        looks = [
            step + 1
            for step in range(first * per_frame, (first + count) * per_frame)
            if step % GUARD_INTERVAL == 0 or (step + 1) % per_frame == 0
        ]
        escaped = cuda.to_device(np.full(len(looks), kernels.NOTHING_ESCAPED, np.int64))
        pending = list(enumerate(looks))
        jump_work = []
        for frame in range(count):
            step, end = (first + frame) * per_frame, (first + frame + 1) * per_frame
            while step < end:
                stop = self.held.next_jump(step, pending[0][1])
                jump = self.held.jumps_at(stop)
                self.steps(step, stop - step, hold=jump)
                if stop == pending[0][1]:
                    look, _ = pending.pop(0)
                    nodes = self.scene.nodes
                    self._launch(
                        kernels.find_escaped, self.scene.n_nodes, nodes, limit, escaped, look
                    )
                if jump:
                    self._jump(stop, frames, sums, frame)
                step = stop
            self._observe(frames, sums, frame)
            jump_work.append(self.jump_work)
        self._collect(frames, sums, jump_work, out)
        codes = escaped.copy_to_host()
        bad = np.flatnonzero(codes != kernels.NOTHING_ESCAPED)
        if len(bad):
            step = looks[bad[0]]
            return (step - 1) // per_frame - first, (int(codes[bad[0]]), step)
        return count, None

    def steps(self, step: int, count: int, *, hold: bool = False) -> None:
        """Take `count` steps from number `step` on.

        `hold` leaves driven coordinates, at the end, on the segments of signals that end there.
        """
        scene, h = self.scene, self.h
        parts = scene.elements, scene.nodes, scene.drives
        if self.one_block:
            kernels.march[1, self.threads](*parts, step, count, h, hold)
            return
        for number in range(step, step + count):
            held = hold and number == step + count - 1
            for stage in range(4):
                self._launch(kernels.push_elements, scene.n_elements, *parts[:2], stage, h)
                self._launch(kernels.advance_nodes, scene.n_nodes, *parts, number, stage, h, held)

    def _jump(self, step: int, frames: Any, sums: Any, row: int) -> None:
        """Let held signals move their coordinates; the energy that takes is their work."""
        spare = sums.shape[0] - 2
        self._observe(frames, sums, row, at=spare)
        t = step * self.h
        self._launch(
            kernels.place, self.scene.n_nodes, self.scene.nodes, self.scene.drives, t, t + self.h
        )
        self._observe(frames, sums, row, at=spare + 1)
        potential = [kernels.OF_BARS, kernels.OF_HINGES, kernels.FALLING]
        before, after = sums.copy_to_host()[spare:, potential].sum(axis=1)
        self.jump_work += float(after - before)

    def _observe(self, frames: Any, sums: Any, row: int, *, at: int | None = None) -> None:
        scene = self.scene
        parts = scene.elements, scene.nodes, frames
        self._launch(kernels.observe, scene.n_elements + scene.n_nodes, *parts, row)
        self._launch(kernels.add_up, self.partial.shape[1], *parts, self.partial)
        row = row if at is None else at
        self._launch(kernels.finish_sums, kernels.N_SUMS, self.partial, sums, row)

    def _collect(self, frames: Any, sums: Any, jump_work: list[float], out: FrameBuffer) -> None:
        """Copy frames to the host, in SI units."""
        length, velocity, force, moment, joule = self.assembly.scaler.output
        for source, target, unit in (
            (frames.x, out.x, length),
            (frames.v, out.v, velocity),
            (frames.length, out.length, length),
            (frames.tension, out.tension, force),
            (frames.moment, out.moment, moment),
        ):
            if target.size:
                np.multiply(source.copy_to_host(), unit, out=target)
        if out.angle.size:
            angles = frames.change.copy_to_host() + self.assembly.body.scratch[4]
            out.angle[...] = angles - FULL_TURN * np.floor(angles / FULL_TURN)
        rows, n = sums.copy_to_host()[:-2], len(jump_work)
        order = [kernels.KINETIC, kernels.OF_BARS, kernels.OF_HINGES, kernels.FALLING]
        out.energy[...] = joule * rows[:, order]
        order = [kernels.WORK_IN, kernels.BY_DRAG, kernels.BY_BARS, kernels.BY_HINGES]
        out.ledger[:, :4] = joule * rows[:, order]
        out.ledger[:n, 0] += joule * np.array(jump_work)
        out.ledger[:n, 0] += self._driven_energy(out.v[:n]) - self.driven_at_start

    def _driven_energy(self, v: Reals) -> Reals:
        """Return the kinetic energy of driven coordinates: what moves them comes from outside.

        Parameters
        ----------
        v : (B, N, 3) [m/s]
        """
        drives = self.assembly.body.drives
        axis, node = np.divmod(drives.motion_at, self.assembly.packing.stride)
        masses = drives.motion_mass * self.assembly.scaler.mass
        result: Reals = 0.5 * (masses * v[:, node, axis] ** 2).sum(axis=1)
        return result

    def _launch(self, kernel: Any, count: int, *arguments: Any) -> None:
        if count:
            threads = min(THREADS, count)
            kernel[-(-count // threads), threads](*arguments)


def cuda_blocks(experiment: Experiment) -> Iterator[tuple[int, FrameBuffer]]:
    """Integrate `experiment` on the device, as `BarHingeModel.blocks`."""
    yield from CudaRun(experiment).blocks()
