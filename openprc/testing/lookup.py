"""From a record, or its name, to the plugin that it belongs to."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

from openprc.hooks.faults import PluginWarning
from openprc.hooks.hookspecs import PLUGIN_API, hookimpl
from openprc.hooks.registry import Registered, Registry


def package_of(load: str) -> str:
    """Return the package of ``"package.module:attribute"``."""
    return load.partition(":")[0].partition(".")[0]


class _Distribution:
    def __init__(self, name: str, version: str) -> None:
        self.name = name
        self.version = version


class ModuleEntry:
    """An entry point that names a module which need not be installed."""

    def __init__(self, module: str, distribution: str, version: str = "0") -> None:
        self.name = module.rpartition(".")[2]
        self.value = module
        self.dist = _Distribution(distribution, version)

    def load(self) -> Any:
        """Import the module."""
        return import_module(self.value)


class RecordEntry(ModuleEntry):
    """An entry point for one record in hand."""

    def __init__(self, record: Any, hook: str) -> None:
        package = package_of(record.load)
        super().__init__(package, package.replace("_", "-"))

        def offer() -> list[Any]:
            return [record]

        offer.__name__ = hook
        self._hooks = type("Hooks", (), {"OPENPRC_PLUGIN_API": PLUGIN_API})
        setattr(self._hooks, hook, staticmethod(hookimpl(offer)))

    def load(self) -> Any:
        """Return an object with the one hook."""
        return self._hooks


def find_record(
    spec: Any, hook: str, registry: Registry, module: str
) -> tuple[Registered, Registry]:
    """Return the record as registered, and a registry that knows it.

    Raises
    ------
    UnknownName, AmbiguousName
        When a name means no record, or several.
    """
    if isinstance(spec, Registered):
        return spec, registry
    if isinstance(spec, str):
        return registry.find(hook, spec), registry
    for item in registry.records(hook):
        if item.spec == spec:
            return item, registry
    entries: list[ModuleEntry] = [RecordEntry(spec, hook)]
    if module:
        entries.insert(0, ModuleEntry(module, module.partition(".")[0].replace("_", "-")))
    for entry in entries:
        with warnings.catch_warnings():
            # What is wrong with the entry module is for the checks to say.
            warnings.simplefilter("ignore", PluginWarning)
            alone = Registry([entry], wanted=entry.name)
        for item in alone.records(hook):
            if item.spec == spec:
                return item, alone
    raise TypeError(f"{spec!r} is not a record for {hook}")


__all__ = ["ModuleEntry", "RecordEntry", "find_record", "package_of"]
