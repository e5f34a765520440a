"""Every way in which a plugin can be wrong before it is used."""

from __future__ import annotations

import warnings
from types import ModuleType, SimpleNamespace

import pytest

from openprc.hooks import FeatureSpec, Registry, default_registry, discovery, hookimpl
from openprc.hooks.faults import PluginWarning
from openprc.hooks.hookspecs import RECORDS


class Outrage(BaseException):
    """Not even an Exception."""


def load(entry):
    return discovery.load_plugin(entry)


def marked(function, name):
    function.__name__ = name
    return hookimpl(function)


def raises_midway(good, error):
    def hook():
        yield good
        raise error

    return hook


# --- broken plugins ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ImportError("no module named zeppelin"), "ImportError: no module named zeppelin"),
        (SystemExit(3), "SystemExit: 3"),
        (SystemExit(), "cannot be imported: SystemExit"),
        (Outrage("boo"), "Outrage: boo"),
        (SyntaxError("line 3"), "SyntaxError: line 3"),
        (RecursionError(), "RecursionError"),
        (ValueError("two\nlines"), "ValueError: two lines"),
        (AttributeError("module has no attribute 'x'"), "has no attribute 'x'"),
        (GeneratorExit(), "GeneratorExit"),
    ],
)
def test_a_plugin_that_raises_on_import_is_broken(make_entry, error, words):
    plugin = load(make_entry(content=error))
    assert (plugin.state, plugin.records) == ("broken", {})
    assert plugin.problem.startswith("it cannot be imported: ")
    assert words in plugin.problem
    assert "OPENPRC_PLUGIN_DEBUG=1" in plugin.fix


@pytest.mark.parametrize(
    ("api", "state", "problem", "fix"),
    [
        (None, "broken", "does not say which plugin API", 'set OPENPRC_PLUGIN_API = "1.0"'),
        ("1", "broken", "OPENPRC_PLUGIN_API is '1'", 'write MAJOR.MINOR, such as "1.0"'),
        ("1.0.0", "broken", "OPENPRC_PLUGIN_API is '1.0.0'", "write MAJOR.MINOR"),
        ("one", "broken", "OPENPRC_PLUGIN_API is 'one'", "write MAJOR.MINOR"),
        ("", "broken", "OPENPRC_PLUGIN_API is ''", "write MAJOR.MINOR"),
        ("1.0\n", "broken", "OPENPRC_PLUGIN_API is '1.0", "write MAJOR.MINOR"),
        (1.0, "broken", "OPENPRC_PLUGIN_API is 1.0", "write MAJOR.MINOR"),
        ((1, 0), "broken", "OPENPRC_PLUGIN_API is (1, 0)", "write MAJOR.MINOR"),
        ("2.0", "incompatible", "plugin API 2.0; this openprc has 1.0", "update openprc"),
        ("10.0", "incompatible", "plugin API 10.0", "update openprc"),
        ("0.9", "incompatible", "plugin API 0.9; this openprc has 1.0", "update the plugin"),
    ],
)
def test_the_api_version(make_entry, producer, api, state, problem, fix):
    plugin = load(make_entry(api=api, openprc_producers=[producer()]))
    assert (plugin.state, plugin.records) == (state, {})
    assert problem in plugin.problem
    assert fix in plugin.fix


@pytest.mark.parametrize("api", ["1.0", "1.7", "1.12"])
def test_any_minor_version_of_the_same_major_is_taken(make_entry, producer, api):
    assert load(make_entry(api=api, openprc_producers=[producer()])).state == "ok"


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("openprc_producer", "did you mean openprc_producers?"),
        ("openprc_feature", "did you mean openprc_features?"),
        ("openprc_readuots", "did you mean openprc_readouts?"),
        ("something_else", "hooks: openprc_producers, "),
    ],
)
def test_a_misspelt_hook_names_the_nearest(make_entry, make_module, producer, name, near):
    hooks = {name: marked(lambda: [], name)}
    hooks["openprc_producers"] = marked(lambda: [producer()], "openprc_producers")
    plugin = load(make_entry(content=make_module(**hooks)))
    assert (plugin.state, plugin.problem) == ("broken", f"there is no hook {name}")
    assert plugin.fix.startswith(near)
    assert plugin.records == {}


def test_a_hook_without_its_marker_is_not_passed_over_silently(make_entry, make_module, producer):
    plugin = load(make_entry(content=make_module(openprc_producers=lambda: [producer()])))
    assert (plugin.state, plugin.fix) == ("broken", "put @hookimpl above it")
    assert plugin.problem == "openprc_producers is not marked as a hook"


def test_a_hook_with_an_argument_is_refused(make_entry, make_module):
    hook = marked(lambda registry: [], "openprc_producers")
    plugin = load(make_entry(content=make_module(openprc_producers=hook)))
    assert plugin.state == "broken"
    assert plugin.problem.startswith("a hook has the wrong signature: PluginValidationError")
    assert "registry" in plugin.problem
    assert plugin.fix.startswith("hooks take no arguments")


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (None, "openprc_producers failed: TypeError"),
        ("csv", "openprc_producers returned str"),
        (b"csv", "openprc_producers returned bytes"),
        ({"csv": 1}, "openprc_producers returned dict"),
        (7, "openprc_producers failed: TypeError"),
        (["csv"], "openprc_producers returned a str"),
        ([None], "openprc_producers returned a NoneType"),
        ([FeatureSpec("f", "A feature", "a:b")], "openprc_producers returned a FeatureSpec"),
    ],
)
def test_a_wrong_return_value_is_refused(make_entry, returned, words):
    plugin = load(make_entry(openprc_producers=returned))
    assert (plugin.state, plugin.fix) == ("broken", "return a list of ProducerSpec")
    assert words in plugin.problem


@pytest.mark.parametrize("error", [ZeroDivisionError("1/0"), SystemExit(1), Outrage("boo")])
def test_a_generator_that_raises_midway_registers_nothing(make_entry, make_module, producer, error):
    hook = marked(raises_midway(producer(), error), "openprc_producers")
    plugin = load(make_entry(content=make_module(openprc_producers=hook)))
    assert (plugin.state, plugin.records) == ("broken", {})
    assert f"openprc_producers failed: {type(error).__name__}" in plugin.problem


def test_a_generator_is_as_good_as_a_list(make_entry, make_module, producer):
    def hook():
        yield producer("one")
        yield producer("two")

    plugin = load(make_entry(content=make_module(openprc_producers=hookimpl(hook))))
    assert [spec.name for spec in plugin.records["openprc_producers"]] == ["one", "two"]


def test_a_single_record_instead_of_a_list_is_refused(make_entry, producer):
    plugin = load(make_entry(openprc_producers=producer()))
    assert plugin.state == "broken"
    assert "not iterable" in plugin.problem


def test_an_invalid_record_is_the_fault_of_its_plugin(make_entry, make_module, producer):
    hook = marked(lambda: [producer("Not A Name")], "openprc_producers")
    plugin = load(make_entry(content=make_module(openprc_producers=hook)))
    assert plugin.state == "broken"
    assert "ProducerSpec.name is 'Not A Name'" in plugin.problem


def test_two_records_of_one_name_in_a_plugin_are_refused(make_entry, producer):
    plugin = load(make_entry(openprc_producers=[producer("a"), producer("b"), producer("a")]))
    assert plugin.problem == "openprc_producers returned 'a' twice"
    assert plugin.fix == "give each its own name"


def test_one_bad_hook_takes_back_what_the_good_ones_registered(make_entry, producer):
    entry = make_entry(
        openprc_producers=[producer()],
        openprc_features=[FeatureSpec("f", "A feature", "a:b")],
        openprc_readouts=None,
    )
    plugin = load(entry)
    assert (plugin.state, plugin.records) == ("broken", {})
    with pytest.warns(PluginWarning, match="openprc_readouts failed"):
        registry = Registry([entry])
    assert "fake" not in [item.name for item in registry.producers]
    assert "f" not in [item.name for item in registry.records("openprc_features")]


def test_a_module_that_raises_when_looked_at_is_broken(make_entry):
    class Trap(ModuleType):
        OPENPRC_PLUGIN_API = "1.0"

        def __dir__(self):
            raise RuntimeError("do not look")

    plugin = load(make_entry(content=Trap("trap")))
    assert plugin.state == "broken"
    assert plugin.problem == "it cannot be looked at: RuntimeError: do not look"


def test_a_plugin_without_hooks_is_harmless(make_entry, make_module):
    plugin = load(make_entry(content=make_module()))
    assert (plugin.state, plugin.records) == ("ok", {})


def test_hooks_may_be_methods_of_an_object(make_entry, producer):
    class Hooks:
        OPENPRC_PLUGIN_API = "1.0"

        @hookimpl
        def openprc_producers(self):
            return [producer("from-a-method")]

    plugin = load(make_entry(content=Hooks()))
    assert [spec.name for spec in plugin.records["openprc_producers"]] == ["from-a-method"]


def test_every_hook_is_collected(make_entry, producer):
    records = {
        hook: [producer() if hook == "openprc_producers" else kind("x", "An x", "a:b")]
        for hook, kind in RECORDS.items()
    }
    assert set(load(make_entry(**records)).records) == set(RECORDS)


# --- what gets out -----------------------------------------------------------------------------


def test_each_faulty_plugin_gives_exactly_one_warning_and_the_others_load(make_entry, producer):
    entries = [
        make_entry("import", content=SystemExit(1)),
        make_entry("old", api="0.1"),
        make_entry("none", openprc_producers=None),
        make_entry("fine", openprc_producers=[producer("fine")]),
    ]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        registry = Registry(entries)
    texts = [str(item.message) for item in caught]
    assert [item.category for item in caught] == [PluginWarning] * 3
    for name in ("import", "old", "none"):
        assert sum(f"plugin {name} (openprc-{name} 0.1) is left out" in t for t in texts) == 1
    assert "fine" in [item.name for item in registry.producers]
    states = {plugin.name: plugin.state for plugin in registry.plugins}
    assert states == {
        "builtin": "ok", "fine": "ok", "import": "broken", "none": "broken", "old": "incompatible",
    }  # fmt: skip


def test_ctrl_c_passes(make_entry, make_module):
    def hook():
        raise KeyboardInterrupt

    class Trap(ModuleType):
        OPENPRC_PLUGIN_API = "1.0"

        def __dir__(self):
            raise KeyboardInterrupt

    for content in (
        KeyboardInterrupt(),
        make_module(openprc_producers=marked(hook, "openprc_producers")),
        Trap("trap"),
    ):
        with pytest.raises(KeyboardInterrupt):
            Registry([make_entry(content=content)])


@pytest.mark.parametrize("value", ["1", "yes"])
def test_debug_raises_and_shows_the_cause(make_entry, make_module, monkeypatch, value):
    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", value)
    error = ZeroDivisionError("here")
    hook = marked(raises_midway(None, error), "openprc_producers")
    for content in (error, make_module(openprc_producers=hook)):
        with pytest.raises(Exception, match="ZeroDivisionError: here") as caught:
            Registry([make_entry(content=content)])
        assert caught.value.__cause__ is error
    with pytest.raises(Exception, match="does not say which plugin API"):
        Registry([make_entry(api=None)])


def test_debug_0_is_off(make_entry, monkeypatch):
    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", "0")
    with pytest.warns(PluginWarning, match="left out"):
        Registry([make_entry(content=ImportError("x"))])


# --- which are let in --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "loaded"),
    [
        (None, ["a", "b", "c"]),
        ("", []),
        (" , ", []),
        ("a", ["a"]),
        ("a,c", ["a", "c"]),
        (" c , a ", ["a", "c"]),
        ("openprc-b", ["b"]),
        ("nobody", []),
    ],
)
def test_openprc_plugins_chooses(make_entry, producer, monkeypatch, wanted, loaded):
    if wanted is not None:
        monkeypatch.setenv("OPENPRC_PLUGINS", wanted)
    entries = [make_entry(name, openprc_producers=[producer(name)]) for name in "abc"]
    registry = Registry(entries)
    here = [p.name for p in registry.plugins if p.state == "ok" and p.name != "builtin"]
    assert here == loaded
    assert [entry.name for entry in entries if entry.loads] == loaded
    left_out = [p for p in registry.plugins if p.state == "disabled"]
    assert {p.problem for p in left_out} <= {"left out by OPENPRC_PLUGINS"}
    # What the package itself brings is always there.
    assert "demlat" in [item.name for item in registry.producers]


def test_a_disabled_plugin_is_never_imported_and_gives_no_warning(make_entry):
    entry = make_entry(content=SystemExit(1))
    (plugin,) = [p for p in Registry([entry], wanted="").plugins if p.name == "fake"]
    assert plugin.state == "disabled"
    assert entry.loads == 0


# --- entry points ------------------------------------------------------------------------------


def test_installed_entry_points_are_unique_and_sorted(make_entry, monkeypatch):
    entries = [make_entry(name, content=ModuleType("x")) for name in "cab"]
    doubled = [*entries, *reversed(entries)]
    monkeypatch.setattr(discovery.metadata, "entry_points", lambda group: doubled)
    assert [entry.name for entry in discovery.installed_entry_points()] == ["a", "b", "c"]


def test_only_the_group_of_the_package_is_asked_for(monkeypatch):
    asked = []
    monkeypatch.setattr(
        discovery.metadata, "entry_points", lambda **words: asked.append(words) or []
    )
    assert discovery.installed_entry_points() == []
    assert asked == [{"group": "openprc"}]


def test_an_entry_point_without_a_distribution_is_unknown(make_entry, producer):
    entry = make_entry(openprc_producers=[producer()])
    entry.dist = None
    plugin = load(entry)
    assert (plugin.distribution, plugin.version, plugin.state) == ("unknown", "unknown", "ok")


def test_the_default_registry_is_made_once_from_the_installed_ones(
    make_entry, producer, monkeypatch
):
    entry = make_entry(openprc_producers=[producer()])
    monkeypatch.setattr(discovery, "installed_entry_points", lambda: [entry])
    assert default_registry() is default_registry()
    assert entry.loads == 1
    assert default_registry().producer("fake").distribution == "openprc-fake"


def test_a_dist_is_read_for_name_and_version_only(make_entry):
    entry = make_entry(content=ImportError("x"))
    entry.dist = SimpleNamespace(name="dist", version="9")
    plugin = load(entry)
    assert (plugin.distribution, plugin.version, plugin.module) == ("dist", "9", "openprc_fake")
