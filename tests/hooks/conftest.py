"""Plugins in memory: entry points that nothing is installed for, and code behind records."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from experiments import write_spring

from openprc.hooks import ProducerSpec, Registry, default_registry, hookimpl


@dataclass
class FakeEntryPoint:
    """What discovery uses of an entry point; `content` is the module, or what load() raises."""

    name: str
    content: Any
    dist: Any = None
    value: str = ""
    loads: int = field(default=0)

    def load(self):
        self.loads += 1
        if isinstance(self.content, BaseException):
            raise self.content
        return self.content


@pytest.fixture(autouse=True)
def _clean_environment(monkeypatch):
    for name in ("OPENPRC_PLUGINS", "OPENPRC_PLUGIN_DEBUG", "OPENPRC_DEBUG"):
        monkeypatch.delenv(name, raising=False)
    default_registry.cache_clear()
    yield
    default_registry.cache_clear()


@pytest.fixture
def make_module():
    """Return a function that makes a plugin's entry module from hook functions."""

    def make(api="1.0", name="fake_plugin", **attributes):
        module = ModuleType(name)
        if api is not None:
            module.OPENPRC_PLUGIN_API = api
        for key, value in attributes.items():
            setattr(module, key, value)
        return module

    return make


@pytest.fixture
def make_entry(make_module):
    """Return a function that makes an entry point; records are given by hook."""

    def make(name="fake", *, content=None, dist=None, version="0.1", api="1.0", **records):
        def hook_of(items):
            return hookimpl(lambda: items)

        if content is None:
            content = make_module(api, **{key: hook_of(items) for key, items in records.items()})
        distribution = SimpleNamespace(name=dist or f"openprc-{name}", version=version)
        return FakeEntryPoint(name, content, distribution, value=f"openprc_{name}")

    return make


@pytest.fixture
def make_code(monkeypatch):
    """Return a function that makes a module importable, and gives the ``load`` text."""
    made = []

    def make(attribute, value):
        name = f"openprc_test_code_{len(made)}"
        module = ModuleType(name)
        setattr(module, attribute, value)
        monkeypatch.setitem(sys.modules, name, module)
        made.append(name)
        return f"{name}:{attribute}"

    return make


@pytest.fixture
def producer():
    """Return a function that makes a record of a producer that imports."""

    def make(name="fake", load="openprc_fake.importer:Importer", **fields):
        fields = {"summary": "A fake", "capabilities": ("import",), **fields}
        return ProducerSpec(name=name, load=load, **fields)

    return make


@pytest.fixture
def registry_of(make_entry, make_code, producer):
    """Return a function that makes a registry of importers given by their sniff().

    ``registry_of(fake=lambda path: 0.7)``; a class is taken as the importer itself.
    """

    def make(fields=None, **importers):
        entries = []
        for name, behind in importers.items():
            if not isinstance(behind, type):
                behind = type("Importer", (), {"sniff": staticmethod(behind)})
            spec = producer(name, make_code("Importer", behind), **(fields or {}).get(name, {}))
            entries.append(make_entry(name, openprc_producers=[spec]))
        return Registry(entries)

    return make


@pytest.fixture
def experiment_folder(tmp_path) -> Path:
    """A folder with two nodes on a spring, one of them driven: 11 frames."""
    return write_spring(tmp_path / "spring")
