"""Options of importers: text or values in, values of the stated kind out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.hooks import OptionSpec
from openprc.hooks.options import resolve_options

OPTIONS = (
    OptionSpec("dt", "time step", kind="float"),
    OptionSpec("count", "how many", kind="int", default=3),
    OptionSpec("unit", "unit of length", default="m", choices=("m", "mm")),
    OptionSpec("static", "keep what does not move", kind="bool", default=False),
    OptionSpec("urdf", "model", kind="path"),
    OptionSpec("bodies", "which", kind="int", multiple=True, default=(1, 2)),
    OptionSpec("rods", "which", multiple=True),
)


@pytest.fixture
def resolve(producer):
    def call(**given):
        return resolve_options(producer(options=OPTIONS), given)

    return call


def test_defaults_are_filled_in(resolve):
    assert resolve() == {
        "dt": None, "count": 3, "unit": "m", "static": False, "urdf": None, "bodies": (1, 2),
        "rods": (),
    }  # fmt: skip


def test_none_means_the_default(resolve):
    assert resolve(count=None, bodies=None) == resolve()


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("dt", "0.5", 0.5),
        ("dt", 2, 2.0),
        ("dt", np.float64(0.25), 0.25),
        ("dt", ["0.5"], 0.5),
        ("count", "12", 12),
        ("count", 12.0, 12),
        ("count", np.int64(12), 12),
        ("unit", "mm", "mm"),
        ("static", "TRUE", True),
        ("static", "off", False),
        ("static", True, True),
        ("static", 0, False),
        ("urdf", "a/b.urdf", Path("a/b.urdf")),
        ("urdf", Path("b.urdf"), Path("b.urdf")),
        ("bodies", "7", (7,)),
        ("bodies", ["7", 8], (7, 8)),
        ("bodies", (), ()),
        ("rods", "arm", ("arm",)),
    ],
)
def test_values_are_of_the_stated_kind(resolve, name, given, value):
    found = resolve(**{name: given})[name]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("name", "given", "found", "expected"),
    [
        ("dt", "fast", "'fast'", "a finite number"),
        ("dt", "", "''", "a finite number"),
        ("dt", "nan", "'nan'", "a finite number"),
        ("dt", math.nan, "nan", "a finite number"),
        ("dt", "-inf", "'-inf'", "a finite number"),
        ("dt", "1e999", "'1e999'", "a finite number"),
        ("dt", 10**400, "1000", "a finite number"),
        ("dt", True, "True", "a finite number"),
        ("dt", {}, "{}", "a finite number"),
        ("dt", ["1", "2"], "given 2 times", "one value"),
        ("dt", [], "given 0 times", "one value"),
        ("count", "1.5", "'1.5'", "a whole number"),
        ("count", 1.5, "1.5", "a whole number"),
        ("count", math.inf, "inf", "a whole number"),
        ("count", math.nan, "nan", "a whole number"),
        ("count", False, "False", "a whole number"),
        ("count", "many", "'many'", "a whole number"),
        ("unit", "cm", "'cm'", "one of m, mm"),
        ("unit", 3, "3", "one of m, mm"),
        ("static", "maybe", "'maybe'", "true or false"),
        ("static", 2, "2", "true or false"),
        ("urdf", 5, "5", "a path"),
        ("urdf", "", "''", "a path"),
        ("bodies", ["1", "x"], "'x'", "a whole number"),
        ("bodies", [1.5], "1.5", "a whole number"),
    ],
)
def test_wrong_values(resolve, name, given, found, expected):
    with pytest.raises(ConfigError, match=f"option {name} of fake is ") as caught:
        resolve(**{name: given})
    assert found in caught.value.found
    assert caught.value.expected == expected
    assert caught.value.key == name
    assert caught.value.fix == next(option.help for option in OPTIONS if option.name == name)


@pytest.mark.parametrize(
    ("name", "fix"),
    [("untis", "did you mean 'unit'?"), ("body", "did you mean 'bodies'?"),
     ("zzz", "leave it out"), ("trust", "leave it out")],
)  # fmt: skip
def test_an_unknown_option_names_the_nearest(resolve, name, fix):
    with pytest.raises(ConfigError, match=f"fake has no option '{name}'") as caught:
        resolve(**{name: "1"})
    assert caught.value.fix == fix
    assert caught.value.expected == "one of dt, count, unit, static, urdf, bodies, rods"
    assert (caught.value.key, caught.value.exit_code) == (name, 2)


def test_a_producer_without_options(producer):
    assert resolve_options(producer(), {}) == {}
    with pytest.raises(ConfigError, match="fake has no option 'unit'") as caught:
        resolve_options(producer(), {"unit": "m"})
    assert caught.value.expected == "one of none: it takes no options"


@pytest.mark.parametrize("trust", [True, False])
def test_trust_is_told_only_to_those_that_can_read_pickles(producer, trust):
    assert resolve_options(producer(), {}, trust=trust) == {}
    values = resolve_options(producer(trusts_pickle=True), {}, trust=trust)
    assert values == {"trust": trust}
    with pytest.raises(ConfigError, match="no option 'trust'"):
        resolve_options(producer(trusts_pickle=True), {"trust": True})
