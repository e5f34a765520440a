"""A quasi-static run, ready to be written as a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.schema import UNITS, TrajectoryWriter
from openprc_merlin import extension, geometry
from openprc_merlin.histories import is_load

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Static = tuple[Any, str | None]
#: Numbers held by the largest intermediate array of one block of frames.
_BLOCK = 1 << 21


def codes(values: Any) -> Static:
    """Return codes as a constant of the type that the file contract asks for."""
    return np.asarray(values, dtype=np.int32), None


@dataclass(frozen=True)
class Units:
    """Units of length and force, "arb" where the user did not say.

    MERLIN stores none. Stiffness and area come out in SI units when both are known.
    """

    length: str = "arb"
    force: str = "arb"

    def stiffness(self, values: Floats) -> Static:
        """Return force per length, (E,) [N/m] or arbitrary."""
        if "arb" in (self.length, self.force):
            return values, "arb"
        return values * (UNITS[self.force].si_factor / UNITS[self.length].si_factor), "N/m"

    def rotational(self, values: Floats) -> Static:
        """Return moment per radian, (E,) [N*m/rad] or arbitrary."""
        if "arb" in (self.length, self.force):
            return values, "arb"
        factor = UNITS[self.force].si_factor * UNITS[self.length].si_factor
        return values * factor, "N*m/rad"

    def area(self, values: Floats) -> Static:
        """Return areas, (E,) [m2] or arbitrary."""
        if self.length == "arb":
            return values, "arb"
        return values * UNITS[self.length].si_factor ** 2, "m2"


@dataclass(frozen=True)
class Signal:
    """Columns on the clock of the run: an input, or a measured channel when `is_input` is off."""

    name: str
    columns: tuple[str, ...]
    values: Floats
    quantity: str
    unit: str
    targets: tuple[str, ...] = ()
    is_input: bool = True


@dataclass(frozen=True)
class Displaced:
    """Positions that are added up when they are asked for: a run may fill half of the memory.

    Attributes
    ----------
    nodes : (N, 3) what displacements count from
    start : (N, 3) displacement of frame 0
    displacements : (T - 1, N, 3) of the frames after it
    """

    nodes: Floats
    start: Floats
    displacements: Floats

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return (T, N, 3)."""
        return (len(self.displacements) + 1, *self.nodes.shape)

    def __getitem__(self, frames: slice) -> Floats:
        """Return the positions of a block of frames."""
        first, stop, _ = frames.indices(self.shape[0])
        if first > 0:
            return self.nodes + self.displacements[first - 1 : stop - 1]
        positions = np.empty((stop, *self.nodes.shape))
        np.add(self.nodes, self.start, out=positions[0])
        np.add(self.nodes, self.displacements[: stop - 1], out=positions[1:])
        return positions


@dataclass(frozen=True)
class Run:
    """Everything of a run that the file contract has a place for.

    Attributes
    ----------
    positions : (T, N, 3), frame 0 the initial state
    increments : (T,) int, increment number of every frame
    rest : (N, 3) or None
    held : (N, 3) bool or None, supported degrees of freedom
    bars, hinges, faces : (E, k) int or None
    bar_rest : (M,) rest lengths or None
    bar_static, hinge_static : further constants with their units
    extras : arrays for the extension, with unit and comment
    """

    positions: Floats | Displaced
    increments: Ints
    units: Units
    rest: Floats | None = None
    held: NDArray[np.bool_] | None = None
    bars: Ints | None = None
    bar_rest: Floats | None = None
    bar_static: Mapping[str, Static] = field(default_factory=dict)
    hinges: Ints | None = None
    hinge_static: Mapping[str, Static] = field(default_factory=dict)
    faces: Ints | None = None
    signals: tuple[Signal, ...] = ()
    extras: Mapping[str, tuple[Any, str, str]] = field(default_factory=dict)


def clock(
    increments: Ints,
    *,
    dt: float | None,
    time: str,
    variables: Mapping[str, Any],
    file: Path,
) -> tuple[Floats, str, str]:
    """Return the instants, their unit, and ``"pseudo"`` or ``"physical"``.

    Parameters
    ----------
    increments : (T,) increment number of every frame
    dt : seconds per increment, or None
    time : ``"increment"``, or the name of a variable with T instants [s]
    variables : where `time` is looked up

    Raises
    ------
    ConfigError
        When `dt` is not positive, both are given, the variable does not fit, or the load
        history is asked to be the time.
    """

    def wrong(found: str, expected: str, fix: str, key: str) -> ConfigError:
        return ConfigError(found, expected=expected, fix=fix, file=file, key=key)

    if time == "increment":
        if dt is None:
            return increments.astype(np.float64), "1", "pseudo"
        if not (np.isfinite(dt) and dt > 0):
            raise wrong(f"dt = {dt}", "seconds per increment, above 0", "correct the option", "dt")
        return increments * float(dt), "s", "physical"
    if dt is not None:
        raise wrong("both dt and time are given", "one of them", "leave one out", "time")
    if is_load(time) or time.lower() in ("load", "load_factor", "load-factor", "lambda"):
        raise wrong(
            f"the load history {time!r} cannot serve as time",
            "instants in seconds; the load factor goes back and forth across snaps",
            "leave the option out, which counts increments, or give dt",
            "time",
        )
    value = variables.get(time)
    if not isinstance(value, np.ndarray) or value.size != len(increments):
        size = value.size if isinstance(value, np.ndarray) else "no"
        raise wrong(
            f"the variable {time!r} has {size} values for {len(increments)} frames",
            "one instant a frame, the initial state included",
            "save the instants with that of the initial state in front",
            "time",
        )
    instants = np.asarray(value.real, dtype=np.float64).ravel()
    if not (np.isfinite(instants).all() and (np.diff(instants) > 0).all()):
        raise wrong(
            f"the variable {time!r} does not increase everywhere",
            "strictly increasing instants",
            "leave the option out, which counts increments",
            "time",
        )
    return instants, "s", "physical"


def write(run: Run, writer: TrajectoryWriter, *, instants: Floats, unit: str, kind: Any) -> None:
    """Declare and append `run`; bar lengths, strains and angles come from the positions.

    Parameters
    ----------
    run : Run
    writer : TrajectoryWriter
    instants : (T,) [unit]
    kind : ``"pseudo"`` or ``"physical"``
    """
    writer.declare_time(unit=unit, kind=kind)
    _declare(run, writer)
    n_frames, n_nodes = run.positions.shape[:2]
    widest = 3 * max(n_nodes, *(0 if e is None else len(e) for e in (run.bars, run.hinges)))
    step = max(1, _BLOCK // widest)
    unwrap = geometry.Unwrapper()
    for begin in range(0, n_frames, step):
        block = slice(begin, begin + step)
        positions = run.positions[block]
        elements: dict[tuple[str, str], Floats] = {}
        if run.bars is not None:
            lengths = geometry.bar_lengths(positions, run.bars)
            elements["bars", "length"] = lengths
            if run.bar_rest is not None:
                strain = lengths - run.bar_rest
                strain /= run.bar_rest
                elements["bars", "strain"] = strain
        if run.hinges is not None:
            angles = geometry.dihedral_angles(positions, run.hinges)
            elements["hinges", "angle"] = unwrap(angles)
        writer.append(
            instants[block],
            positions=positions,
            elements=elements,
            channels={s.name: s.values[block] for s in run.signals if not s.is_input},
            inputs={s.name: s.values[block] for s in run.signals if s.is_input},
        )
    if unwrap.crossings:
        writer.note(
            f"hinge angles cross the cut at 0 and 2 pi {unwrap.crossings} times and were "
            "unwrapped: panels passed through each other, or are folded shut"
        )


def _declare(run: Run, writer: TrajectoryWriter) -> None:
    n_nodes = run.positions.shape[1]
    writer.declare_nodes(
        n_nodes,
        3,
        unit=run.units.length,
        rest=run.rest,
        fixed=None if run.held is None else run.held.all(axis=1),
        ids=list(range(1, n_nodes + 1)),
        labels=[str(number) for number in range(1, n_nodes + 1)],
    )
    if run.bars is not None:
        series = {"length": run.units.length}
        static = dict(run.bar_static)
        if run.bar_rest is not None:
            series["strain"] = "1"
            static["rest_length"] = (run.bar_rest, run.units.length)
        writer.declare_elements("bars", run.bars, series=series, static=static)
    if run.hinges is not None:
        writer.declare_elements(
            "hinges", run.hinges, series={"angle": "rad"}, static=dict(run.hinge_static)
        )
    if run.faces is not None:
        writer.declare_elements("faces", run.faces)
    for signal in run.signals:
        if signal.is_input:
            writer.declare_input(
                signal.name,
                signal.columns,
                quantity=signal.quantity,
                unit=signal.unit,
                targets=signal.targets,
            )
        else:
            writer.declare_channel(
                signal.name, signal.columns, unit=signal.unit, quantity=signal.quantity
            )
    writer.declare_extension(extension.NAME, extension.VERSION)
    comment = "increment number of every frame; 0 is the initial state"
    writer.put_extension(extension.NAME, "increments", run.increments, comment=comment)
    if run.held is not None:
        comment = "supported degrees of freedom x, y, z of every node"
        writer.put_extension(extension.NAME, "held", run.held.astype("u1"), comment=comment)
    for name, (array, unit, comment) in run.extras.items():
        writer.put_extension(extension.NAME, name, array, unit=unit, comment=comment)
