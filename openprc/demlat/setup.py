"""`SimulationSetup`: build an experiment in Python and save its input files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, SupportsIndex

import numpy as np

from openprc.demlat.drive import Drive
from openprc.demlat.geometry_builder import GeometryBuilder, number
from openprc.demlat.planning.step_choice import with_chosen_step
from openprc.errors import ConfigError, ResultExists
from openprc.schema.experiment import (
    AUTO,
    DEFAULT_INTEGRATOR,
    Actuator,
    ActuatorType,
    BarDamping,
    Collision,
    Experiment,
    Interpolation,
    Precision,
    Signal,
    StepCheck,
    Stored,
    load_experiment,
    save_experiment,
)
from openprc.schema.experiment_files import NAMES

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class SimulationSetup(GeometryBuilder):
    """Collects nodes, elements, signals and settings; `save` checks and writes them.

    Nothing is written or removed before `save`, and `save` touches only
    ``input/{geometry.h5, signals.h5, config.json}``.

    Parameters
    ----------
    directory : path-like
        The experiment folder.
    overwrite : bool
        False: an experiment that is already there is loaded, to be extended and saved again.
        True: begin with nothing; `save` replaces the input files, and the engine may replace
        the result of an earlier run.

    Examples
    --------
    >>> from openprc.demlat import SimulationSetup
    >>> setup = SimulationSetup("pendulum", overwrite=True)
    >>> pivot = setup.add_node([0.0, 0.0, 0.0], fixed=True)
    >>> bob = setup.add_node([1.0, 0.0, 0.0], mass=0.1)
    >>> bar = setup.add_bar(pivot, bob, stiffness=1e3)
    >>> setup.set_physics(gravity=-9.81)
    >>> setup.set_simulation_params(duration=1.0, dt=1e-3, save_interval=0.01)
    >>> paths = setup.save()
    """

    def __init__(self, directory: str | Path, *, overwrite: bool = False) -> None:
        self.directory = Path(directory)
        self.overwrite = overwrite
        super().__init__()
        self._signals: dict[str, Signal] = {}
        self._actuators: list[Actuator] = []
        self._times: dict[str, Any] = {}
        self._physics: dict[str, Any] = {}
        self._stored = Stored()
        self._legacy = False
        present = [self.directory / "input" / name for name in NAMES]
        if not overwrite and (present[0].exists() or present[2].exists()):
            self._take(load_experiment(self.directory))

    # --- drive ------------------------------------------------------------------------------

    def add_signal(
        self,
        name: str,
        data: ArrayLike | Drive,
        *,
        dt: float | None = None,
        interpolation: Interpolation | None = None,
        unit: str | None = None,
    ) -> None:
        """Add a named signal; each has its own time step.

        Parameters
        ----------
        name : str
        data : (T_u,), (T_u, 1) or (T_u, 3), or Drive
            One column drives every enabled axis, three drive x, y and z. A `Drive` of
            `openprc.demlat.signals` brings its time step, interpolation and symbols.
        dt : float [s]
            Time between samples; sample k is at ``k * dt``.
        interpolation : {"linear", "hold", "cubic"}, default "linear"
            "hold" keeps each value for `dt` (symbols); "cubic" is the C2 spline.
        unit : str, optional
            "m", "N" or "m/s"; by default what the actuators need.
        """
        if name in self._signals:
            raise ConfigError(
                f"a second signal named {name!r}", expected="unique names", key=f"signals/{name}"
            )
        if isinstance(data, Drive):
            if dt is not None or interpolation is not None:
                raise ConfigError(
                    "a Drive together with dt or interpolation",
                    expected="the Drive alone: it brings its own",
                    key=f"signals/{name}",
                )
            drive = data
        elif dt is None:
            raise ConfigError("no dt", expected="the time between samples", key=f"signals/{name}")
        else:
            try:
                drive = Drive(
                    values=np.asarray(data, dtype="f8"),
                    dt=number(dt, "dt"),
                    interpolation=interpolation or "linear",
                )
            except ConfigError as error:
                # A drive does not know its name; the reader needs it.
                raise ConfigError(
                    error.found, expected=error.expected, fix=error.fix, key=f"signals/{name}"
                ) from None
        self._signals[name] = Signal(
            name=name,
            values=drive.values,
            dt=drive.dt,
            interpolation=drive.interpolation,
            unit=unit,
            sequence=drive.sequence,
            hold=drive.hold,
        )

    def add_actuator(
        self,
        node: SupportsIndex,
        signal: str,
        *,
        type: ActuatorType = "position",
        dof: Iterable[Any] | None = None,
        axes: Iterable[Any] | None = None,
    ) -> None:
        """Let a signal drive a node.

        Parameters
        ----------
        node : int
        signal : str
            Name of a signal, which may be added later.
        type : {"position", "force", "velocity"}
            "position" prescribes absolute coordinates.
        axes : three switches, optional
            Which of x, y, z are driven; all unless given. `dof` is another name for it.
        """
        if axes is not None and dof is not None:
            raise ConfigError("both axes and dof", expected="one of them", key="axes")
        given = dof if axes is None else axes
        chosen = [1, 1, 1] if given is None else list(given)
        if len(chosen) != 3 or any(axis not in (0, 1) for axis in chosen):
            raise ConfigError(f"axes {chosen}", expected="three switches, for x, y, z", key="axes")
        x, y, z = (bool(axis) for axis in chosen)
        self._actuators.append(
            Actuator(node=self.node_index(node), signal=signal, type=type, axes=(x, y, z))
        )

    # --- settings ---------------------------------------------------------------------------

    def set_simulation_params(
        self,
        *,
        duration: float,
        dt: float | Literal["auto"] | None = None,
        save_interval: float,
        integrator: str | None = None,
        accuracy: float | None = None,
        tolerance: float | None = None,
        constraint_tolerance: float | None = None,
        precision: Precision = "float64",
        step_check: StepCheck = "refuse",
    ) -> None:
        """Set times and the scheme.

        Parameters
        ----------
        duration : float [s]
            A multiple of `save_interval`.
        dt : float [s] or "auto"
            Time step, of which `save_interval` is a multiple; only an `accuracy` can do without.
            "auto" is the largest one that is not above `StepLimit.recommended` of
            `openprc.demlat.planning.stability`; it is chosen when the experiment is made or
            saved, and said in its `notes`.
        save_interval : float [s]
        integrator : str
            A name from `openprc.demlat.integrators.INTEGRATORS`; "rk4" by default, and with an
            `accuracy` what a pilot finds the cheapest.
        accuracy : float in (0, 1), optional
            Largest rms error of the positions over their rms displacement that the run may have:
            a run chooses integrator and step for it, and notes which and why.
        tolerance : float, optional
            Relative error per step of integrators that choose their step.
        constraint_tolerance : float, optional
            Largest relative violation of rigid elements.
        precision : {"float64", "float32"}
        step_check : {"refuse", "warn"}
            What happens when `dt` is above the stability limit.
        """
        if dt is None and accuracy is None:
            raise ConfigError(
                "no dt", expected="a time step in s, 'auto', or an accuracy", key="dt"
            )
        if isinstance(dt, str) and dt != "auto":
            raise ConfigError(f"dt = {dt!r}", expected="a time in s, or 'auto'", key="dt")
        self._times = {
            "duration": number(duration, "duration"),
            "dt": dt if dt is None or isinstance(dt, str) else number(dt, "dt"),
            "save_interval": number(save_interval, "save_interval"),
            "integrator": integrator or (DEFAULT_INTEGRATOR if accuracy is None else AUTO),
            "accuracy": None if accuracy is None else number(accuracy, "accuracy"),
            "tolerance": None if tolerance is None else number(tolerance, "tolerance"),
            "constraint_tolerance": None
            if constraint_tolerance is None
            else number(constraint_tolerance, "constraint_tolerance"),
            "precision": precision,
            "step_check": step_check,
        }

    def set_physics(
        self,
        *,
        gravity: ArrayLike = 0.0,
        damping: float = 0.0,
        enable_collision: bool = False,
        collision_radius: float | None = None,
        collision_restitution: float | None = None,
        collision_iterations: int | None = None,
        collision_friction: float | None = None,
        collision_faces: bool = False,
        bar_damping: BarDamping = "axial",
    ) -> None:
        """Set what acts on every node.

        Parameters
        ----------
        gravity : float or (3,) [m/s2]
            A number is the acceleration along z: -9.81 is down.
        damping : float
            Node i feels ``-c_i v_i`` with ``c_i = damping * m_i / mean(m)`` [kg/s].
        enable_collision : bool
            Nodes marked collidable repel each other.
        collision_radius : float [m], optional
        collision_restitution : float in [0, 1], optional
        collision_iterations : int, optional
        collision_friction : float, optional
            Coulomb's coefficient.
        collision_faces : bool
            Collidable nodes also touch faces.
        bar_damping : {"axial", "printed"}
            See `openprc.schema.experiment.Experiment`.
        """
        vector = np.asarray(gravity, dtype="f8")
        if vector.shape not in ((), (3,)):
            raise ConfigError(
                f"gravity of shape {vector.shape}", expected="a number or (3,)", key="gravity"
            )
        x, y, z = (0.0, 0.0, float(vector)) if vector.ndim == 0 else map(float, vector)
        self._physics = {
            "gravity": (x, y, z),
            "damping": number(damping, "damping"),
            "collision": Collision(
                enabled=bool(enable_collision),
                radius=collision_radius,
                restitution=collision_restitution,
                iterations=collision_iterations,
                friction=collision_friction,
                faces=bool(collision_faces),
            ),
            "bar_damping": bar_damping,
        }

    def set_export(
        self,
        *,
        precision: Precision = "float64",
        velocities: bool = True,
        elements: bool = True,
    ) -> None:
        """Set what a run stores beside positions, inputs and energies.

        Parameters
        ----------
        precision : {"float64", "float32"}
            Of what is stored about nodes and elements; float32 halves the file.
        velocities : bool
        elements : bool
            Lengths, strains and forces of bars, angles and torques of hinges.
        """
        self._stored = Stored(
            precision=precision, velocities=bool(velocities), elements=bool(elements)
        )

    # --- result -----------------------------------------------------------------------------

    def experiment(self) -> Experiment:
        """Return what has been collected, unchecked unless a time step has to be chosen.

        Raises
        ------
        ConfigError
            When `set_simulation_params` was not called, or when dt is "auto" and something is
            wrong.
        """
        if not self._times:
            raise ConfigError(
                "no duration, dt and save_interval",
                expected="settings for the simulation",
                fix="call set_simulation_params()",
                file=self.directory,
            )
        stated = isinstance(self._times["dt"], float)
        chosen = not stated and self._times["accuracy"] is None
        experiment = Experiment(
            geometry=self.geometry(),
            signals=self._signals,
            actuators=tuple(self._actuators),
            stored=self._stored,
            overwrite=self.overwrite,
            path=self.directory,
            **self._times
            | ({} if stated else {"dt": self._times["save_interval"]})
            | {"dt_stated": stated or chosen},
            **self._physics,
        )
        return with_chosen_step(experiment) if chosen else experiment

    def save(self, directory: str | Path | None = None) -> tuple[Path, ...]:
        """Check everything and write the three input files.

        Parameters
        ----------
        directory : path-like, optional
            Another experiment folder than the one given at the start.

        Raises
        ------
        ConfigError
            When something is wrong; nothing is written then.
        ResultExists
            When the files that were loaded have the older layout: they are not rewritten.
        """
        target = self.directory if directory is None else Path(directory)
        if self._legacy and target.resolve() == self.directory.resolve():
            raise ResultExists(
                "the input files have the older layout, and saving would convert them",
                expected="another folder",
                fix="call save(folder) with a new folder",
                file=target,
            )
        return save_experiment(replace(self.experiment(), path=target), target)

    # --- bookkeeping ------------------------------------------------------------------------

    def _take(self, experiment: Experiment) -> None:
        self.take_geometry(experiment.geometry)
        self._signals = dict(experiment.signals)
        self._actuators = list(experiment.actuators)
        self._times = {
            name: getattr(experiment, name)
            for name in (
                *("duration", "dt", "save_interval", "integrator", "accuracy"),
                *("tolerance", "constraint_tolerance", "precision", "step_check"),
            )
        }
        if not experiment.dt_stated:
            self._times["dt"] = None
        self._physics = {
            name: getattr(experiment, name)
            for name in ("gravity", "damping", "collision", "bar_damping")
        }
        self._stored = experiment.stored
        self.overwrite = experiment.overwrite
        self._legacy = experiment.layout == "legacy"
