"""What a comparison counts by: time, load steps, frames, or a quantity that only grows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.compare.alignment.coordinates import Coordinates
from openprc.compare.alignment.frame_reading import FrameReader
from openprc.errors import ConfigError, MissingInputError, NonUniformTime, SchemaError
from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

TIME = "/time_series/time"
#: Loads at equal steps are equal within this, in units of their range.
SAME_LOAD = 1e-6

Kind = Literal["time", "step", "index", "quantity"]


@dataclass(frozen=True)
class ClockPair:
    """The clocks of two files in one unit, both strictly increasing.

    Parameters
    ----------
    kind : {"time", "step", "index", "quantity"}
    reference, other : (T,)
    unit : str
    text : str
        What is counted, for people.
    sign : float
        -1 where the quantity falls: the clocks are its negative.
    notes : tuple of str
    """

    kind: Kind
    reference: Reals
    other: Reals
    unit: str
    text: str
    sign: float = 1.0
    notes: tuple[str, ...] = ()


def clock_pair(
    reference: Trajectory, other: Trajectory, *, settings: AlignmentSettings
) -> ClockPair:
    """Return the clocks that frames of two files are matched by.

    Raises
    ------
    SchemaError
        When one file counts load steps and the other time, and nothing was said.
    NonUniformTime
        When the quantity to count by does not only grow or only fall.
    ConfigError, MissingData, UnitError
        When the quantity is not in the files, or has other units.
    """
    word = settings.clock.partition(":")[0]
    kinds = (reference.time_kind, other.time_kind)
    if word == "auto":
        if kinds[0] != kinds[1]:
            steps = reference if kinds[0] == "pseudo" else other
            raise SchemaError(
                f"{steps.path.name} counts load steps, and the other file time",
                expected="two runs in time, or two paths of load steps",
                fix='say what both have in common: clock="index" for frames in order,'
                ' clock="input" for the load, or clock="node:LABEL:AXIS" for a displacement',
                file=other.path,
                key=f"{TIME}@kind",
            )
        return _in_time(reference, other) if kinds[0] == "physical" else _by_steps(reference, other)
    if word in ("time", "step"):
        wanted = "physical" if word == "time" else "pseudo"
        for trajectory in (reference, other):
            if trajectory.time_kind != wanted:
                raise SchemaError(
                    f"its time is {trajectory.time_kind}, and the clock is {word!r}",
                    expected=f"{wanted} time in both files",
                    fix='choose clock="index", "input" or "node:LABEL:AXIS"',
                    file=trajectory.path,
                    key=f"{TIME}@kind",
                )
        if word == "time":
            return _in_time(reference, other)
        return ClockPair("step", reference.time, other.time, "1", "number of the load step")
    if word == "index":
        notes = ()
        if reference.n_frames != other.n_frames:
            notes = (
                f"frames are matched in order, and there are {reference.n_frames} and"
                f" {other.n_frames}: the rest of the longer file is left out",
            )
        counts = [np.arange(t.n_frames, dtype="f8") for t in (reference, other)]
        return ClockPair("index", counts[0], counts[1], "1", "frames in order", notes=notes)
    return _by_quantity(reference, other, settings.clock)


def _in_time(reference: Trajectory, other: Trajectory) -> ClockPair:
    factor = units.conversion_factor(other.time_unit, reference.time_unit, key=f"{TIME}@unit")
    clock = other.time if factor == 1.0 else other.time * factor
    return ClockPair("time", reference.time, clock, reference.time_unit, "time")


def _by_steps(reference: Trajectory, other: Trajectory) -> ClockPair:
    """Match numbers of steps; where these carry unequal loads, the loads."""
    plain = ClockPair("step", reference.time, other.time, "1", "number of the load step")
    names = [name for name in reference.inputs if name in other.inputs]
    if len(names) != 1 or len(reference.input(names[0]).columns) != 1:
        return plain
    first, second = _recorded(reference, ("input", names[0])), _recorded(other, ("input", names[0]))
    shared, i, j = np.intersect1d(plain.reference, plain.other, return_indices=True)
    both = _in_unit(first[0], second, other)
    span = float(np.ptp(first[0][0])) or 1.0
    if len(shared) and np.abs(first[0][0][i] - both[j]).max() <= SAME_LOAD * span:
        return plain
    if _direction(first[0][0]) and _direction(first[0][0]) == _direction(both):
        found = _by_quantity(reference, other, f"input:{names[0]}")
        note = f"equal steps carry unequal loads, so states of equal {names[0]} are compared"
        return ClockPair(
            found.kind, found.reference, found.other, found.unit, found.text, found.sign, (note,)
        )
    note = (
        f"equal steps carry unequal {names[0]}, which goes up and down, so it cannot match"
        " them: the deviation holds that of the loads"
    )
    return ClockPair(plain.kind, plain.reference, plain.other, "1", plain.text, notes=(note,))


def _by_quantity(reference: Trajectory, other: Trajectory, clock: str) -> ClockPair:
    words = tuple(clock.split(":"))
    first, second = _recorded(reference, words), _recorded(other, words)
    values = (first[0][0], _in_unit(first[0], second, other))
    signs = []
    for trajectory, series, key in (
        (reference, values[0], first[1]),
        (other, values[1], second[1]),
    ):
        sign = _direction(series)
        if not sign:
            steps = np.diff(series) * (1.0 if series[-1] >= series[0] else -1.0)
            at = int(np.flatnonzero(~(steps > 0))[0]) + 1 if len(series) > 1 else 0
            raise NonUniformTime(
                f"it turns or stands still at frame {at}, so it cannot tell the states apart",
                expected="a quantity that only grows or only falls",
                fix='choose another clock: "index", or "node:LABEL:AXIS" of a node that goes on'
                " moving one way",
                file=trajectory.path,
                key=key,
            )
        signs.append(sign)
    if signs[0] != signs[1]:
        raise SchemaError(
            "it falls in one file and grows in the other",
            expected="loads of one sense",
            fix='compare with clock="index", or turn the load of one file round',
            file=other.path,
            key=second[1],
        )
    sign = float(signs[0])
    return ClockPair("quantity", sign * values[0], sign * values[1], first[0][1], clock, sign)


Recorded = tuple[tuple["Reals", str], str]


def _in_unit(wanted: tuple[Reals, str], found: Recorded, trajectory: Trajectory) -> Reals:
    (series, unit), key = found
    if unit == wanted[1]:
        return series
    factor = units.conversion_factor(unit, wanted[1], file=str(trajectory.path), key=key)
    return series * factor


def _direction(series: Reals) -> int:
    steps = np.diff(series)
    if not len(steps) or not np.isfinite(series).all():
        return 0
    return 1 if (steps > 0).all() else -1 if (steps < 0).all() else 0


def _recorded(trajectory: Trajectory, words: tuple[str, ...]) -> Recorded:
    """Return the quantity that a clock names, its unit, and its place in the file."""
    what, name, column = (*words, "", "")[:3]
    if what == "node":
        return _of_node(trajectory, name, column)
    if what == "input":
        signal = trajectory.input(name or None)
        key = f"/inputs/{signal.name}/value"
        table, columns, unit = signal.value, signal.columns, signal.unit
    else:
        key = f"/time_series/channels/{name}"
        if name not in trajectory.channels:
            raise MissingInputError(
                f"there is no channel {name!r}",
                expected="one of " + ", ".join(trajectory.channels or ("none",)),
                fix='name one of them, as in clock="channel:NAME:COLUMN"',
                file=trajectory.path,
                key="/time_series/channels",
            )
        table, columns = trajectory.channel(name), trajectory.channel_columns(name)
        unit = trajectory.unit(key)
    if not column and len(columns) == 1:
        return (np.asarray(table[:, 0]), unit), key
    if column not in columns:
        raise ConfigError(
            f"{what} {name or trajectory.inputs[0]} has no column {column!r}"
            if column
            else f"{what} {name or trajectory.inputs[0]} has {len(columns)} columns",
            expected="one of " + ", ".join(columns),
            fix=f'name one, as in clock="{what}:NAME:COLUMN"',
            file=trajectory.path,
            key=key,
        )
    return (np.asarray(table[:, columns.index(column)]), unit), key


def _of_node(trajectory: Trajectory, name: str, axis: str) -> Recorded:
    axes = trajectory.axes
    labels = node_names(trajectory)
    if name not in labels or axis not in axes:
        what = f"node {name!r}" if name not in labels else f"axis {axis!r}"
        raise ConfigError(
            f"there is no {what}",
            expected="a node by label (or number, where there are no labels), and one of "
            + ", ".join(axes),
            fix='name them as in clock="node:LABEL:AXIS"',
            file=trajectory.path,
            key="/topology/nodes/label",
        )
    reader = FrameReader(
        trajectory,
        Coordinates((axes.index(axis),), 1.0),
        nodes=np.array([labels.index(name)]),
        filled=True,
    )
    step = 16 * reader.chunk_rows
    series = [
        reader.rows(a, min(a + step, trajectory.n_frames))[:, 0, 0].copy()
        for a in range(0, trajectory.n_frames, step)
    ]
    return (np.concatenate(series), trajectory.position_unit), f"node {name}, axis {axis}"


def node_names(trajectory: Trajectory) -> tuple[str, ...]:
    """Return the labels of the nodes, or their numbers from 0 where there are none."""
    if trajectory.has("/topology/nodes/label"):
        return tuple(str(label) for label in trajectory.node("label"))
    return tuple(str(number) for number in range(trajectory.n_nodes))


__all__ = ["ClockPair", "Kind", "clock_pair", "node_names"]
