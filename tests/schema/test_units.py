"""The closed list of units."""

from __future__ import annotations

import itertools
import math

import pytest

from openprc.errors import UnitError
from openprc.schema.units import UNITS, conversion_factor, unit, velocity_unit

PAIRS = [
    (a.symbol, b.symbol)
    for a, b in itertools.permutations(UNITS.values(), 2)
    if a.dimension == b.dimension and not math.isnan(a.si_factor)
]


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("m", "mm", 1e3), ("mm", "m", 1e-3), ("cm", "um", 1e4), ("s", "ms", 1e3), ("min", "s", 60),
        ("g", "kg", 1e-3), ("kN", "mN", 1e6), ("N/mm", "N/m", 1e3), ("mN/mm", "N/m", 1),
        ("kg/s", "N*s/m", 1), ("N*mm/rad", "N*m/rad", 1e-3), ("MPa", "kPa", 1e3),
        ("deg", "rad", math.pi / 180), ("rad", "deg", 180 / math.pi),
        ("m/ms", "m/s", 1e3), ("mm/ms", "m/s", 1), ("Hz", "1/s", 1), ("1/mm", "1/m", 1e3),
        ("mm2", "m2", 1e-6), ("mm/s2", "m/s2", 1e-3), ("mT", "T", 1e-3), ("1", "1", 1),
        ("px", "px", 1), ("arb", "arb", 1),
    ],
)  # fmt: skip
def test_factors(source, target, factor):
    assert conversion_factor(source, target) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_conversion_is_invertible(source, target):
    there, back = conversion_factor(source, target), conversion_factor(target, source)
    assert there * back == pytest.approx(1.0, rel=1e-15)


def test_table_is_consistent():
    for symbol, entry in UNITS.items():
        assert entry.symbol == symbol
        assert entry.si_factor > 0 or math.isnan(entry.si_factor)
        unknown = entry.dimension.startswith(("pixel", "arbitrary"))
        assert math.isnan(entry.si_factor) == unknown
        assert not any(character.isspace() for character in symbol)
    lone = [u.dimension for u in UNITS.values() if u.si_factor == 1.0]
    assert set(lone) == {u.dimension for u in UNITS.values() if not math.isnan(u.si_factor)}


@pytest.mark.parametrize("symbol", ["inch", "", "M", "N m", None, 3, ["m"]])
def test_unknown_unit_lists_the_known_ones(symbol):
    with pytest.raises(UnitError, match=r"unknown unit[\s\S]*one of 1 arb s ms[\s\S]*say 'arb'"):
        unit(symbol, file="run.h5", key="/x")


@pytest.mark.parametrize(
    ("source", "target"),
    [("m", "s"), ("px", "m"), ("m", "px"), ("arb", "1"), ("1", "arb"), ("N*m", "J"), ("px", "arb"),
     ("px/s", "m/s"), ("Hz", "rad/s")],
)  # fmt: skip
def test_what_does_not_measure_the_same_is_refused(source, target):
    with pytest.raises(UnitError, match=r"cannot convert[\s\S]*calibrate"):
        conversion_factor(source, target)


@pytest.mark.parametrize(
    ("length", "speed"),
    [
        ("m", "m/s"),
        ("mm", "mm/s"),
        ("cm", "cm/s"),
        ("um", "um/s"),
        ("px", "px/s"),
        ("arb", "arb/s"),
    ],
)
def test_unit_of_velocity(length, speed):
    assert velocity_unit(length) == speed
    assert speed in UNITS


@pytest.mark.parametrize("length", ["1", "kg", "inch"])
def test_no_unit_of_velocity(length):
    with pytest.raises(UnitError, match=r"no unit of velocity belongs to[\s\S]*velocity_unit"):
        velocity_unit(length)
