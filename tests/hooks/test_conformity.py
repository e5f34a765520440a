"""Every record of this repository names code that is there and offers its protocol."""

from __future__ import annotations

import inspect
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from openprc.analysis.tasks.registered import registered_task
from openprc.analysis.tasks.task import Task
from openprc.hooks import hookspecs, protocols
from openprc.hooks.discovery import load_plugin
from openprc.hooks.hookspecs import GROUP, RECORDS
from openprc.hooks.registry import Registry, missing_packages, resolve

ROOT = Path(__file__).resolve().parents[2]
PLUGINS = sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml"))

CAPABILITIES = {
    "import": (protocols.Importer, {"sniff": ["path"],
                                    "import_run": ["path", "writer", "options"]}),
    "run": (protocols.Runner, {"supports": ["experiment"],
                               "run": ["experiment", "writer", "seed", "progress"]}),
    "record": (protocols.Recorder, {"attach": ["simulator", "writer"]}),
}  # fmt: skip

#: Hook to the methods that the code behind its records offers; None: it is called itself.
METHODS = {
    "openprc_exporters": {"export": 2},
    "openprc_features": {"transform": 1, "names": 1},
    "openprc_readouts": {"fit": 2, "predict": 1},
    "openprc_benchmarks": {"run": 2},
    "openprc_detectors": {"detect": 1},
}


def entry_of(folder, make_entry):
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    ((name, module),) = project["entry-points"][GROUP].items()
    return make_entry(name, dist=project["name"], content=import_module(module))


@pytest.fixture(scope="session")
def _importable():
    """Plugins are importable whether or not they are installed."""
    with pytest.MonkeyPatch.context() as patch:
        for folder in PLUGINS:
            patch.syspath_prepend(folder)
        yield


@pytest.fixture
def registry(_importable, make_entry):
    return Registry([entry_of(folder, make_entry) for folder in PLUGINS])


def parameters(function):
    return [
        p.name
        for p in inspect.signature(function).parameters.values()
        if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]


def test_there_are_plugins():
    assert [folder.name for folder in PLUGINS] == [
        "openprc-example", "openprc-h5md", "openprc-merlin", "openprc-meshio", "openprc-prcpy",
        "openprc-pybullet", "openprc-pyelastica",
    ]  # fmt: skip


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
@pytest.mark.usefixtures("_importable")
def test_every_plugin_loads_and_registers_something(make_entry, folder):
    plugin = load_plugin(entry_of(folder, make_entry))
    assert (plugin.state, plugin.problem) == ("ok", "")
    assert any(plugin.records.values())
    for hook, records in plugin.records.items():
        assert all(isinstance(record, RECORDS[hook]) for record in records)


def test_every_producer_offers_what_it_is_capable_of(registry):
    assert {item.name for item in registry.producers} >= {
        "demlat", "legacy", "vision", "csv", "h5md", "merlin", "meshio", "prcpy", "pybullet",
        "pyelastica",
    }  # fmt: skip
    for item in registry.producers:
        for capability in item.spec.capabilities:
            if missing_packages(item.spec, capability):
                continue
            made = registry.load(item, capability=capability)
            protocol, methods = CAPABILITIES[capability]
            assert isinstance(made, protocol), item.qualified_name
            for name, wanted in methods.items():
                found = parameters(getattr(made, name))
                assert found[: len(wanted)] == wanted, (item.qualified_name, name)
            if capability == "run":
                assert ("options" in parameters(made.run)) == bool(item.spec.run_options)


def test_every_sample_is_there(registry):
    for item in registry.producers:
        if item.spec.sample:
            assert parameters(resolve(item, item.spec.sample)) == ["folder"], item.qualified_name
    brought = {item.name for item in registry.producers if item.spec.sample}
    assert brought >= {"demlat", "vision", "csv", "merlin", "prcpy", "pybullet", "pyelastica"}


@pytest.mark.parametrize("hook", METHODS)
def test_the_code_of_every_other_record_has_its_methods(registry, hook):
    items = registry.records(hook)
    assert items
    for item in items:
        code = registry.load(item)
        for name, count in METHODS[hook].items():
            function = getattr(code, name)
            # The class is given, not an object, so `self` counts.
            assert len(parameters(function)) >= count + inspect.isclass(code), (
                item.qualified_name, name,
            )  # fmt: skip
            if hook == "openprc_exporters":
                assert parameters(function)[-1] == "options", item.qualified_name


def test_features_and_readouts_are_made_without_arguments(registry):
    for hook in ("openprc_features", "openprc_readouts"):
        for item in registry.records(hook):
            registry.load(item)()


def test_tasks_are_made_without_arguments(registry):
    for item in registry.records("openprc_tasks"):
        task = registered_task(item.name, registry=registry)
        assert isinstance(task, Task), item.qualified_name
        assert task.metadata()["formula"], item.qualified_name
        assert task.metadata()["source"], item.qualified_name


def test_extensions_are_checks_of_one_argument(registry):
    for item in registry.records("openprc_extensions"):
        assert len(parameters(registry.load(item))) == 1, item.qualified_name
        # The package's own tracker writes under a name of its own, as a plugin would.
        own = item.distribution == "openprc" and item.spec.name.startswith("openprc-")
        assert own or item.spec.name == item.distribution


def test_hints_of_names_do_not_collide_with_options(registry):
    for item in registry.producers:
        names = [option.name for option in item.spec.options]
        assert "trust" not in names, item.qualified_name
    exporters = registry.records("openprc_exporters")
    for item in exporters:
        assert "final" not in [option.name for option in item.spec.options], item.qualified_name
    for item in (*registry.producers, *exporters):
        for option in (*item.spec.options, *getattr(item.spec, "run_options", ())):
            assert option.help.strip(), (item.qualified_name, option.name)
            if option.choices:
                given = option.default if option.multiple else (option.default,)
                assert set(given or ()) <= {None, *option.choices}, option.name


def test_every_hook_has_a_record_type_an_example_and_a_user(registry):
    marked = {
        name
        for name, value in vars(hookspecs).items()
        if getattr(value, f"{GROUP}_spec", None) is not None
    }
    assert marked == set(RECORDS)
    for name in marked:
        hook = getattr(hookspecs, name)
        assert parameters(hook) == []
        assert "return [" in inspect.getdoc(hook)
        assert registry.records(name), f"nobody uses {name}"


def test_protocols_tell_importers_from_other_things():
    class Importer:
        def sniff(self, path):
            return 0.0

        def import_run(self, path, writer, *, options):
            return None

    assert isinstance(Importer(), protocols.Importer)
    assert not isinstance(Importer(), protocols.Runner)
    assert not isinstance(object(), protocols.Importer)
