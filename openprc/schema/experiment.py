"""What an experiment folder says, parsed once into frozen records.

`load_experiment` reads ``input/{geometry.h5, signals.h5, config.json}`` in the layout of this
package or in the older one, converts to SI and checks everything; every producer is handed
the same `Experiment`. Files are handled in `openprc.schema.experiment_files`, checks in
`openprc.schema.experiment_checks`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from openprc.schema.geometry import (
    Geometry,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

Interpolation = Literal["linear", "hold", "cubic"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
BarDamping = Literal["axial", "printed"]
BAR_DAMPINGS: tuple[BarDamping, ...] = get_args(BarDamping)
Precision = Literal["float64", "float32"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
StepCheck = Literal["refuse", "warn"]
STEP_CHECKS: tuple[StepCheck, ...] = get_args(StepCheck)
ActuatorType = Literal["position", "force", "velocity"]
ACTUATOR_TYPES: tuple[ActuatorType, ...] = get_args(ActuatorType)
#: The SI unit that the values of a signal have, by what they do.
ACTUATOR_UNITS: Mapping[str, str] = MappingProxyType(
    {"position": "m", "force": "N", "velocity": "m/s"}
)
#: The integrator of an experiment whose `accuracy` chooses one.
AUTO = "auto"
DEFAULT_INTEGRATOR = "rk4"
#: Relative slack between decimal numbers that are meant to be multiples of each other.
MULTIPLE_TOLERANCE = 1e-9


def whole_multiple(total: float, part: float) -> int | None:
    """Return how many times `part` goes into `total`, or None when it is not a whole number.

    Truncation would lose a step for hundreds of ordinary decimal pairs (``0.3 / 0.1`` is
    2.9999...), so the ratio is rounded and the rounding is checked.
    """
    ratio = total / part
    if not math.isfinite(ratio):
        return None
    count = round(ratio)
    return count if abs(ratio - count) <= MULTIPLE_TOLERANCE * max(count, 1) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """A named time series that begins at t = 0.

    Parameters
    ----------
    name : str
    values : (T_u,) or (T_u, d) [unit]
        d is 1 (drives every enabled axis) or 3 (x, y, z).
    dt : float [s]
        Time between samples.
    interpolation : {"linear", "hold", "cubic"}
        Between samples. "hold" keeps each sample for `dt`; "cubic" is the C2 spline.
        After the last sample its value stays.
    unit : str, optional
        SI unit of the values; None leaves it to what the signal drives.
    sequence : (K, C), optional
        The symbols that the values were made from, which tasks with delays work on; for a
        held signal these are its values.
    hold : float [s], optional
        How long a symbol lasts; symbol k begins at ``k * hold``.
    """

    name: str
    values: NDArray[np.float64]
    dt: float
    interpolation: Interpolation = "linear"
    unit: str | None = None
    sequence: NDArray[np.float64] | None = None
    hold: float | None = None

    def __post_init__(self) -> None:
        if self.interpolation == "hold" and self.sequence is None:
            object.__setattr__(self, "sequence", self.values)
            object.__setattr__(self, "hold", self.dt)
        for name in ("values", "sequence"):
            if getattr(self, name) is not None:
                array = np.array(getattr(self, name), dtype="f8")
                array = array.reshape(-1, 1) if array.ndim == 1 else array
                array.flags.writeable = False
                object.__setattr__(self, name, array)

    @property
    def duration(self) -> float:
        """How long the samples last [s]: every symbol when held, else up to the last one."""
        samples = len(self.values) - (self.interpolation != "hold")
        return samples * self.dt


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """A signal that drives one node along the enabled axes.

    "position" prescribes absolute coordinates [m], "force" adds a force [N] (several on a
    node add up), "velocity" prescribes velocities [m/s].
    """

    node: int
    signal: str
    type: ActuatorType = "position"
    axes: tuple[bool, bool, bool] = (True, True, True)


@dataclass(frozen=True, kw_only=True)
class Collision:
    """Contact of nodes marked collidable; None where the file does not say.

    Parameters
    ----------
    enabled : bool
        Collidable nodes touch when they are closer than two radii.
    radius : float [m], optional
        Of a node; also the distance that nodes keep from faces.
    restitution : float in [0, 1], optional
        Ratio of the normal speeds after and before an impact; 1 unless given.
    iterations : int, optional
        Sweeps over the contacts in one step.
    friction : float, optional
        Coulomb's coefficient; 0 unless given.
    faces : bool
        Collidable nodes also touch the faces that they are not part of.
    """

    enabled: bool = False
    radius: float | None = None
    restitution: float | None = None
    iterations: int | None = None
    friction: float | None = None
    faces: bool = False


@dataclass(frozen=True, kw_only=True)
class Stored:
    """What a run leaves in its file; positions, inputs and energies are always there.

    Parameters
    ----------
    precision : {"float64", "float32"}
        Of positions, velocities and quantities of elements.
    velocities, elements : bool
        Whether velocities, and quantities of elements, are stored.
    """

    precision: Precision = "float64"
    velocities: bool = True
    elements: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """A body, what drives it, and how long to watch.

    Parameters
    ----------
    geometry : Geometry
    signals : mapping of str to Signal
    actuators : tuple of Actuator
    duration, dt, save_interval : float [s]
        Frames are at ``i * save_interval`` for i = 0 ... n_frames - 1; the integrator takes
        `steps_per_frame` steps between two of them.
    integrator : str
        "auto" where `accuracy` chooses it.
    gravity : (x, y, z) [m/s2]
    damping : float
        Node i feels the drag ``-c_i v_i`` with ``c_i = damping * m_i / mean(m)`` [kg/s], the
        mean over nodes with mass. (The older files mean the same.)
    bar_damping : {"axial", "printed"}
        "axial": the dashpot of a bar acts on the rate of its length. "printed": the law as the
        OpenPRC paper prints it, ``-2 zeta sqrt(m_i k) (v_i - v_j)`` on node i with the whole
        relative velocity, zeta being the bar's `damping`; it slows rigid rotation, and with
        unequal masses it does not conserve momentum.
    collision : Collision
    accuracy : float in (0, 1), optional
        Largest error over the frames that the run may have: the rms error of the positions over
        the rms displacement. Producers that can do so choose the integrator, unless one is
        named, and the step for it.
    dt_stated : bool
        Whether `dt` is meant; where it is not, `accuracy` chooses it.
    tolerance : float, optional
        Relative error per step of integrators that choose their step; 1e-6 unless given.
    constraint_tolerance : float, optional
        Largest violation of a rigid element, relative to its length (or in rad), after a
        projection; 1e-13 unless given.
    precision : {"float64", "float32"}
        Of the state in the integrator.
    step_check : {"refuse", "warn"}
        What happens when `dt` is above the stability limit that is estimated before the run:
        nothing is run, or it runs with a remark.
    stored : Stored
        What a run leaves in its file.
    overwrite : bool
        A new run may replace the finished result of an earlier one.
    path : Path, optional
        The experiment folder.
    sources : tuple of Path
        The files that were read.
    layout : {"1.0", "legacy"}
    notes : tuple of str
        What had to be decided while reading.
    """

    geometry: Geometry
    duration: float
    dt: float
    save_interval: float
    signals: Mapping[str, Signal] = field(default_factory=dict)
    actuators: tuple[Actuator, ...] = ()
    integrator: str = DEFAULT_INTEGRATOR
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    damping: float = 0.0
    bar_damping: BarDamping = "axial"
    collision: Collision = field(default_factory=Collision)
    accuracy: float | None = None
    dt_stated: bool = True
    tolerance: float | None = None
    constraint_tolerance: float | None = None
    precision: Precision = "float64"
    stored: Stored = field(default_factory=lambda: Stored())
    step_check: StepCheck = "refuse"
    overwrite: bool = False
    path: Path | None = None
    sources: tuple[Path, ...] = ()
    layout: Literal["1.0", "legacy"] = "1.0"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "signals", dict(self.signals))

    @property
    def n_frames(self) -> int:
        """Number of saved frames, t = 0 included."""
        return round(self.duration / self.save_interval) + 1

    @property
    def steps_per_frame(self) -> int:
        """Number of integrator steps between two frames."""
        return round(self.save_interval / self.dt)

    @property
    def frame_times(self) -> NDArray[np.float64]:
        """Times of the frames: (n_frames,) [s]."""
        return np.arange(self.n_frames, dtype=np.float64) * self.save_interval

    def driven_axes(self, kind: ActuatorType) -> NDArray[np.bool_]:
        """Return where an actuator of that type acts: (N, 3) bool."""
        mask = np.zeros((self.geometry.n_nodes, 3), dtype=bool)
        for actuator in self.actuators:
            if actuator.type == kind:
                mask[actuator.node] |= np.array(actuator.axes)
        return mask

    @property
    def held_axes(self) -> NDArray[np.bool_]:
        """Where a coordinate is fixed or its motion prescribed: (N, 3) bool."""
        driven = self.driven_axes("position") | self.driven_axes("velocity")
        return driven | self.geometry.fixed[:, np.newaxis]

    @property
    def drag(self) -> NDArray[np.float64]:
        """Coefficients ``damping * m_i / mean(m)``, the mean over nodes with mass: (N,) [kg/s]."""
        masses = self.geometry.masses
        massive = masses > 0
        if not massive.any():
            return np.zeros(len(masses))
        drag: NDArray[np.float64] = self.damping * masses / masses[massive].mean()
        return drag

    @property
    def planar(self) -> bool:
        """Whether everything is at z = 0 and nothing pulls, drives or folds out of it."""
        geometry = self.geometry
        if geometry.positions[:, 2].any() or geometry.velocities[:, 2].any():
            return False
        if self.gravity[2] != 0.0 or len(geometry.hinges):
            return False
        for actuator in self.actuators:
            if actuator.axes[2] and self.signals[actuator.signal].values[:, -1].any():
                return False
        return True

    def settings(self) -> dict[str, Any]:
        """Return the configuration as plain data, in the layout of config.json."""
        collision = self.collision
        physics: dict[str, Any] = {
            "gravity": [float(part) for part in self.gravity],
            "damping": float(self.damping),
            "enable_collision": collision.enabled,
        }
        for name in ("radius", "restitution", "iterations", "friction"):
            if getattr(collision, name) is not None:
                physics[f"collision_{name}"] = getattr(collision, name)
        if collision.faces:
            physics["collision_faces"] = True
        if self.bar_damping != "axial":
            physics["bar_damping"] = self.bar_damping
        simulation: dict[str, Any] = {
            "duration": float(self.duration),
            "save_interval": float(self.save_interval),
        }
        if self.dt_stated:
            simulation["dt"] = float(self.dt)
        if self.integrator != AUTO:
            simulation["integrator"] = self.integrator
        for name in ("accuracy", "tolerance", "constraint_tolerance"):
            if getattr(self, name) is not None:
                simulation[name] = float(getattr(self, name))
        if self.precision != "float64":
            simulation["precision"] = self.precision
        if self.step_check != "refuse":
            simulation["step_check"] = self.step_check
        export = {
            column.name: getattr(self.stored, column.name)
            for column in fields(Stored)
            if getattr(self.stored, column.name) != column.default
        }
        return {
            "openprc_config": "1.0",
            "simulation": simulation,
            "physics": physics,
            "actuators": [
                {
                    "node": int(actuator.node),
                    "signal": actuator.signal,
                    "type": actuator.type,
                    "axes": [bool(axis) for axis in actuator.axes],
                }
                for actuator in self.actuators
            ],
            "export": {"overwrite": self.overwrite} | export,
        }


def load_experiment(directory: str | Path) -> Experiment:
    """Read an experiment folder (or its ``input`` folder).

    Raises
    ------
    UnreadableFile, UnsafeFile
        When a file is missing or cannot be read safely.
    ConfigError
        When the content is wrong; every mistake of a file is in one message.
    """
    from openprc.schema.experiment_files import read_experiment  # noqa: PLC0415  circular

    return read_experiment(directory)


def save_experiment(experiment: Experiment, directory: str | Path) -> tuple[Path, ...]:
    """Write ``input/{geometry.h5, signals.h5, config.json}`` below `directory`.

    Only these three files are written; existing ones are replaced, each atomically.

    Returns
    -------
    tuple of Path
        The three files.

    Raises
    ------
    ConfigError
        When the experiment is wrong; nothing is written then.
    """
    from openprc.schema.experiment_files import write_experiment  # noqa: PLC0415  circular

    return write_experiment(experiment, directory)
