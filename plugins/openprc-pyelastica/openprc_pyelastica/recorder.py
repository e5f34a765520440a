"""Recording a simulator of a user's own script through its callbacks."""

from __future__ import annotations

import time as wall
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from openprc.errors import ConfigError
from openprc_pyelastica import joints, live_divergence
from openprc_pyelastica.callback import ForceWatch, callback_class, version_notes, watched
from openprc_pyelastica.frames import Frames
from openprc_pyelastica.recorded_signals import Signal, signals_of
from openprc_pyelastica.recorded_systems import bodies, choose, is_recordable
from openprc_pyelastica.track import Track, rows_for

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

#: Frames wait for no longer than this [s].
FLUSH_SECONDS = 2.0
OPTIONS = (
    "systems", "every", "directors", "strains", "signals", "plane", "max_stretch",
)  # fmt: skip
PLANES = (None, "xy", "xz", "yz")


def attach(
    simulator: Any,
    writer: TrajectoryWriter,
    *,
    systems: Any = None,
    every: int = 1,
    directors: bool = False,
    strains: bool = False,
    signals: Mapping[str, Any] | None = None,
    plane: str | None = None,
    max_stretch: float = live_divergence.MAX_STRETCH,
) -> Session:
    """Record a simulator; to be called before its ``finalize()``.

    Parameters
    ----------
    simulator : object
        A collection of systems with the mixin ``CallBacks``.
    writer : TrajectoryWriter
    systems : optional
        A rod or rigid body, several in a list, or a mapping of name to system. When left out,
        everything that moves is recorded, also what is appended later.
    every : int
        Simulation steps from one frame to the next.
    directors, strains : bool
        Whether the frames (d1, d2, d3) of the elements, and their strains sigma and kappa, are
        recorded, too.
    signals : mapping, optional
        What drives the body; see `openprc_pyelastica.recorded_signals.signals_of`.
    plane : {"xy", "xz", "yz"}, optional
        Leaves out the third coordinate, along which nothing moves.
    max_stretch : float
        An element that many times longer than at rest is a simulation that blew up.

    Raises
    ------
    ConfigError
        The simulator is finalized, has no callbacks, or holds nothing that moves.
    """
    whole = isinstance(every, int | np.integer) and not isinstance(every, bool)
    if not whole or every < 1:
        raise ConfigError(
            f"every is {every!r}",
            expected="a whole number of simulation steps from one frame to the next, 1 or more",
            fix="every=100 keeps each hundredth step",
            key="every",
        )
    if not max_stretch > 1.0:
        raise ConfigError(
            f"max_stretch is {max_stretch!r}",
            expected="a ratio of lengths above 1",
            fix="leave it out for 10",
            key="max_stretch",
        )
    if plane not in PLANES:
        raise ConfigError(
            f"plane is {plane!r}",
            expected="xy, xz or yz",
            fix="leave plane out to record three coordinates",
            key="plane",
        )
    if not hasattr(simulator, "collect_diagnostics"):
        raise ConfigError(
            f"{type(simulator).__name__} has no callbacks",
            expected="a simulator class that derives from elastica.CallBacks",
            fix="add CallBacks to its base classes, beside BaseSystemCollection",
            key="simulator",
        )
    if getattr(simulator, "_finalize_flag", False) or not hasattr(simulator, "_callback_list"):
        raise ConfigError(
            "the simulator is finalized and takes no more callbacks",
            expected="a recorder that is attached before finalize()",
            fix="move record_run() up, to before simulator.finalize()",
            key="simulator",
        )
    choose(simulator, systems)  # complains now, not in finalize()
    session = Session(
        simulator,
        writer,
        systems=systems,
        every=int(every),
        extra=(("director_collection",) if directors else ())
        + (("sigma", "kappa") if strains else ()),
        signals=signals_of(signals),
        plane=plane,
        max_stretch=float(max_stretch),
    )
    # Put first, so that the lists of callbacks and joints are still there when it is called.
    simulator._feature_group_finalize.insert(0, session.register)
    return session


class Session:
    """A recording under way; what `record_run` gives to the script.

    The simulator drives it through callbacks, so that a script need not call anything.
    """

    def __init__(
        self,
        simulator: Any,
        writer: TrajectoryWriter,
        *,
        systems: Any,
        every: int,
        extra: tuple[str, ...],
        signals: tuple[Signal, ...],
        plane: str | None,
        max_stretch: float,
    ) -> None:
        self._simulator = simulator
        self._systems = systems
        self._every = every
        self._extra = extra
        self._signals = list(signals)
        self._watches: dict[str, ForceWatch] = {}
        self._plane = plane
        self._writer = writer
        self._guard = live_divergence.Guard(max_stretch)
        self._frames: Frames | None = None
        self._tracks: dict[int, Track] = {}
        self._last: Track | None = None
        self._drives: list[tuple[Signal, np.ndarray[Any, np.dtype[np.float64]]]] = []
        self._taken = 0
        self._ended = False
        self._due = wall.monotonic() + FLUSH_SECONDS

    # --- for scripts -------------------------------------------------------------------------

    @property
    def n_frames(self) -> int:
        """Frames recorded so far."""
        return self._taken

    def watch(self, forcing: type, *, name: str, targets: tuple[str, ...] = ()) -> type:
        """Return a forcing class that records the net force it applies as the input `name`.

        Hand it to ``simulator.add_forcing_to(rod).using(...)`` in the place of `forcing`. The
        force of a frame is the one of the step that ended there, taken half a step before.

        Raises
        ------
        ConfigError
            The name is taken, or the simulator is finalized.
        """
        if name in self._watches or any(signal.name == name for signal in self._signals):
            raise ConfigError(
                f"two inputs are called {name!r}",
                expected="a name of its own for each",
                fix="choose another name",
                key="name",
            )
        if self._tracks:
            raise ConfigError(
                "the simulator is finalized",
                expected="watch() before finalize()",
                fix="move it up, to where the forcing is added",
                key="watch",
            )
        self._watches[name] = ForceWatch()
        declaration = {"unit": "N", "quantity": "force", "targets": tuple(targets)}
        self._signals.append(Signal(name, self._watches[name].read, ("x", "y", "z"), declaration))
        return watched(forcing, self._watches[name])

    def flush(self, *, commit: bool = False) -> None:
        """Hand the complete frames on to the file, and make them safe when `commit`.

        Raises
        ------
        Diverged
            When one of them cannot be true; those before it are kept.
        """
        rows = min((track.row for track in self._tracks.values()), default=0)
        if rows and not self._ended:
            self._hand_on(rows, guard=True)
        if commit:
            self._writer.commit()
        self._due = wall.monotonic() + FLUSH_SECONDS

    # --- for the simulator ---------------------------------------------------------------------

    def register(self) -> None:
        """Attach to every system; the simulator calls it when it is finalized."""
        chosen = bodies(choose(self._simulator, self._systems))
        found, notes = joints.find(self._simulator, chosen)
        width = sum(
            getattr(body.system, name).size
            for body in chosen
            for name in ("position_collection", "velocity_collection", *self._extra)
            if hasattr(body.system, name)
        )
        rows = rows_for(width)
        made = callback_class()
        for body in chosen:
            extra = tuple(name for name in self._extra if hasattr(body.system, name))
            self._tracks[id(body.system)] = Track(body, rows=rows, extra=extra)
            self._simulator.collect_diagnostics(body.system).using(
                made, session=self, every=self._every
            )
        self._last = list(self._tracks.values())[-1]
        self._drives = [(signal, np.empty((rows, len(signal.columns)))) for signal in self._signals]
        self._frames = Frames(
            self._writer,
            chosen,
            found,
            signals=self._signals,
            every=self._every,
            plane=self._plane,
        )
        self._guard.watch(chosen)
        for note in (*notes, *version_notes(self._simulator)):
            self._writer.note(note)

    def take(self, system: Any, time: float) -> None:
        """Record the state of a system, or of several; callbacks call it."""
        track = self._tracks.get(id(system))
        if track is None:
            self._take_all(system, time)
            return
        if self._ended:
            return
        if track.row == track.rows:
            self.flush()
        if track.take(system, time) and track is self._last:
            self._complete(track, time)

    def _take_all(self, systems: Any, time: float) -> None:
        for system in systems.values() if isinstance(systems, Mapping) else systems:
            if is_recordable(system):
                self.take(system, time)

    def _complete(self, track: Track, time: float) -> None:
        row = track.row - 1
        for signal, values in self._drives:
            values[row] = signal.read(float(time), self._taken * self._every)
        self._taken += 1
        # The frame at t = 0 waits for the forces of the first step.
        if self._taken > 1 and wall.monotonic() > self._due:
            self.flush()

    def _hand_on(self, rows: int, *, guard: bool) -> None:
        if self._frames is None:
            return
        tracks = list(self._tracks.values())
        first = self._frames.written == 0
        for signal, values in self._drives:
            watch = self._watches.get(signal.name)
            if first and watch is not None and watch.first is not None:
                values[0] = watch.first
        with np.errstate(over="ignore", invalid="ignore"):
            lengths = {
                track.body.name: track.lengths(rows) for track in tracks if track.body.is_rod
            }
        hit = self._guard.find(tracks, rows, lengths=lengths)
        sound = rows if hit is None else hit.row
        if sound:
            drives = {signal.name: values[:sound] for signal, values in self._drives}
            self._frames.append(tracks, sound, lengths=lengths, drives=drives)
        for track in tracks:
            track.drop(rows)
        for _, values in self._drives:
            left = len(values) - rows
            values[:left] = values[rows:].copy()
        if hit is not None:
            self._ended = True
            if guard:
                raise hit.error(self._frames.written)

    # --- life cycle --------------------------------------------------------------------------

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Hand on what is left.

        Raises
        ------
        Diverged
            When the last frames cannot be true.
        ConfigError
            When the script ended without an error and nothing was recorded.
        """
        if not self._tracks and kind is None:
            raise ConfigError(
                "the simulator was never finalized",
                expected="simulator.finalize() after the recorder was attached, then a loop",
                fix="call finalize() inside the block, or before close()",
                key="simulator",
            )
        rows = min((track.row for track in self._tracks.values()), default=0)
        if rows and not self._ended:
            # An error that is already on its way says more than what follows from it.
            self._hand_on(rows, guard=kind is None)
        self._ended = True
