"""`SteppedExperiment`: a body whose input is decided while it moves.

The compiled loop that runs whole experiments is called for one symbol at a time; in between, the
one sample that its held input signals have is overwritten. Steps, times and state are those of
the whole run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from openprc.demlat.integrators import Settings, find_integrator
from openprc.demlat.models.barhinge.divergence import strained_most, way_out
from openprc.demlat.models.barhinge.model import make_control
from openprc.demlat.models.barhinge.support import ESCAPE_FACTOR, scene_size
from openprc.demlat.models.barhinge.tables import ENERGY_ROWS, LEDGER_STRIDE, FrameBuffer
from openprc.demlat.planning.stability import step_limit
from openprc.demlat.sensors import Quantity, Sensors
from openprc.demlat.stepping_checks import (
    check_supported,
    input_names,
    reading_frames,
    refuse_what_cannot_be_stepped,
    with_held_inputs,
)
from openprc.errors import ConfigError, Diverged

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]


class _Slot(NamedTuple):
    """Where a column of the input goes: a row of the signals, and the unit there."""

    column: int
    row: int
    unit: float


class SteppedExperiment:
    """A body that is advanced symbol by symbol.

    Offers what `openprc.reservoir` asks of a body in a closed loop: `reset`, `step`, `n_states`,
    `n_inputs`.

    Parameters
    ----------
    experiment : Experiment
        Body, actuators, integrator, time step. Of the signals that become inputs the first
        sample is where the body is put at `reset`; their other samples, and the duration, do not
        matter. Other signals are followed as they are.
    hold : float [s]
        How long a symbol is held; a multiple of `dt`, as are the times of readings.
    sensors : sequence of Sensors or str
        What `step` returns, in this order. A string is a quantity of everything.
    inputs : sequence of str, optional
        Names of the signals that are decided at run time, forces [N] or positions [m]; all that
        an actuator uses by default. A signal of three columns takes three columns of the symbol.
    readings : int or sequence of float
        When the sensors are read in a symbol: so many times, evenly, the last time at its end; or
        at these shares of `hold`, rising, in (0, 1]. The columns of one of `sensors` are all its
        readings, as those of a feature are with ``samples_per_symbol`` in
        `openprc.reservoir.Trainer`. A recording with five frames in a symbol has its last frame
        within the symbol at 0.8, since the next one begins the next symbol; with one frame in a
        symbol, that is at 1.

    Raises
    ------
    UnsupportedScene
        For contact, rigid elements, prescribed velocities and integrators that choose their
        steps, none of which can be continued symbol by symbol.
    ConfigError
        When a name, a number or the experiment is wrong.

    Examples
    --------
    >>> from openprc.demlat.stepping import SteppedExperiment
    >>> from openprc.schema import Experiment
    >>> from openprc.schema.experiment import Actuator, Signal
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> spring = Bars(indices=[[0, 1]], stiffness=[1.0], rest_length=[1.0], damping=[2.0])
    >>> geometry = Geometry(
    ...     positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=spring
    ... )
    >>> body = SteppedExperiment(
    ...     Experiment(
    ...         geometry=geometry,
    ...         signals={"force": Signal(name="force", values=[0.0], dt=1.0)},
    ...         actuators=(Actuator(node=1, signal="force", type="force", axes=(1, 0, 0)),),
    ...         duration=1.0,
    ...         dt=0.01,
    ...         save_interval=1.0,
    ...     ),
    ...     hold=40.0,
    ...     sensors=("bar_extensions",),
    ... )
    >>> round(float(body.step([0.5])[0]), 9)
    0.5
    """

    def __init__(
        self,
        experiment: Experiment,
        *,
        hold: float,
        sensors: Sequence[Sensors | Quantity],
        inputs: Sequence[str] | None = None,
        readings: int | Sequence[float] = 1,
    ) -> None:
        self.hold = float(hold)
        self.inputs = input_names(experiment, inputs)
        refuse_what_cannot_be_stepped(experiment, self.inputs)
        self._frames, self._rows = reading_frames(readings)
        self.experiment = with_held_inputs(experiment, self.inputs, hold, self._frames)
        check_supported(self.experiment)
        self._reach = ESCAPE_FACTOR * scene_size(experiment)
        chosen = [Sensors(s) if isinstance(s, str) else s for s in sensors]
        if not chosen:
            raise ConfigError("no sensors", expected="at least one", key="sensors")
        count = len(self._rows)
        #: Of the states that `step` returns.
        self.names: tuple[str, ...] = tuple(
            name if count == 1 else f"{name}@{time}/{count}"
            for one in chosen
            for time in range(1, count + 1)
            for name in one.names(experiment)
        )
        self.n_states = len(self.names)
        self.n_inputs = 0
        self._compile(chosen)
        self.reset()

    @property
    def time(self) -> float:
        """Where the body is [s]; 0 after `reset`."""
        return self._frame * self.hold / self._frames

    def reset(self) -> None:
        """Go back to t = 0."""
        for slot, value in zip(self._slots, self._first, strict=True):
            self._samples[slot.row, 0] = value
        state = self._assembly.state
        state.x[:], state.v[:] = self._start
        state.ledger[:] = 0.0
        self._scheme = self._integrator.load().for_body(self._assembly.body, self._settings)
        self._frame = -1
        self._advance(1)

    def step(self, u: ArrayLike) -> Reals:
        """Hold one symbol, and return what the sensors read: (F,).

        A prescribed position jumps when the symbol begins, and readings at the end of a symbol
        are from before the next one jumps.

        Parameters
        ----------
        u : (C,) [N] or [m]
            In the order of `inputs`.

        Raises
        ------
        ConfigError
            When the symbol has another width or is not finite.
        Diverged
            When a coordinate leaves the range of plausible numbers; `reset` begins anew.
        """
        symbol = np.atleast_1d(np.asarray(u, dtype=np.float64))
        if symbol.shape != (self.n_inputs,) or not np.isfinite(symbol).all():
            raise ConfigError(
                f"the symbol {np.asarray(u).tolist()!r}",
                expected=f"{self.n_inputs} finite number(s), for " + ", ".join(self.inputs),
                key="u",
            )
        for slot in self._slots:
            self._samples[slot.row, 0] = symbol[slot.column] / slot.unit
        self._place()
        self._renew_force()
        self._advance(self._frames)
        return np.concatenate(
            [read(self._buffer, row) for read in self._readers for row in self._rows]
        )

    def run(self, symbols: ArrayLike) -> Reals:
        """Step through symbols (K, C) from t = 0 and return the states after each: (K, F)."""
        table = np.asarray(symbols, dtype=np.float64)
        table = table[:, np.newaxis] if table.ndim == 1 else table
        self.reset()
        return np.array([self.step(symbol) for symbol in table]).reshape(-1, self.n_states)

    # --- inside ---------------------------------------------------------------------------------

    def _compile(self, sensors: Sequence[Sensors]) -> None:
        # Compiled code is loaded when a body is made, not when this module is imported.
        from openprc.demlat.integrators.stepping import advance  # noqa: PLC0415
        from openprc.demlat.models.barhinge.assembly import assemble  # noqa: PLC0415

        experiment = self.experiment
        # A scene that is planar now may be driven out of its plane later.
        lifted = any(a.axes[2] for a in experiment.actuators if a.signal in self.inputs)
        self._assembly = assemble([experiment], dims=3 if lifted else None)
        body, state, unit = self._assembly.body, self._assembly.state, self._assembly.scaler
        self._loop = advance
        self._integrator = find_integrator(experiment.integrator)
        frame_time = experiment.save_interval / unit.time
        self._settings = Settings(
            h=frame_time / experiment.steps_per_frame,
            frame_time=frame_time,
            limit=self._reach / unit.length,
        )
        self._control = make_control("fixed", self._settings, experiment.steps_per_frame)
        self._energy = np.zeros(ENERGY_ROWS * LEDGER_STRIDE, body.mass.dtype)
        self._start = state.x.copy(), state.v.copy()
        geometry, dims = experiment.geometry, self._assembly.packing.dims
        self._buffer = FrameBuffer.for_frames(
            self._frames,
            n_nodes=geometry.n_nodes,
            dims=dims,
            n_bars=len(geometry.bars),
            n_hinges=len(geometry.hinges),
            n_bends=len(geometry.bends),
        )
        reference = self._assembly.reference[0, :, :dims]
        self._readers = [one.reader(experiment, reference) for one in sensors]
        self._samples = body.drives.signals.coefficients
        self._slots = self._find_slots()
        self._first = self._samples[[slot.row for slot in self._slots], 0].copy()
        rows = [slot.row for slot in self._slots]
        drives = body.drives
        firsts = drives.signals.first[drives.motion_signal]
        moved = np.isin(firsts, rows)
        self._moved_at, self._moved_row = drives.motion_at[moved], firsts[moved]
        self._moved_start = drives.motion_start[moved]

    def _find_slots(self) -> list[_Slot]:
        """Find the rows of the signal table that the input's columns are written to."""
        experiment, packing = self.experiment, self._assembly.packing
        drives, unit = self._assembly.body.drives, self._assembly.scaler
        begin, self.n_inputs = {}, 0
        for name in self.inputs:
            begin[name] = self.n_inputs
            self.n_inputs += experiment.signals[name].values.shape[1]
        # The table has its rows in the order of actuators and axes.
        motion, force = iter(drives.motion_signal), iter(drives.force_signal)
        slots: dict[int, _Slot] = {}
        for actuator in experiment.actuators:
            pushed = actuator.type == "force"
            for axis in np.flatnonzero(actuator.axes):
                if axis >= packing.dims:
                    continue
                number = int(next(force if pushed else motion))
                if actuator.signal not in self.inputs:
                    continue
                wide = experiment.signals[actuator.signal].values.shape[1] == 3
                row = int(drives.signals.first[number])
                slots[row] = _Slot(
                    begin[actuator.signal] + (int(axis) if wide else 0),
                    row,
                    unit.force if pushed else unit.length,
                )
        return list(slots.values())

    def _place(self) -> None:
        """Move driven coordinates to where the new symbol holds them."""
        state = self._assembly.state
        state.x[self._moved_at] = self._moved_start + self._samples[self._moved_row, 0]
        state.v[self._moved_at] = 0.0

    def _renew_force(self) -> None:
        """Keep the scheme from using a force of the last symbol again."""
        scheme = getattr(self._scheme, "fast", self._scheme)
        if self._integrator.name in ("verlet", "respa"):
            scheme.clock[1] = 0.0  # a knot that has passed

    def _advance(self, count: int) -> None:
        from openprc.demlat.integrators.stepping import FAILED  # noqa: PLC0415  compiles

        assembly = self._assembly
        _, escaped, time = self._loop(
            self._scheme,
            assembly.body,
            assembly.state,
            self._energy,
            self._control,
            self._frame,
            count,
            assembly.scaler.output,
            self._buffer,
        )
        if escaped == FAILED:
            raise self._scheme.explain(self.experiment, assembly, time * assembly.scaler.time)
        if escaped >= 0:
            raise self._diverged(escaped, time * assembly.scaler.time)
        self._frame += count

    def _diverged(self, coordinate: int, time: float) -> Diverged:
        assembly, experiment = self._assembly, self.experiment
        axis, node = divmod(coordinate, assembly.packing.stride)
        positions = assembly.packing.nodes(assembly.state.x)[0] * assembly.scaler.length
        positions = positions + assembly.reference[0, :, : assembly.packing.dims]
        return Diverged(
            f"node {node} left the range of plausible positions along {'xyz'[axis]}"
            f" by t = {time:.6g} s{strained_most(experiment, positions, node)}",
            expected=f"coordinates below {self._reach:.3g} m",
            fix=f"limit what is fed in, or {way_out(step_limit(experiment), experiment.dt)}",
            key="simulation.dt",
        )
