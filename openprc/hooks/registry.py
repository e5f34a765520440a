"""The registry: every record of every plugin, found by name, loaded on first use."""

from __future__ import annotations

import difflib
import os
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from openprc import __version__
from openprc.errors import AmbiguousName, MissingDependency, UnknownName
from openprc.hooks import discovery
from openprc.hooks.discovery import EntryPoint, Plugin
from openprc.hooks.faults import PluginWarning, owned_by
from openprc.hooks.hookspecs import RECORDS
from openprc.hooks.specs import Capability, CodeSpec, ExporterSpec, ProducerSpec

#: What users call a record, by hook.
NOUNS = {hook: hook.removeprefix("openprc_").rstrip("s") for hook in RECORDS}


@dataclass(frozen=True)
class Registered:
    """A record and the plugin that it came from."""

    spec: Any
    hook: str
    distribution: str
    version: str

    @property
    def name(self) -> str:
        """Bare name."""
        return str(self.spec.name)

    @property
    def qualified_name(self) -> str:
        """``distribution/name``, which is never ambiguous."""
        return f"{self.distribution}/{self.spec.name}"


class _BuiltinDistribution:
    """Stands for this package in the listing of its own plugins."""

    name = "openprc"
    version = __version__


class _BuiltinEntryPoint:
    name = "builtin"
    value = "openprc.hooks.builtin"
    dist = _BuiltinDistribution

    def load(self) -> Any:
        return import_module(self.value)


class Registry:
    """Collect plugins.

    Parameters
    ----------
    entry_points : iterable, optional
        Instead of the installed ones; for tests.
    wanted : str, optional
        Comma-separated names of entry points or distributions to let in: OPENPRC_PLUGINS by
        default. An empty string lets none in. What this package brings is always there.
    """

    def __init__(
        self,
        entry_points: Iterable[EntryPoint] | None = None,
        *,
        wanted: str | None = None,
    ) -> None:
        installed = discovery.installed_entry_points() if entry_points is None else entry_points
        chosen = os.environ.get("OPENPRC_PLUGINS") if wanted is None else wanted
        pairs = [(_BuiltinEntryPoint(), True), *discovery.select(installed, chosen)]
        loaded = sorted(
            (discovery.load_plugin(entry, enabled=enabled) for entry, enabled in pairs),
            key=lambda plugin: (plugin.distribution, plugin.name, plugin.module),
        )
        self.plugins: tuple[Plugin, ...] = tuple(_without_doubles(loaded))
        for plugin in self.plugins:
            if plugin.state in ("broken", "incompatible"):
                warnings.warn(
                    f"plugin {plugin.name} ({plugin.distribution} {plugin.version}) is left out: "
                    f"{plugin.problem}; {plugin.fix}",
                    PluginWarning,
                    stacklevel=2,
                )

    # --- finding ---------------------------------------------------------------------------

    def records(self, hook: str) -> tuple[Registered, ...]:
        """Return every record of a hook, sorted by name and distribution."""
        found = [
            Registered(spec, hook, plugin.distribution, plugin.version)
            for plugin in self.plugins
            for spec in plugin.records.get(hook, ())
        ]
        return tuple(sorted(found, key=lambda item: (item.name, item.distribution)))

    def find(self, hook: str, name: str) -> Registered:
        """Return the record that `name` (bare, or ``distribution/name``) means.

        Raises
        ------
        UnknownName
            When there is none; broken plugins are mentioned.
        AmbiguousName
            When several distributions registered a bare name.
        """
        items = self.records(hook)
        found = [item for item in items if name in (item.name, item.qualified_name)]
        if len(found) == 1:
            return found[0]
        noun = NOUNS[hook]
        if found:
            full = [item.qualified_name for item in found]
            raise AmbiguousName(
                f"{len(found)} plugins offer a {noun} named {name!r}",
                expected="one of " + ", ".join(full),
                fix=f"say which, for example {full[0]!r}",
                key=name,
            )
        names = list(dict.fromkeys(item.name for item in items))
        near = difflib.get_close_matches(
            name, [*names, *(item.qualified_name for item in items)], n=1
        )
        broken = [f"{p.name} ({p.problem})" for p in self.plugins if p.problem]
        remark = f"; left out: {', '.join(broken)}" if broken else ""
        raise UnknownName(
            f"there is no {noun} named {name!r}",
            expected="one of " + (", ".join(names) or "none: nothing is registered"),
            fix=(f"did you mean {near[0]!r}?" if near else "see `openprc plugins`") + remark,
            key=name,
        )

    def producer(self, name: str) -> Registered:
        """Return a producer's record; see `find`."""
        return self.find("openprc_producers", name)

    @property
    def producers(self) -> tuple[Registered, ...]:
        """Every producer."""
        return self.records("openprc_producers")

    # --- loading ---------------------------------------------------------------------------

    def load(self, item: Registered, *, capability: Capability | None = None) -> Any:
        """Import the code behind a record and return it; producers are instantiated.

        Raises
        ------
        MissingDependency
            When the record needs a package that is not installed.
        UnknownName
            When the producer has no such capability.
        PluginError
            When its code cannot be loaded.
        """
        spec = item.spec
        if isinstance(spec, ProducerSpec):
            self._check_capability(item, capability)
        if isinstance(spec, ExporterSpec):
            _refuse_missing(item, absent_packages(spec.needs), "export")
        target = resolve(item, spec.load)
        if isinstance(spec, ProducerSpec):
            with owned_by(item.qualified_name, "being set up"):
                return target()
        return target

    def _check_capability(self, item: Registered, capability: Capability | None) -> None:
        spec: ProducerSpec = item.spec
        if capability is None:
            return
        if capability not in spec.capabilities:
            able = [i.name for i in self.producers if capability in i.spec.capabilities]
            raise UnknownName(
                f"{item.name} cannot {capability}; it can {' and '.join(spec.capabilities)}",
                expected=f"a producer that can {capability}: {', '.join(able) or 'none is there'}",
                fix="name another producer",
                key=item.qualified_name,
            )
        _refuse_missing(item, missing_packages(spec, capability), capability)


def _refuse_missing(item: Registered, absent: tuple[str, ...], doing: str) -> None:
    if absent:
        raise MissingDependency(
            f"{item.name} needs {', '.join(absent)} to {doing}, not installed",
            expected=f"an environment with {', '.join(absent)}",
            fix=item.spec.install or f"pip install {' '.join(absent)}",
            key=item.qualified_name,
        )


def _without_doubles(plugins: Iterable[Plugin]) -> Iterator[Plugin]:
    """Take back the plugins whose ``distribution/name`` another one of that distribution has."""
    owners: dict[tuple[str, str, str], str] = {}
    for plugin in plugins:
        keys = [
            (plugin.distribution, hook, str(spec.name))
            for hook, specs in plugin.records.items()
            for spec in specs
        ]
        taken = next((key for key in keys if key in owners), None)
        if taken is None:
            owners.update(dict.fromkeys(keys, plugin.name))
            yield plugin
            continue
        yield replace(
            plugin,
            state="broken",
            problem=f"{taken[1]} returned {taken[2]!r}, which {owners[taken]} of the same "
            "distribution offers already",
            fix="give each its own name",
            records={},
        )


def resolve(item: Registered, target: str) -> Any:
    """Import ``"package.module:attribute"`` on behalf of a record."""
    module_name, _, attribute = target.partition(":")
    with owned_by(item.qualified_name, f"loading {target}"):
        return getattr(import_module(module_name), attribute)


def missing_packages(spec: ProducerSpec, capability: Capability) -> tuple[str, ...]:
    """Return which of the packages that a capability needs cannot be imported.

    They are looked up, not imported.
    """
    return absent_packages(spec.needs.get(capability, ()))


def absent_packages(names: Iterable[str]) -> tuple[str, ...]:
    """Return which of these import names cannot be imported; they are looked up only."""
    return tuple(name for name in names if not _is_installed(name))


def _is_installed(name: str) -> bool:
    try:
        return find_spec(name.partition(".")[0]) is not None
    except (ImportError, ValueError):
        return False


def availability(spec: ProducerSpec) -> str:
    """Return ``ok``, or which capabilities are unavailable and what they need."""
    absent = {c: missing_packages(spec, c) for c in spec.capabilities}
    if not any(absent.values()):
        return "ok"
    needs = ", ".join(sorted({name for names in absent.values() for name in names}))
    lost = [c for c, names in absent.items() if names]
    if len(lost) == len(spec.capabilities):
        return f"unavailable: needs {needs}"
    return f"partly: {', '.join(lost)} needs {needs}"


@cache
def default_registry() -> Registry:
    """Return the registry of the installed plugins, made once a process."""
    return Registry()


__all__ = ["CodeSpec", "Registered", "Registry", "availability", "default_registry"]
