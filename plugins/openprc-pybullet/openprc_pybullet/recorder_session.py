"""What a script calls in its loop: a step, a frame, and a block of frames to the file at times.

Reading the state through PyBullet's functions is most of the cost. What comes on top is kept
small: a frame is one list that is packed into a preallocated block of rows, and everything else
(sorting into nodes and channels, checks, the file) happens once a block.
"""

from __future__ import annotations

import time as wall
from collections.abc import Sequence
from dataclasses import replace
from struct import Struct
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError, OpenPRCError, UnsupportedScene
from openprc.schema import TrajectoryWriter
from openprc_pybullet.recorded_client import Connection
from openprc_pybullet.recorded_guard import Divergence, Guard
from openprc_pybullet.recorded_parts import Part, Values
from openprc_pybullet.recorded_scene import Scene
from openprc_pybullet.recorded_signals import Signals, SignalSpec

#: Frames of a block, fewer where frames are large, and how many seconds it may wait to fill.
BLOCK_FRAMES = 1024
BLOCK_BYTES = 4 << 20
BLOCK_SECONDS = 2.0


class Session:
    """A recording under way.

    Call `step` instead of ``stepSimulation``, or `record` after it. As a context manager it
    takes the frame of the start and, at the end, hands what is left to the writer.
    """

    def __init__(
        self,
        connection: Connection,
        writer: TrajectoryWriter,
        specs: tuple[SignalSpec, ...],
        *,
        every: int,
        t0: float,
        variable_dt: bool,
        limit: float | None,
    ) -> None:
        self._connection = connection
        self._writer = writer
        self._specs = specs
        self._signals: Signals | None = None
        self._every = every
        self._limit = limit
        self._variable = variable_dt
        self._clock = connection.clock()
        self._dt = self._clock.dt
        # Time is t_base + (steps - n_base) dt: nothing is summed up.
        self._t_base, self._n_base, self._steps = t0, 0, 0
        self._running = False
        self._simulate = connection.bullet.stepSimulation
        self._lost: type[Exception] = connection.bullet.error

    def take_parts(self, parts: Sequence[Part], bodies: Sequence[int]) -> None:
        """Learn what to record; the recorder calls this once."""
        self._scene = Scene(parts)
        self._bodies = tuple(bodies)
        self._reads = [part.read for part in parts]
        width = self._scene.width + 1  # time stands in front
        self._room = max(2, min(BLOCK_FRAMES, BLOCK_BYTES // (8 * width)))
        self._block = np.empty((self._room, width))
        self._bytes = self._block.data.cast("B")
        self._pack = Struct(f"={width}d").pack_into
        self._stride = 8 * width
        self._filled = 0
        self._saved = 0

    # --- the script's side ----------------------------------------------------------------

    @property
    def time(self) -> float:
        """The simulation time reached [s]."""
        return self._t_base + (self._steps - self._n_base) * self._dt

    @property
    def n_frames(self) -> int:
        """Frames so far, that of the start included."""
        return self._saved + self._filled

    def step(self, /, **commanded: Any) -> None:
        """Make one ``stepSimulation`` and record the state after it.

        Parameters
        ----------
        **commanded
            Values of the signals that come with every step: what acts during this one.

        Raises
        ------
        UnsupportedScene
            When a recorded body is gone, or the server is.
        Diverged
            When the simulation blew up; noticed at the end of a block of frames.
        ConfigError
            When the time step changed without `variable_dt`, or a signal is wrong.
        """
        if not self._running:
            raise _over()
        if self._variable:
            self._ask_dt()
        if commanded or self._specs:
            self._command(commanded)
        try:
            self._simulate(self._connection.client)
        except self._lost as error:
            raise self._gone() from error
        self._steps += 1
        if self._steps % self._every == 0:
            self._take()

    def record(self, n_steps: int = 1, /, **commanded: Any) -> None:
        """Record the state after the script's own ``stepSimulation``.

        Parameters
        ----------
        n_steps : int
            Steps made since the last call.
        **commanded
            Values of the signals during these steps.

        Raises
        ------
        UnsupportedScene, Diverged, ConfigError
            See `step`.
        """
        if not self._running:
            raise _over()
        if isinstance(n_steps, bool) or not isinstance(n_steps, int) or n_steps < 1:
            raise ConfigError(
                f"record() after {n_steps!r} steps", expected="1 or more",
                fix="call it after stepSimulation()", key="n_steps",
            )  # fmt: skip
        if self._variable:
            self._ask_dt()
        if commanded or self._specs:
            self._command(commanded)
        before = self._steps // self._every
        self._steps += n_steps
        if self._steps // self._every != before:
            if self._steps % self._every:
                raise ConfigError(
                    f"{n_steps} steps at a time, every {self._every}th of them to be kept",
                    expected="steps at a time that divide every",
                    fix="record() after each step, or leave every out",
                    key="every",
                )
            self._take()

    def flush(self) -> None:
        """Make the frames so far safe against a crash; this happens by itself every 2 s or so.

        Raises
        ------
        Diverged, ConfigError
            See `step`.
        """
        if not self._running:
            raise _over()
        self._flush()
        self._writer.commit()

    # --- one frame ------------------------------------------------------------------------

    def _command(self, commanded: dict[str, Any]) -> None:
        if self._signals is None:
            known = {spec.name for spec in self._specs}
            # Names that are new later on find no place: the frames before have no value.
            new = [SignalSpec(k) for k in commanded if k not in known and self._steps == 0]
            for spec in new:
                self._writer.note(f"the unit of the input {spec.name} was not told (signals)")
            self._specs = (*self._specs, *new)
            self._signals = Signals(self._specs)
        waits = len(self._signals.rows) < self._filled
        self._signals.command(commanded, frame_waits=waits, t=self.time, step=self._steps)

    def _ask_dt(self) -> None:
        dt = self._connection.clock().dt
        if dt != self._dt:
            self._t_base, self._n_base, self._dt = self.time, self._steps, dt

    def _take(self) -> None:
        if self._filled == self._room or wall.monotonic() > self._due:
            self._flush()
        row: list[float] = [self._t_base + (self._steps - self._n_base) * self._dt]
        try:
            for read in self._reads:
                read(row)
        except self._lost as error:
            raise self._gone() from error
        self._pack(self._bytes, self._filled * self._stride, *row)
        ask, client = self._connection.bullet.getUserData, self._connection.client
        for mark, name in self._marks:
            if ask(mark, client) != name:
                raise self._gone()
        self._filled += 1

    def _gone(self) -> UnsupportedScene:
        """Say which body is no longer there; what stands under its id may be another one."""
        p, c = self._connection.bullet, self._connection.client
        if not self._connection.is_open:
            return UnsupportedScene(
                f"client {c} was disconnected at {self.time:.9g} s",
                expected="the server to stay until the recording ends",
                fix="close the recording before disconnect()",
                key="simulator",
            )
        lost = [
            str(body)
            for body, (mark, name) in zip(self._bodies, self._marks, strict=True)
            if p.getUserData(mark, c) != name
        ]
        return UnsupportedScene(
            f"bodies {', '.join(lost) or 'unknown'} are gone at {self.time:.9g} s: the script "
            "removed them or reset the simulation",
            expected="the recorded bodies to stay; a body that is loaded later is another one, "
            "even under the same id",
            fix="close the recording before removeBody() and resetSimulation(), and begin another "
            "one after loading",
            key="bodies",
        )

    # --- one block ------------------------------------------------------------------------

    def _flush(self, *, final: bool = False) -> None:
        """Check the frames that are whole and hand them to the writer."""
        self._due = wall.monotonic() + BLOCK_SECONDS
        # The command of the last frame comes with the step after it.
        rows = self._filled if self._signals is None else len(self._signals.rows)
        if self._specs and self._signals is None:
            rows = 0
        if rows == 0:
            return
        block = self._block[:rows]
        values = self._scene.values(block[:, 1:])
        bad = self._guard.check(values.positions, values.velocities, values.channels)
        self._append(block[:, 0], values, rows if bad is None else bad.row)
        left = self._filled - rows
        self._block[:left] = self._block[rows : self._filled]
        self._filled = left
        if bad is not None:
            raise self._blown_up(bad, float(block[bad.row, 0]), before=rows + left)
        pushed = self._scene.watch_fixed(values.positions)
        if pushed:
            self._writer.note(
                f"{', '.join(pushed)} have mass 0 or are welded to such a base, and are marked "
                "fixed; the script moved them"
            )
        if not final or self._connection.is_open:
            self._look_around()

    def _blown_up(self, bad: Divergence, time: float, *, before: int) -> OpenPRCError:
        self._running = False
        step = self._steps - (before - 1 - bad.row) * self._every
        return bad.error(time=time, step=step)

    def _append(self, times: NDArray[np.float64], values: Values, rows: int) -> None:
        inputs = {} if self._signals is None else self._signals.take(len(times))
        if rows == 0:
            return
        if self._saved == 0 and self._signals is not None:
            self._signals.declare(self._writer)
        self._writer.append(
            times[:rows],
            **self._scene.as_frames(values, rows),
            inputs={name: table[:rows] for name, table in inputs.items()},
        )
        self._saved += rows

    def _look_around(self) -> None:
        """Notice what the script changed since the last block and did not say."""
        clock = self._connection.clock()
        if not self._variable and clock.dt != self._dt:
            raise ConfigError(
                f"the time step changed from {self._dt:.9g} to {clock.dt:.9g} s before "
                f"{self.time:.9g} s",
                expected="the same step throughout",
                fix="record with variable_dt=True, which asks for it in every step",
                key="fixedTimeStep",
            )
        if clock != replace(self._clock, dt=clock.dt):
            self._writer.note(
                f"from about {self.time:.9g} s on gravity is {clock.gravity} m/s2 and a step has "
                f"{clock.sub_steps} sub-steps"
            )
            self._clock = clock
        new = sorted(set(self._connection.body_ids()) - self._present)
        if new:
            self._present.update(new)
            self._writer.note(
                f"bodies {', '.join(map(str, new))} appeared before {self.time:.9g} s and are not "
                "recorded: the bodies of a file are those at its start"
            )

    # --- beginning and end ----------------------------------------------------------------

    def __enter__(self) -> Self:
        """Take the frame of the start."""
        self._marks: list[tuple[int, bytes]] = []
        try:
            for body in self._bodies:
                name = f"openprc.body{body}"
                self._marks.append((self._connection.mark(body, name), name.encode()))
            self._begin()
        except BaseException:
            self._unmark()
            raise
        self._running = True
        return self

    def _begin(self) -> None:
        self._present = set(self._connection.body_ids())
        self._due = wall.monotonic() + BLOCK_SECONDS
        self._take()
        first = self._scene.values(self._block[:1, 1:])
        self._guard = Guard(
            first.positions[0],
            reach=self._scene.reach(first.positions[0], self._connection),
            labels=self._scene.labels,
            n_speeds=self._scene.n_speeds,
            limit=self._limit,
        )
        bad = self._guard.check(first.positions, first.velocities, first.channels)
        if bad is not None:
            raise self._blown_up(bad, self.time, before=1)
        self._scene.declare(self._writer, first, clock=self._clock, every=self._every)

    def _unmark(self) -> None:
        for mark, name in self._marks:
            self._connection.unmark(mark, name)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hand over the last frames, whether or not the script failed."""
        was_running, self._running = self._running, False
        try:
            if was_running:
                self._finish(failed=error is not None)
        except OpenPRCError as problem:
            if error is None:
                raise
            # What stopped the script says more; it goes on its way.
            self._writer.note(f"at the end of the recording: {problem.found}")
        finally:
            self._unmark()

    def _finish(self, *, failed: bool) -> None:
        if self._specs:
            if self._signals is None:
                self._signals = Signals(self._specs)
            if len(self._signals.rows) < self._filled and self._signals.finish(
                t=self.time, step=self._steps, ask=not failed
            ):
                self._writer.note(
                    "the input of the last frame is that of the frame before: no command followed"
                )
            if self._signals.changed_between:
                self._writer.note(
                    f"commands changed between saved frames (every={self._every}): the inputs hold "
                    "those of the steps that begin at a frame"
                )
        self._flush(final=True)


def _over() -> ConfigError:
    return ConfigError(
        "the recording is over",
        expected="step() and record() while it is open",
        fix="step inside the with block, or begin another recording",
        key="session",
    )
