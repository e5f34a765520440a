"""`BarHingeModel`: one experiment, stepped block by block."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from openprc.demlat.models.barhinge.tables import FrameBuffer, Work
from openprc.demlat.plan import make_plan, node_drag, remarks, supports
from openprc.demlat.stability import stable_step
from openprc.errors import ConfigError, Diverged

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment
    from openprc.schema.findings import Finding

Backend = Literal["auto", "cpu", "cuda", "jax"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

#: Saved frames are handed on when about this much has gathered ...
BLOCK_BYTES = 4 << 20
#: ... or after about this many element updates, so that progress shows and Ctrl-C works.
BLOCK_WORK = 20_000_000


class BarHingeModel:
    """Nodes with mass, bars with axial springs, hinges with torsional springs.

    Parameters
    ----------
    experiment : Experiment
        One for which `supports` is empty.
    backend : {"auto", "cpu", "cuda", "jax"}
        There is one compiled backend, "cpu". The names "cuda" and "jax" are accepted, so that
        a script written for another machine runs, and `remarks` says what ran instead; the
        results are the same to rounding.
    """

    name = "barhinge"

    def __init__(self, experiment: Experiment, *, backend: Backend = "auto") -> None:
        if backend not in BACKENDS:
            raise ConfigError(
                f"the backend {backend!r}", expected="one of " + ", ".join(BACKENDS), key="backend"
            )
        self.experiment = experiment
        self.backend = backend
        self.plan = make_plan(experiment)

    @staticmethod
    def supports(experiment: Experiment) -> list[Finding]:
        """Return what this model cannot represent; empty means all of it."""
        return supports(experiment)

    def remarks(self) -> Iterator[str]:
        """Yield what a reader of the result should know."""
        yield from remarks(self.experiment)
        if self.backend in ("cuda", "jax"):
            yield f"there is no {self.backend!r} backend: the run used the compiled cpu backend"

    def blocks(self) -> Iterator[tuple[int, FrameBuffer]]:
        """Integrate, yielding (number of the first frame, block of frames).

        The first block is the frame t = 0. The arrays are reused: copy what should stay.

        Raises
        ------
        Diverged
            When a coordinate leaves the range of plausible numbers; the frames before that
            have been yielded.
        """
        # Compiled code is loaded when something runs, not when an experiment is built.
        from openprc.demlat.integrators.rk4 import advance, begin  # noqa: PLC0415

        plan = self.plan
        n_nodes = len(plan.positions)
        x, v = plan.positions.copy(), plan.velocities.copy()
        ledger, work = np.zeros(2), Work.for_nodes(n_nodes)
        tables = (plan.nodes, plan.bars, plan.hinges, plan.drives, plan.signals)
        out = FrameBuffer.for_frames(self._block_frames(), n_nodes)
        begin(x, v, ledger, *tables, plan.step, out)
        yield 0, FrameBuffer(*(column[:1] for column in out))
        frame = 0
        while frame < plan.n_frames - 1:
            count = min(len(out.kinetic), plan.n_frames - 1 - frame)
            done, escaped, step = advance(
                x,
                v,
                ledger,
                work,
                *tables,
                frame,
                count,
                plan.steps_per_frame,
                plan.step,
                plan.escape_limit,
                out,
            )
            if done:
                yield frame + 1, FrameBuffer(*(column[:done] for column in out))
            if escaped >= 0:
                raise self._diverged(escaped, step * plan.step)
            frame += done

    def _block_frames(self) -> int:
        plan = self.plan
        frame_bytes = 48 * len(plan.positions)
        elements = len(plan.positions) + len(plan.bars.i) + 4 * len(plan.hinges.j)
        frame_work = 4 * plan.steps_per_frame * elements
        return max(1, min(plan.n_frames, BLOCK_BYTES // frame_bytes, BLOCK_WORK // frame_work))

    def _diverged(self, node: int, time: float) -> Diverged:
        limit = stable_step(self.experiment, node_drag(self.experiment))
        return Diverged(
            f"node {node} left the range of plausible positions at t = {time:.6g} s",
            expected=f"coordinates below {self.plan.escape_limit:.3g} m",
            fix=f"use a smaller dt: it is {self.experiment.dt:g} s, and the stability limit"
            f" estimated at rest is {limit:.3g} s; frames up to then are in the partial file",
            key="simulation.dt",
        )
