"""Units as H5MD spells them ("m s-1"), and their factors to the units of the contract."""

from __future__ import annotations

from pathlib import Path

from openprc.errors import UnitError
from openprc.schema.units import UNITS

#: H5MD's name of a length or time to its factor to m or s.
_LENGTHS = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "pm": 1e-12, "fm": 1e-15,
    "Angstrom": 1e-10, "angstrom": 1e-10, "A": 1e-10,
}  # fmt: skip
_TIMES = {
    "s": 1.0, "second": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12,
    "fs": 1e-15,
}  # fmt: skip


def to_contract(name: str, *, file: Path, key: str) -> tuple[str, float]:
    """Return the unit of the contract that a name stands for, and the factor to it.

    Names of lengths that the contract has keep their unit; shorter ones become metres.

    Raises
    ------
    UnitError
        When the name is not known.
    """
    if name in UNITS:
        return name, 1.0
    if name in _LENGTHS:
        return "m", _LENGTHS[name]
    if name in _TIMES:
        return "s", _TIMES[name]
    length, _, per = name.partition(" ")
    if length in _LENGTHS and per.endswith("-1") and per[:-2] in _TIMES:
        return "m/s", _LENGTHS[length] / _TIMES[per[:-2]]
    if _power_product(name) in UNITS:
        return _power_product(name), 1.0
    raise UnitError(
        f"unknown unit {name!r}",
        expected="a unit of length, time or velocity such as nm, ps, or m s-1",
        fix="convert the values, or correct the attribute 'unit'",
        file=file,
        key=key,
    )


def is_known(name: str) -> bool:
    """Tell whether `to_contract` understands a name."""
    try:
        to_contract(name, file=Path(), key="")
    except UnitError:
        return False
    return True


def from_contract(symbol: str) -> str:
    """Return H5MD's spelling of a unit of the contract: a product of powers of units."""
    tops, _, bottoms = symbol.partition("/")
    parts = [part for part in tops.split("*") if part != "1"]
    for part in filter(None, bottoms.split("*")):
        letters = part.rstrip("0123456789")
        parts.append(f"{letters}-{part[len(letters) :] or '1'}")
    return " ".join(parts) or "1"


def _power_product(name: str) -> str:
    """Return a product of powers as the contract writes it: "kg m2" is kg*m2."""
    tops, bottoms = [], []
    for part in name.split():
        letters, minus, power = part.partition("-")
        if minus:
            bottoms.append(letters + ("" if power == "1" else power))
        else:
            tops.append(part)
    return "*".join(tops or ["1"]) + ("/" + "*".join(bottoms) if bottoms else "")


def length_factor(unit: str, target: str) -> float:
    """Return what turns a length of the contract into `target`, a name of H5MD."""
    return UNITS[unit].si_factor / _LENGTHS[target]
