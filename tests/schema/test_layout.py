"""The table of the contract agrees with itself, with the page, and with what is written."""

from __future__ import annotations

import itertools
from pathlib import Path

import h5py
import pytest

from openprc.schema.layout import (
    ATTRIBUTES,
    DATASETS,
    ELEMENT_ARITY,
    EXTENSION_SERIES,
    PHYSICAL_DIMENSIONS,
    ROOT_GROUPS,
    attributes_of,
    match,
)
from openprc.schema.spec_page import render
from openprc.schema.units import UNITS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "simulation-h5.md"


@pytest.mark.parametrize(
    ("path", "rule", "holders"),
    [
        ("/committed", "/committed", {}),
        ("/time_series/time", "/time_series/time", {}),
        ("/time_series/channels/gauge 1", "/time_series/channels/<name>", {"name": "gauge 1"}),
        ("/time_series/elements/bars/length", "/time_series/elements/<kind>/<quantity>",
         {"kind": "bars", "quantity": "length"}),
        ("/topology/bars/indices", "/topology/<kind>/indices", {"kind": "bars"}),
        ("/topology/bars/stiffness", "/topology/<kind>/<property>",
         {"kind": "bars", "property": "stiffness"}),
        ("/topology/nodes/mass", "/topology/nodes/mass", {}),
        ("/inputs/u/value", "/inputs/<name>/value", {"name": "u"}),
        ("/inputs/u/sequence", "/inputs/<name>/sequence", {"name": "u"}),
    ],
)  # fmt: skip
def test_match_finds_the_rule(path, rule, holders):
    found = match(path)
    assert found is not None
    assert (found[0].path, found[1]) == (rule, holders)


@pytest.mark.parametrize(
    "path",
    [
        "/time_series", "/time_series/times", "/time_series/time/x", "/time_series/nodes/color",
        "/time_series/channels/a/b", "/inputs/u/values", "/inputs/u", "/topology/nodes/colour",
        "/topology/nodes/indices", "/time_series/elements/nodes/length", "/extensions/x/y",
        "committed", "/committed/", "",
    ],
)  # fmt: skip
def test_match_refuses_what_is_not_in_the_table(path):
    assert match(path) is None


def test_every_rule_matches_its_own_path_and_no_other_rule_first():
    for rule in DATASETS:
        concrete = rule.path
        for holder in ("kind", "quantity", "name", "property"):
            concrete = concrete.replace(f"<{holder}>", f"a_{holder}")
        found = match(concrete)
        assert found is not None
        assert found[0] is rule


def test_rules_are_consistent():
    paths = [rule.path for rule in DATASETS]
    assert len(set(paths)) == len(paths)
    for rule in DATASETS:
        assert rule.path.split("/")[1] in ROOT_GROUPS
        assert bool(rule.when) == (rule.need == "conditional"), rule.path
        assert rule.meaning.endswith(".")
        assert set(rule.dtypes) <= {"f8", "f4", "i8", "i4", "u1", "str", "table"}
        assert set(rule.shape) <= {"T", "N", "D", "E", "C", "K", "k", "k?", "n"}
        assert "T" not in rule.shape[1:], "time is axis 0"
    keys = [(rule.owner, rule.name) for rule in ATTRIBUTES]
    doubles = [k for k, g in itertools.groupby(sorted(keys)) if len(list(g)) > 1]
    assert doubles == []
    known = {"/", "/provenance", "/extensions/<distribution>", EXTENSION_SERIES, *paths}
    for attribute in ATTRIBUTES:
        assert attribute.owner in known
        assert bool(attribute.when) == (attribute.need == "conditional")
    assert set(PHYSICAL_DIMENSIONS) <= set(paths)
    assert {d for ds in PHYSICAL_DIMENSIONS.values() for d in ds} <= {
        unit.dimension for unit in UNITS.values()
    }
    assert ELEMENT_ARITY == {"bars": 2, "bends": 3, "faces": 3, "hinges": 4}


def test_writer_writes_nothing_that_is_not_in_the_table(complete):
    with h5py.File(complete) as file:
        found = {}
        file.visititems(lambda name, item: found.update({f"/{name}": item}))
        for path, item in found.items():
            if path.startswith("/extensions"):
                continue
            if isinstance(item, h5py.Dataset):
                rule = match(path)
                assert rule is not None, path
                owner = rule[0].path
            else:
                owner = path
            known = {a.name for a in attributes_of(owner)}
            if owner.startswith("/topology/<kind>/"):
                known |= {"unit", "si_factor"}
            assert set(item.attrs) <= known, path
        assert set(file.attrs) <= {a.name for a in attributes_of("/")}
        assert set(file) <= set(ROOT_GROUPS)


def test_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == render(), (
        "docs/simulation-h5.md is stale: run "
        "`python -m openprc.schema.spec_page > docs/simulation-h5.md`"
    )


def test_page_names_everything():
    page = render()
    for rule in DATASETS:
        assert f"`{rule.path}`" in page
    for unit in UNITS:
        assert f"| `{unit}` |" in page
