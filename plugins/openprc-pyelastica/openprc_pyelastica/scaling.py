"""Scripts that compute in centimetres or millimetres: lengths to metres."""

from __future__ import annotations

from dataclasses import replace

from openprc_pyelastica.rods import Rod, Series

#: Length unit of the script to metres.
METRES: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}

_POWERS = {"m": 1, "m/s": 1, "m/s2": 1, "1/m": -1}
#: Units without length or mass, which stay as they are.
_KEPT = frozenset({"1", "s", "rad/s", "arb"})


def to_metres(rod: Rod, *, unit: str) -> Rod:
    """Return a rod whose lengths, computed in `unit`, are in metres.

    Quantities with mass in them (forces, couples, energies) lose their unit: a script in
    millimetres may count mass in kilograms or grams, and the file does not say.
    """
    if unit == "m":
        return rod
    factor = METRES[unit]
    extras = {key: _scaled(series, factor) for key, series in rod.extras.items()}
    if rod.mass is not None:
        extras["mass"] = Series(rod.mass, "arb", None)
    return replace(
        rod,
        positions=rod.positions * factor,
        velocities=None if rod.velocities is None else rod.velocities * factor,
        rest_length=rod.rest_length * factor,
        mass=None,
        extras=extras,
    )


def _scaled(series: Series, factor: float) -> Series:
    power = _POWERS.get(series.unit)
    if power is not None:
        return replace(series, values=series.values * factor**power)
    return series if series.unit in _KEPT else replace(series, unit="arb")
