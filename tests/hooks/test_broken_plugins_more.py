"""Broken plugins side by side with good ones, and what a listing imports."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from openprc.errors import AmbiguousName
from openprc.hooks import Registry
from openprc.hooks.faults import PluginWarning

#: Simulators and other packages that a listing has no use for.
HEAVY = {
    "MDAnalysis", "cv2", "elastica", "h5py", "jax", "matplotlib", "meshio", "meshlane", "numba",
    "numpy", "pandas", "pybullet", "pydantic", "scipy", "sklearn", "vtk", "vtkmodules",
}  # fmt: skip

_LISTING = """
import json, sys
import openprc.hooks
from openprc.hooks.registry import Registry, availability
before = set(sys.modules)
registry = Registry()
told = [(item.qualified_name, availability(item.spec)) for item in registry.producers]
new = sorted(set(sys.modules) - before)
print(json.dumps([new, told, [[p.name, p.state, p.problem] for p in registry.plugins]]))
"""


@pytest.fixture(scope="module")
def listing():
    done = subprocess.run(
        [sys.executable, "-c", _LISTING], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_listing_with_availability_imports_no_simulator(listing):
    modules, told, _ = listing
    assert {name.partition(".")[0] for name in modules} & HEAVY == set()
    assert "openprc/demlat" in dict(told)


def test_the_entry_modules_of_plugins_import_records_only(listing):
    modules, _, plugins = listing
    assert [row for row in plugins if row[1] != "ok"] == []
    ours = [name for name in modules if name.startswith("openprc_")]
    # An entry module may keep its records in a module beside it; the code stays out.
    assert len(ours) <= 2 * len(plugins)


def test_every_way_of_being_broken_at_once_stops_nobody(make_entry, make_module, producer):
    def argument(registry):
        return []

    argument.__name__ = "openprc_producers"
    from openprc.hooks import hookimpl

    def misspelt():
        return []

    entries = [
        make_entry("exits", content=SystemExit(2)),
        make_entry("ageless", api=None, openprc_producers=[producer("ageless")]),
        make_entry("old", api="0.3", openprc_producers=[producer("old")]),
        make_entry("misspelt", content=make_module(openprc_producer=hookimpl(misspelt))),
        make_entry("argument", content=make_module(openprc_producers=hookimpl(argument))),
        make_entry("wrongtype", openprc_producers=["csv"]),
        make_entry("one", openprc_producers=[producer("same")]),
        make_entry("two", openprc_producers=[producer("same")]),
        make_entry("fine", openprc_producers=[producer("fine")]),
    ]
    with pytest.warns(PluginWarning) as caught:
        registry = Registry(entries)
    assert len(caught) == 6
    states = {plugin.name: plugin.state for plugin in registry.plugins}
    assert states.pop("builtin") == "ok"
    assert states == {
        "exits": "broken", "ageless": "broken", "old": "incompatible", "misspelt": "broken",
        "argument": "broken", "wrongtype": "broken", "one": "ok", "two": "ok", "fine": "ok",
    }  # fmt: skip
    assert all(plugin.fix for plugin in registry.plugins if plugin.state in ("broken",))
    assert registry.producer("fine").distribution == "openprc-fine"
    assert registry.producer("openprc-two/same").name == "same"
    with pytest.raises(AmbiguousName, match="2 plugins offer a producer named 'same'"):
        registry.producer("same")
    again = [item.qualified_name for item in Registry(entries[6:]).producers]
    assert again == [item.qualified_name for item in Registry(entries[:5:-1]).producers]
