"""The closed list of units, each with its factor to SI."""

from __future__ import annotations

import math
from dataclasses import dataclass

from openprc.errors import UnitError


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its symbol, the physical dimension it measures, and its factor to SI.

    ``si_factor`` is NaN where no factor exists: a pixel has no length until a camera is
    calibrated, and an arbitrary unit never has one.
    """

    symbol: str
    dimension: str
    si_factor: float


def _table() -> dict[str, Unit]:
    nan = math.nan
    rows: list[tuple[str, str, float]] = [
        ("1", "number", 1.0),
        ("arb", "arbitrary", nan),
        ("s", "time", 1.0),
        ("ms", "time", 1e-3),
        ("us", "time", 1e-6),
        ("min", "time", 60.0),
        ("m", "length", 1.0),
        ("cm", "length", 1e-2),
        ("mm", "length", 1e-3),
        ("um", "length", 1e-6),
        ("px", "pixel length", nan),
        ("1/m", "curvature", 1.0),
        ("1/mm", "curvature", 1e3),
        ("m2", "area", 1.0),
        ("mm2", "area", 1e-6),
        ("kg", "mass", 1.0),
        ("g", "mass", 1e-3),
        ("mg", "mass", 1e-6),
        ("N", "force", 1.0),
        ("mN", "force", 1e-3),
        ("uN", "force", 1e-6),
        ("kN", "force", 1e3),
        ("N/m", "stiffness", 1.0),
        ("N/mm", "stiffness", 1e3),
        ("mN/mm", "stiffness", 1.0),
        ("N/m3", "cubic stiffness", 1.0),
        ("N*s/m", "damping", 1.0),
        ("N*s3/m3", "cubic damping", 1.0),
        ("kg/s", "damping", 1.0),
        ("N*m", "torque", 1.0),
        ("N*mm", "torque", 1e-3),
        ("N*m/rad", "rotational stiffness", 1.0),
        ("N*mm/rad", "rotational stiffness", 1e-3),
        ("N*m*s/rad", "rotational damping", 1.0),
        ("N*s", "impulse", 1.0),
        ("kg*m2", "moment of inertia", 1.0),
        ("J", "energy", 1.0),
        ("mJ", "energy", 1e-3),
        ("W", "power", 1.0),
        ("Pa", "pressure", 1.0),
        ("kPa", "pressure", 1e3),
        ("MPa", "pressure", 1e6),
        ("GPa", "pressure", 1e9),
        ("rad", "angle", 1.0),
        ("deg", "angle", math.pi / 180.0),
        ("rad/s", "angular velocity", 1.0),
        ("deg/s", "angular velocity", math.pi / 180.0),
        ("m/s", "velocity", 1.0),
        ("cm/s", "velocity", 1e-2),
        ("mm/s", "velocity", 1e-3),
        ("um/s", "velocity", 1e-6),
        ("m/ms", "velocity", 1e3),
        ("mm/ms", "velocity", 1.0),
        ("px/s", "pixel velocity", nan),
        ("arb/s", "arbitrary rate", nan),
        ("m/s2", "acceleration", 1.0),
        ("mm/s2", "acceleration", 1e-3),
        ("1/s", "rate", 1.0),
        ("Hz", "rate", 1.0),
        ("V", "voltage", 1.0),
        ("mV", "voltage", 1e-3),
        ("A", "current", 1.0),
        ("mA", "current", 1e-3),
        ("ohm", "resistance", 1.0),
        ("K", "temperature", 1.0),
        ("T", "magnetic flux density", 1.0),
        ("mT", "magnetic flux density", 1e-3),
    ]
    return {symbol: Unit(symbol, dimension, factor) for symbol, dimension, factor in rows}


UNITS: dict[str, Unit] = _table()


def unit(symbol: str, *, file: str | None = None, key: str | None = None) -> Unit:
    """Look up a unit.

    Raises
    ------
    UnitError
        When `symbol` is not in the list.
    """
    try:
        return UNITS[symbol]
    except (KeyError, TypeError):
        raise UnitError(
            f"unknown unit {symbol!r}",
            expected="one of " + " ".join(UNITS),
            fix="convert the values to one of these, or say 'arb' when there is no unit",
            file=file,
            key=key,
        ) from None


def conversion_factor(
    source: str, target: str, *, file: str | None = None, key: str | None = None
) -> float:
    """Return the number that turns values in `source` into values in `target`.

    Raises
    ------
    UnitError
        When either unit is unknown or they do not measure the same thing.
    """
    if source == target:
        unit(source, file=file, key=key)
        return 1.0
    a, b = unit(source, file=file, key=key), unit(target, file=file, key=key)
    if a.dimension != b.dimension or math.isnan(a.si_factor) or math.isnan(b.si_factor):
        raise UnitError(
            f"cannot convert {source!r} ({a.dimension}) to {target!r} ({b.dimension})",
            expected="two units of one dimension, both with a factor to SI",
            fix="ask for the stored unit, or calibrate the data first",
            file=file,
            key=key,
        )
    return a.si_factor / b.si_factor


def velocity_unit(length: str) -> str:
    """Return the unit of velocity that belongs to a unit of length, per second.

    Raises
    ------
    UnitError
        When there is none; name one explicitly then.
    """
    known = {"m": "m/s", "cm": "cm/s", "mm": "mm/s", "um": "um/s", "px": "px/s", "arb": "arb/s"}
    if length not in known:
        raise UnitError(
            f"no unit of velocity belongs to {length!r}",
            expected="one of " + " ".join(known),
            fix="pass velocity_unit",
        )
    return known[length]
