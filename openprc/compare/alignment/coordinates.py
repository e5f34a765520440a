"""Coordinates of a pair of files in one unit and along the same axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import MissingData, SchemaError, UnitError
from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.schema.trajectory import Trajectory

POSITIONS = "/time_series/nodes/positions"
VELOCITIES = "/time_series/nodes/velocities"


@dataclass(frozen=True)
class Coordinates:
    """How the places in one file become places of the comparison.

    Parameters
    ----------
    columns : tuple of int
        Columns that are compared, in order.
    factor : float
        From the stored unit.
    speed_factor : float or None
        From the stored velocities to the unit of the comparison per unit of the reference's
        time; None where there are none, or their unit does not belong to that of the places.
    """

    columns: tuple[int, ...]
    factor: float
    speed_factor: float | None = None

    def of(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return places (..., D) of the file as places (..., d) of the comparison."""
        kept = np.asarray(places, dtype="f8")[..., list(self.columns)]
        return kept if self.factor == 1.0 else kept * self.factor


@dataclass(frozen=True)
class CommonSpace:
    """The unit and the axes that both files are brought to.

    Parameters
    ----------
    unit : str
        "m" where both are lengths, else the unit of both.
    axes : tuple of str
    reference, other : Coordinates
    notes : tuple of str
    """

    unit: str
    axes: tuple[str, ...]
    reference: Coordinates
    other: Coordinates
    notes: tuple[str, ...] = ()


def common_space(
    reference: Trajectory, other: Trajectory, *, settings: AlignmentSettings
) -> CommonSpace:
    """Find the unit and the axes in which two files can be compared.

    Raises
    ------
    MissingData
        When a file has no positions.
    UnitError
        When their units do not measure the same thing and no scale was given.
    SchemaError
        When one is planar and it is not known which axes of the other it shows.
    """
    for trajectory in (reference, other):
        if not trajectory.dims:
            raise MissingData(
                "it holds no positions",
                expected="nodes that move",
                fix="compare files with nodes; `openprc info` shows what a file holds",
                file=trajectory.path,
                key=POSITIONS,
            )
    unit, factors = _common_unit(reference, other, settings)
    if isinstance(settings.scale, int | float):
        factors = (factors[0], factors[1] * float(settings.scale))
    names = (reference.axes, other.axes)
    columns = _common_columns(reference, other, names, settings.axes)
    notes = []
    if unit == "arb" and other.position_unit == "arb" and settings.scale is None:
        notes.append("both files are in arbitrary units, taken to be the same")
    frames = tuple(trajectory.frame for trajectory in (reference, other))
    if frames[0] != frames[1] and settings.rigid_motion == "none":
        notes.append(
            f"the frames of reference are called {frames[0]!r} and {frames[1]!r}: what lies"
            " between them is part of the deviation, unless rigid_motion removes it"
        )
    second = 1.0 if reference.time_kind == "pseudo" else units.unit(reference.time_unit).si_factor
    sides = [
        Coordinates(kept, factor, _speed_factor(trajectory, factor, second))
        for trajectory, kept, factor in zip((reference, other), columns, factors, strict=True)
    ]
    axes = tuple(names[0][column] for column in columns[0])
    return CommonSpace(unit, axes, sides[0], sides[1], tuple(notes))


def _common_unit(
    reference: Trajectory, other: Trajectory, settings: AlignmentSettings
) -> tuple[str, tuple[float, float]]:
    first = units.unit(reference.position_unit, file=str(reference.path), key=POSITIONS)
    second = units.unit(other.position_unit, file=str(other.path), key=POSITIONS)
    if first.dimension == second.dimension:
        if math.isnan(first.si_factor):
            return first.symbol, (1.0, 1.0)
        symbol = "m" if first.dimension == "length" else first.symbol
        return symbol, (first.si_factor, second.si_factor)
    if settings.scale is None:
        raise UnitError(
            f"its places are in {second.symbol} ({second.dimension}), those of"
            f" {reference.path.name} in {first.symbol} ({first.dimension})",
            expected="two units of one dimension",
            fix=f"give the length of one {second.symbol} in"
            f" {'m' if first.dimension == 'length' else first.symbol} as scale, or let"
            ' scale="fit" estimate it together with a rigid motion',
            file=other.path,
            key=POSITIONS,
        )
    symbol = "m" if first.dimension == "length" else first.symbol
    return symbol, (1.0 if math.isnan(first.si_factor) else first.si_factor, 1.0)


def _speed_factor(trajectory: Trajectory, factor: float, second: float) -> float | None:
    """Return what turns stored velocities into the comparison's unit per `second` seconds."""
    if not trajectory.has(VELOCITIES) or trajectory.time_kind == "pseudo":
        return None
    length, speed = units.unit(trajectory.position_unit), units.unit(trajectory.unit(VELOCITIES))
    pairs = {"length": "velocity", "pixel length": "pixel velocity", "arbitrary": "arbitrary rate",
             "number": "rate"}  # fmt: skip
    if pairs.get(length.dimension) != speed.dimension:
        return None
    # What a unit of velocity holds in stored units of length per second; px/s and arb/s hold 1.
    ratio = 1.0 if math.isnan(speed.si_factor) else speed.si_factor / length.si_factor
    return ratio * factor * second


def _common_columns(
    reference: Trajectory,
    other: Trajectory,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    wanted: tuple[str, ...],
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    dims = (reference.dims, other.dims)
    if dims[0] == dims[1]:
        if wanted:
            return _named(reference, names[0], wanted), _named(other, names[1], wanted)
        if set(names[0]) == set(names[1]):
            # The same axes in another order are the same axes.
            return tuple(range(dims[0])), tuple(names[1].index(name) for name in names[0])
        return tuple(range(dims[0])), tuple(range(dims[1]))
    flat, deep = (0, 1) if dims[0] < dims[1] else (1, 0)
    files = (reference, other)
    shown = wanted or names[flat]
    if not wanted and not set(shown) <= set(names[deep]):
        raise SchemaError(
            f"it is planar with axes {', '.join(names[flat])}, and {files[deep].path.name} has"
            f" axes {', '.join(names[deep])}",
            expected="axes of the planar file that the other one has, too",
            fix='name the two axes that it shows, such as axes=("x", "z")',
            file=files[flat].path,
            key=f"{POSITIONS}@axes",
        )
    kept = _named(files[deep], names[deep], shown)
    both = ((0, 1), kept)
    return both if flat == 0 else (both[1], both[0])


def _named(
    trajectory: Trajectory, names: tuple[str, ...], wanted: tuple[str, ...]
) -> tuple[int, ...]:
    missing = [name for name in wanted if name not in names]
    if missing or len(set(wanted)) != len(wanted) or len(wanted) not in (2, 3):
        raise SchemaError(
            f"the axes {', '.join(wanted)} of {', '.join(names)}",
            expected="two or three different ones of those that the file has",
            fix="correct the setting axes",
            file=trajectory.path,
            key=f"{POSITIONS}@axes",
        )
    return tuple(names.index(name) for name in wanted)


__all__ = ["POSITIONS", "VELOCITIES", "CommonSpace", "Coordinates", "common_space"]
