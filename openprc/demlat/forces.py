"""`ForceField`: the forces of an experiment, for loops that belong to someone else.

An integrator that is not the engine's own (another simulator, a solver of SciPy) evaluates the
same compiled laws as the engine; there is one copy of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.demlat.compiled.aligned import aligned_zeros_like
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.models.barhinge.tables import (
    ENERGY_ROWS,
    LEDGER_STRIDE,
    FrameBuffer,
    ledger_size,
)
from openprc.demlat.signal_table import SAMPLE_SLACK
from openprc.errors import ConfigError
from openprc.hooks.running import refuse_unsupported
from openprc.schema.experiment_checks import check_experiment
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Where a signal jumps: from the jump on, or up to it.
Side = Literal["after", "before"]


class ForceField:
    """Forces on the nodes of a body, at any positions, velocities and time.

    Bars, hinges and bends, weight, drag, and force actuators, in double precision. Nodes that
    are fixed or driven are no exception: what is returned for them is what would move them
    if nothing held them.

    Parameters
    ----------
    experiment : Experiment
        Integrator, step and precision do not matter, but for `dt`, which says how close to a
        sample of a signal a time counts as lying on it.
    vectors : bool, optional
        Evaluate many elements at once. By default as the engine does, which compiles code for
        scenes of 64 elements and more; ``False`` uses the code that all small scenes share.

    Attributes
    ----------
    power : (5,) or, with bends, (6,) [W]
        Of the last evaluation: what force actuators put in, then what drag, bars, hinges, contact
        and bends take.

    Raises
    ------
    ConfigError
        When the experiment is wrong.
    UnsupportedScene
        For rigid elements, hard stops and contact, which act by constraints and impacts, and
        for laws that the engine does not have.

    Examples
    --------
    >>> from openprc.demlat.forces import ForceField
    >>> from openprc.schema import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> spring = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0])
    >>> body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], bars=spring)
    >>> field = ForceField(Experiment(geometry=body, duration=1.0, dt=0.01, save_interval=0.1))
    >>> field([[0, 0, 0], [1.5, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    array([[ 50.,   0.,   0.],
           [-50.,   0.,   0.]])
    """

    def __init__(self, experiment: Experiment, *, vectors: bool | None = None) -> None:
        # Compiled code is loaded when there is something to evaluate.
        from openprc.demlat.models.barhinge.assembly import assemble  # noqa: PLC0415
        from openprc.demlat.models.barhinge.drive_table import drive_table  # noqa: PLC0415
        from openprc.demlat.models.barhinge.field_kernels import (  # noqa: PLC0415
            field_forces,
            field_frame,
            field_place,
        )

        check_experiment(experiment)
        refuse_unsupported(_refusals(experiment), producer="a force field")
        self.experiment = experiment
        self._kernels = field_forces, field_place, field_frame
        # Weight and drag of held nodes are forces too, and elements between them count.
        assembly = assemble([_released(experiment)], vectors=vectors, displaced=False, dims=3)
        self._body, unit = assembly.body, assembly.scaler
        none = np.zeros((1, experiment.geometry.n_nodes))
        self._drives = drive_table(
            [experiment],
            assembly.packing,
            unit,
            nodal=(none, none, np.zeros((*none.shape, 3))),
            origin=np.zeros((*none.shape, 3)),
            optional=True,
        )
        rates = np.zeros(ledger_size(with_bends=len(experiment.geometry.bends) > 0))
        flat = assembly.state.x
        self._work = (*(aligned_zeros_like(flat) for _ in range(3)), rates)
        self._scale = unit.length, unit.velocity, unit.force, unit.moment / unit.time
        self._output = unit.output
        self._time, self._step = unit.time, _short_step(experiment) / unit.time
        self._energy = np.zeros(ENERGY_ROWS * LEDGER_STRIDE)
        self._shape = experiment.geometry.n_nodes, 3
        self.power: Reals = np.zeros(len(rates) // LEDGER_STRIDE)
        used = dict.fromkeys(actuator.signal for actuator in experiment.actuators)
        self._signals = tuple(experiment.signals[name] for name in used)

    @property
    def needs_velocities(self) -> bool:
        """Whether forces, or the work that is done, depend on velocities."""
        geometry, experiment = self.experiment.geometry, self.experiment
        dashpots = (
            geometry.bars.damping,
            geometry.bars.damping_cubic,
            geometry.hinges.damping,
            geometry.bends.damping,
        )
        damped = experiment.damping != 0.0 or any(values.any() for values in dashpots)
        return damped or bool(experiment.actuators)

    def may_jump(self, time: float) -> bool:
        """Whether a signal has a sample at `time`, so that forces before and after it differ."""
        for signal in self._signals:
            number = round(time / signal.dt)
            if abs(time / signal.dt - number) > SAMPLE_SLACK:
                continue
            last = len(signal.values) - 1
            # A spline is smooth up to its last sample, from which on the value stays.
            if number == last or (signal.interpolation != "cubic" and 0 < number <= last + 1):
                return True
        return False

    def __call__(
        self,
        positions: Reals,
        velocities: Reals,
        *,
        time: float = 0.0,
        side: Side = "after",
        out: Reals | None = None,
    ) -> Reals:
        """Return the forces on the nodes: (N, 3) [N].

        Parameters
        ----------
        positions, velocities : (N, 3) [m], [m/s]
            Of all nodes, driven ones included; see `place`.
        time : float [s]
            For force actuators.
        side : {"after", "before"}
            Which value counts where a signal jumps at `time`.
        out : (N, 3), optional
            Where the forces are written to; nothing is allocated then.

        Raises
        ------
        ConfigError
            When an array has another shape.
        """
        if out is None:
            out = np.empty(self._shape)
        self._kernels[0](
            self._body,
            self._work,
            self._nodal(positions, "positions"),
            self._nodal(velocities, "velocities"),
            self._clock(time, side),
            self._scale,
            self._written(out, "out"),
            self.power,
        )
        return out

    def place(
        self, positions: Reals, velocities: Reals, *, time: float = 0.0, side: Side = "after"
    ) -> None:
        """Put driven coordinates where their signals say at `time`, in place.

        Parameters
        ----------
        positions, velocities : (N, 3) [m], [m/s]
            C-contiguous double precision; coordinates that are not driven are left alone.
        """
        if self._drives is None or not self._drives.motion_at.size:
            return
        self._kernels[1](
            self._drives,
            self._body.stride,
            self._work,
            self._written(positions, "positions"),
            self._written(velocities, "velocities"),
            self._clock(time, side),
            self._scale,
        )

    def frames(self, count: int) -> FrameBuffer:
        """Return a buffer for `count` frames."""
        geometry = self.experiment.geometry
        return FrameBuffer.for_frames(
            count,
            n_nodes=geometry.n_nodes,
            dims=3,
            n_bars=len(geometry.bars),
            n_hinges=len(geometry.hinges),
            n_bends=len(geometry.bends),
        )

    def observe(
        self, positions: Reals, velocities: Reals, *, buffer: FrameBuffer, row: int = 0
    ) -> None:
        """Fill a row of a frame buffer: state, lengths, angles, tensions, torques, energies.

        The ledger of work and losses is an integral over time, and stays 0.
        """
        self._kernels[2](
            self._body,
            self._work,
            self._energy,
            self._nodal(positions, "positions"),
            self._nodal(velocities, "velocities"),
            self._scale[:2],
            self._output,
            row,
            buffer,
        )

    def energies(self, positions: Reals, velocities: Reals) -> Reals:
        """Return energies: kinetic, of bars, of hinges, of weight, and of bends if any [J]."""
        buffer = self.frames(1)
        self.observe(positions, velocities, buffer=buffer)
        energies: Reals = buffer.energy[0]
        return energies

    # --- inside ---------------------------------------------------------------------------------

    def _clock(self, time: float, side: Side) -> tuple[float, float, float]:
        t, h = time / self._time, self._step
        return (t, t, t + h) if side == "after" else (t, t - h, t)

    def _nodal(self, values: Reals, name: str) -> Reals:
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.shape != self._shape:
            raise ConfigError(
                f"an array of shape {array.shape}", expected=f"{self._shape}", key=name
            )
        return array

    def _written(self, values: Reals, name: str) -> Reals:
        if self._nodal(values, name) is not values:
            raise ConfigError(
                f"{type(values).__name__} that is no contiguous array of double precision",
                expected="one, since it is written to",
                fix="pass numpy.zeros((n_nodes, 3))",
                key=name,
            )
        return values


def _short_step(experiment: Experiment) -> float:
    """Return `dt`, or where an accuracy is to choose it a time that is short for any signal."""
    if experiment.dt_stated:
        return experiment.dt
    used = [experiment.signals[actuator.signal].dt for actuator in experiment.actuators]
    return 1e-3 * min([experiment.save_interval, *used])


def _released(experiment: Experiment) -> Experiment:
    """Return the experiment with every node free, for an integrator without demands."""
    geometry = experiment.geometry
    return replace(
        experiment,
        geometry=replace(geometry, fixed=np.zeros_like(geometry.fixed)),
        actuators=tuple(a for a in experiment.actuators if a.type == "force"),
        integrator="verlet",
        precision="float64",
        step_check="warn",
    )


def _refusals(experiment: Experiment) -> list[Finding]:
    findings = supports(_released(experiment))
    if experiment.collision.enabled and experiment.geometry.collidable.any():
        findings.append(
            Finding(
                code="DEM-FIELD-CONTACT",
                level="error",
                path="physics.enable_collision",
                found="contact, which acts by impacts and not by forces",
                expected="a body without contact",
                fix="set enable_collision to false",
            )
        )
    return findings
