"""What a quasi-static run controls: read from the actuators of an experiment and the options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.signal_table import sample_signal
from openprc.errors import ConfigError
from openprc_merlin.displacement_control import Station
from openprc_merlin.equilibrium_path import PathSettings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment

    Floats = NDArray[np.float64]

Control = Literal["arc-length", "displacement", "load"]
#: Iterations before a step is halved, unless the option says otherwise. Along an arc a shorter
#: step is cheaper than many iterations; an imposed jump has to be reached somehow.
ARC_ITERATIONS, STATION_ITERATIONS = 15, 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Drives:
    """What the actuators of an experiment impose at its frames.

    Attributes
    ----------
    held : (N, 3) bool
        Axes that are fixed or driven; a planar scene stays in its plane.
    stations : tuple of Station
        One a frame.
    moves, pushes : bool
        Whether a driven position changes, and whether there is a force at any frame.
    """

    held: NDArray[np.bool_]
    stations: tuple[Station, ...]
    moves: bool
    pushes: bool

    @property
    def reference(self) -> Floats:
        """The forces at the last frame, which a load factor multiplies: (N, 3) [N]."""
        return self.stations[-1].loads

    @property
    def largest_loads(self) -> Floats:
        """The forces of the frame at which they are largest: (N, 3) [N]."""
        return max(self.stations, key=lambda station: float(np.abs(station.loads).sum())).loads


def read_drives(experiment: Experiment) -> Drives:
    """Sample the signals of the actuators at the times of the frames."""
    times = experiment.frame_times
    rest = experiment.geometry.positions
    positions = np.repeat(rest[np.newaxis], len(times), axis=0)
    loads = np.zeros_like(positions)
    for actuator in experiment.actuators:
        axes = np.array(actuator.axes)
        values = sample_signal(experiment.signals[actuator.signal], times)
        values = np.broadcast_to(values, (len(times), 3))[:, axes]
        if actuator.type == "position":
            positions[:, actuator.node, axes] = values
        elif actuator.type == "force":
            loads[:, actuator.node, axes] += values
    held = experiment.held_axes.copy()
    if experiment.planar:
        held[:, 2] = True
    loads[:, held] = 0.0
    return Drives(
        held=held,
        stations=tuple(
            Station(positions=x, loads=f) for x, f in zip(positions, loads, strict=True)
        ),
        moves=bool(np.ptp(positions, axis=0).any()),
        pushes=bool(loads.any()),
    )


@dataclass(frozen=True, kw_only=True)
class Course:
    """How a run goes, every choice made.

    Attributes
    ----------
    control : {"arc-length", "displacement", "load"}
    increments : int
    first_factor : float [1]
        Load factor that the first increment along an arc aims at.
    arc_length : float or None [m]
        Length of that increment instead.
    max_load, max_displacement : float
        Where the path ends early, [1] and [m]; infinity for nowhere.
    unstable : {"follow", "settle", "stop"}
    settings : PathSettings
    """

    control: Control
    increments: int
    first_factor: float
    arc_length: float | None
    max_load: float
    max_displacement: float
    unstable: Literal["follow", "settle", "stop"]
    settings: PathSettings


def choose_course(experiment: Experiment, drives: Drives, options: Mapping[str, Any]) -> Course:
    """Resolve the options of a run against what drives the experiment.

    Raises
    ------
    ConfigError
        When an option does not fit the experiment or another option.
    """
    control = _control(drives, str(options["control"]))
    frames = experiment.n_frames
    if frames < 2:
        raise _wrong(
            "increments",
            f"an experiment of {frames} frame",
            "at least two: the body at rest and one increment",
            "give it a duration of at least one save_interval",
        )
    along = control == "arc-length"
    for name in ("increments", "initial-load-factor", "arc-length", "max-load"):
        if not along and options[name] is not None:
            raise _wrong(
                name,
                f"{name}={options[name]} with control={control}",
                "the option only along an arc; here the signals say what every frame is at",
                "leave it out, or give control=arc-length",
            )
    if along and options["unstable"] == "settle":
        raise _wrong(
            "unstable",
            "unstable=settle along an arc",
            "follow or stop: a path through limit points is a path through unstable states",
            "give control=load, whose body snaps where the load cannot be carried",
        )
    if options["arc-length"] is not None and options["initial-load-factor"] is not None:
        raise _wrong(
            "arc-length",
            "both arc-length and initial-load-factor",
            "one of them: each says how long the first increment is",
            "leave one out",
        )
    increments = frames - 1 if options["increments"] is None else options["increments"]
    for name, value in (
        ("increments", increments),
        *((name, options[name]) for name in _POSITIVE if options[name] is not None),
    ):
        if not value > 0:
            raise _wrong(
                name, f"{name}={value}", "a number above 0", "give one, or leave the option out"
            )
    allowed = options["max-iterations"] or (ARC_ITERATIONS if along else STATION_ITERATIONS)
    far = options["max-displacement"]
    return Course(
        control=control,
        increments=increments,
        first_factor=_first_factor(drives, options["initial-load-factor"]),
        arc_length=options["arc-length"],
        max_load=np.inf if options["max-load"] is None else options["max-load"],
        max_displacement=np.inf if far is None else far,
        unstable=options["unstable"],
        settings=PathSettings(
            tolerance=options["tolerance"],
            max_iterations=max(allowed, 2),
            least_step=options["min-step"],
        ),
    )


_POSITIVE = (
    *("arc-length", "max-load", "max-displacement", "max-iterations", "tolerance", "min-step"),
)


def _control(drives: Drives, wanted: str) -> Control:
    if wanted == "auto":
        if drives.moves:
            return "displacement"
        return "load" if drives.pushes and not drives.reference.any() else "arc-length"
    if wanted == "arc-length" and drives.moves:
        raise _wrong(
            "control",
            "control=arc-length, and position actuators that move",
            "forces alone: along an arc the load factor is what is sought",
            "give control=displacement, or hold these positions",
        )
    if wanted == "arc-length" and not drives.reference.any():
        raise _wrong(
            "control",
            "control=arc-length without a force at the end of the run on an axis that can move",
            "force actuators: their values at the last frame are the reference load",
            "add one, or give control=displacement",
        )
    if wanted == "displacement" and not drives.moves:
        raise _wrong(
            "control",
            "control=displacement without a position actuator that moves",
            "a position signal that changes",
            "add one, or give control=arc-length",
        )
    if wanted == "load" and not drives.pushes:
        raise _wrong(
            "control",
            "control=load without a force on an axis that can move",
            "a force actuator",
            "add one, or give control=displacement",
        )
    control: Control = wanted  # type: ignore[assignment]
    return control


def _first_factor(drives: Drives, given: float | None) -> float:
    """Return the option, else what the force signals are at after the first increment."""
    if given is not None:
        return given
    reference = drives.reference
    square = float((reference * reference).sum())
    share = float((drives.stations[1].loads * reference).sum()) / square if square else 0.0
    return share if share != 0.0 else 1.0 / (len(drives.stations) - 1)


def _wrong(key: str, found: str, expected: str, fix: str) -> ConfigError:
    return ConfigError(found, expected=expected, fix=fix, key=key)
