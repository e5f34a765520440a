"""Finding records by name, and loading what they name."""

from __future__ import annotations

import itertools
import sys

import pytest

from openprc.errors import (
    AmbiguousName,
    MissingData,
    MissingDependency,
    OpenPRCError,
    PluginError,
    UnknownName,
)
from openprc.hooks import FeatureSpec, ReadoutSpec, Registry
from openprc.hooks.faults import PluginWarning, owned_by
from openprc.hooks.registry import availability, missing_packages, resolve

ABSENT = "no_such_package_zq"


class Thing:
    """Behind a record."""


def test_the_order_does_not_depend_on_the_order_of_entry_points(make_entry, producer):
    names = ("gamma", "alpha", "beta")
    seen = set()
    for order in itertools.permutations(names):
        entries = [
            make_entry(name, openprc_producers=[producer("shared"), producer(name)])
            for name in order
        ]
        registry = Registry(entries)
        seen.add(
            (
                tuple(p.name for p in registry.plugins),
                tuple(item.qualified_name for item in registry.producers),
            )
        )
    ((plugins, producers),) = seen
    assert plugins == ("builtin", "alpha", "beta", "gamma")
    shared = [name for name in producers if name.endswith("/shared")]
    assert shared == [f"openprc-{name}/shared" for name in sorted(names)]
    assert list(producers) == sorted(producers, key=lambda n: n.split("/")[::-1])


def test_two_distributions_may_offer_one_name(make_entry, make_code, producer):
    entries = [
        make_entry(name, openprc_producers=[producer("csv", make_code("Thing", Thing))])
        for name in ("one", "two")
    ]
    registry = Registry(entries)
    assert sum(item.name == "csv" for item in registry.producers) == 2
    with pytest.raises(AmbiguousName, match="2 plugins offer a producer named 'csv'") as caught:
        registry.producer("csv")
    assert caught.value.expected == "one of openprc-one/csv, openprc-two/csv"
    assert "for example 'openprc-one/csv'" in caught.value.fix
    assert caught.value.exit_code == 2
    for name in ("one", "two"):
        item = registry.producer(f"openprc-{name}/csv")
        assert item.distribution == f"openprc-{name}"
        assert isinstance(registry.load(item), Thing)


def test_one_name_twice_in_a_distribution_would_make_the_full_name_ambiguous(make_entry, producer):
    entries = [
        make_entry(name, dist="openprc-both", openprc_producers=[producer("csv")])
        for name in ("second", "first")
    ]
    with pytest.warns(PluginWarning, match="'csv', which first of the same distribution offers"):
        registry = Registry(entries)
    states = {plugin.name: plugin.state for plugin in registry.plugins}
    assert (states["first"], states["second"]) == ("ok", "broken")
    assert registry.producer("openprc-both/csv") == registry.producer("csv")


def test_one_name_under_two_hooks_is_no_conflict(make_entry, producer):
    registry = Registry(
        [
            make_entry(
                openprc_producers=[producer("csv")],
                openprc_features=[FeatureSpec("csv", "A feature", "a:b")],
            )
        ]
    )
    assert registry.find("openprc_features", "csv").hook == "openprc_features"
    assert registry.producer("csv").hook == "openprc_producers"


@pytest.mark.parametrize(
    ("name", "fix"),
    [
        ("demlta", "did you mean 'demlat'?"),
        ("openprc/demlt", "did you mean 'openprc/demlat'?"),
        ("zzzzzz", "see `openprc plugins`"),
        ("", "see `openprc plugins`"),
    ],
)
def test_an_unknown_name(name, fix):
    with pytest.raises(UnknownName, match=f"there is no producer named '{name}'") as caught:
        Registry([]).producer(name)
    assert caught.value.fix.startswith(fix)
    assert caught.value.expected.startswith("one of demlat, legacy, ")
    assert (caught.value.key, caught.value.exit_code) == (name, 2)


def test_an_unknown_name_mentions_what_was_left_out(make_entry):
    entries = [make_entry("broken", content=ImportError("zeppelin")), make_entry("off")]
    with pytest.warns(PluginWarning, match="zeppelin"):
        registry = Registry(entries, wanted="broken")
    with pytest.raises(UnknownName, match=r"left out: broken \(it cannot be imported.*zeppelin"):
        registry.producer("nothing")
    with pytest.raises(UnknownName, match=r"off \(left out by OPENPRC_PLUGINS\)"):
        registry.producer("nothing")


def test_an_empty_hook_says_that_nothing_is_registered(monkeypatch):
    registry = Registry([])
    monkeypatch.setattr(registry, "records", lambda hook: ())
    with pytest.raises(UnknownName, match="no extension named 'mine'") as caught:
        registry.find("openprc_extensions", "mine")
    assert caught.value.expected == "one of none: nothing is registered"


def test_names_are_not_listed_twice(make_entry, producer):
    entries = [make_entry(name, openprc_producers=[producer("csv")]) for name in ("a", "b")]
    with pytest.raises(UnknownName) as caught:
        Registry(entries).producer("zzzzzz")
    assert caught.value.expected.count("csv") == 1


# --- loading -----------------------------------------------------------------------------------


def refuses():
    raise ZeroDivisionError("in the constructor")


def exits():
    raise SystemExit(4)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("no_such_package_zq.importer:Importer", "ModuleNotFoundError: No module named"),
        ("openprc.hooks.specs:NoSuchThing", "AttributeError: module 'openprc.hooks.specs' has"),
        (refuses, "failed while being set up: ZeroDivisionError: in the constructor"),
        (exits, "failed while being set up: SystemExit: 4"),
        (7, "failed while being set up: TypeError: 'int' object is not callable"),
    ],
)
def test_code_that_cannot_be_loaded_is_laid_at_its_plugin(
    make_entry, make_code, producer, target, words
):
    load = target if isinstance(target, str) else make_code("Behind", target)
    registry = Registry([make_entry(openprc_producers=[producer("fake", load)])])
    with pytest.raises(PluginError, match="the plugin openprc-fake/fake failed while") as caught:
        registry.load(registry.producer("fake"), capability="import")
    assert words in caught.value.found
    assert "OPENPRC_PLUGIN_DEBUG=1" in caught.value.fix
    assert "openprc-fake/fake" in caught.value.fix
    assert caught.value.exit_code == 1


def test_debug_raises_what_the_code_raised(make_entry, make_code, producer, monkeypatch):
    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", "1")
    registry = Registry(
        [make_entry(openprc_producers=[producer("fake", make_code("Behind", refuses))])]
    )
    with pytest.raises(ZeroDivisionError, match="in the constructor"):
        registry.load(registry.producer("fake"))


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MissingData("nothing there")])
def test_ctrl_c_and_the_packages_own_errors_pass_as_they_are(error):
    with pytest.raises(type(error)) as caught, owned_by("a/b", "trying"):
        raise error
    assert caught.value is error


def test_producers_are_made_and_other_code_is_given_as_it_is(make_entry, make_code, producer):
    load = make_code("Thing", Thing)
    registry = Registry(
        [
            make_entry(
                openprc_producers=[producer("fake", load)],
                openprc_readouts=[ReadoutSpec("r", "A readout", load)],
            )
        ]
    )
    assert isinstance(registry.load(registry.producer("fake")), Thing)
    assert registry.load(registry.find("openprc_readouts", "r")) is Thing


def test_nothing_behind_a_record_is_imported_before_it_is_used(make_entry, producer):
    load = "openprc_imported_too_early:Importer"
    registry = Registry([make_entry(openprc_producers=[producer("fake", load)])])
    item = registry.producer("fake")
    assert availability(item.spec) == "ok"
    assert "openprc_imported_too_early" not in sys.modules
    with pytest.raises(PluginError, match="openprc_imported_too_early"):
        resolve(item, load)


def test_a_capability_that_a_producer_lacks(make_entry, producer):
    registry = Registry([make_entry(openprc_producers=[producer("fake")])])
    with pytest.raises(UnknownName, match="fake cannot run; it can import") as caught:
        registry.load(registry.producer("fake"), capability="run")
    assert "demlat" in caught.value.expected
    assert caught.value.exit_code == 2


# --- missing back ends -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("capabilities", "needs", "state"),
    [
        (("import",), {}, "ok"),
        (("import",), {"import": ("json",)}, "ok"),
        (("import",), {"import": (ABSENT,)}, f"unavailable: needs {ABSENT}"),
        (("run", "import"), {"run": (ABSENT,)}, f"partly: run needs {ABSENT}"),
        (("run", "import"), {"run": (ABSENT,), "import": ()}, f"partly: run needs {ABSENT}"),
        (
            ("run", "import"),
            {"run": (ABSENT, "other_zq"), "import": (ABSENT,)},
            f"unavailable: needs {ABSENT}, other_zq",
        ),
    ],
)
def test_availability(producer, capabilities, needs, state):
    assert availability(producer(capabilities=capabilities, needs=needs)) == state


def test_using_a_producer_without_its_back_end_gives_the_install_line(
    make_entry, make_code, producer
):
    spec = producer(
        "fake",
        make_code("Thing", Thing),
        capabilities=("run", "import"),
        needs={"run": (ABSENT,)},
        install="pip install zeppelin",
    )
    registry = Registry([make_entry(openprc_producers=[spec])])
    item = registry.producer("fake")
    with pytest.raises(MissingDependency, match=f"fake needs {ABSENT} to run") as caught:
        registry.load(item, capability="run")
    assert (caught.value.fix, caught.value.exit_code) == ("pip install zeppelin", 2)
    assert isinstance(registry.load(item, capability="import"), Thing)


def test_without_an_install_line_one_is_made_up_from_the_needs(make_entry, producer):
    spec = producer(needs={"import": (ABSENT, "other_zq")})
    registry = Registry([make_entry(openprc_producers=[spec])])
    with pytest.raises(MissingDependency) as caught:
        registry.load(registry.producer("fake"), capability="import")
    assert caught.value.fix == f"pip install {ABSENT} other_zq"


def test_packages_are_looked_up_and_not_imported(producer, tmp_path, monkeypatch):
    package = tmp_path / "openprc_probe_only"
    package.mkdir()
    (package / "__init__.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    spec = producer(needs={"import": ("openprc_probe_only.deeper",)})
    assert missing_packages(spec, "import") == ()
    assert "openprc_probe_only" not in sys.modules


def test_a_blocked_package_counts_as_missing(producer, monkeypatch):
    monkeypatch.setitem(sys.modules, "wave", None)
    assert missing_packages(producer(needs={"import": ("wave",)}), "import") == ("wave",)


def test_errors_are_of_the_family():
    for kind in (AmbiguousName, MissingDependency, UnknownName):
        assert issubclass(kind, PluginError)
        assert issubclass(kind, OpenPRCError)
