"""Loading one plugin, or saying why not."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from types import ModuleType
from typing import Any, Literal, Protocol

import pluggy

from openprc.hooks import hookspecs
from openprc.hooks.faults import debugging, reason
from openprc.hooks.hookspecs import GROUP, PLUGIN_API, RECORDS

State = Literal["ok", "broken", "incompatible", "disabled"]

_REPORT = "reinstall or remove it; OPENPRC_PLUGIN_DEBUG=1 shows the trace"


class EntryPoint(Protocol):
    """What of `importlib.metadata.EntryPoint` is used here."""

    @property
    def name(self) -> str:
        """Name of the plugin."""
        ...

    @property
    def value(self) -> str:
        """Module that it names."""
        ...

    @property
    def dist(self) -> Any:
        """Distribution that it belongs to, with ``name`` and ``version``, or None."""
        ...

    def load(self) -> Any:
        """Import the module."""
        ...


@dataclass(frozen=True)
class Plugin:
    """A plugin as discovered: where it comes from, what it registered, or why it did not."""

    name: str
    module: str
    distribution: str
    version: str
    state: State
    problem: str = ""
    fix: str = ""
    records: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)


class _Refused(Exception):
    """Why a plugin is not taken: state, problem, and what to do."""

    def __init__(self, state: State, problem: str, fix: str) -> None:
        super().__init__(problem)
        self.state, self.problem, self.fix = state, problem, fix


def installed_entry_points() -> list[EntryPoint]:
    """Return the entry points of the group, each once, in a fixed order."""
    unique: dict[tuple[str, str, str], EntryPoint] = {}
    for entry in metadata.entry_points(group=GROUP):
        unique.setdefault((distribution_of(entry)[0], entry.name, entry.value), entry)
    return [unique[key] for key in sorted(unique)]


def distribution_of(entry: EntryPoint) -> tuple[str, str]:
    """Return name and version of the distribution that an entry point belongs to."""
    dist = getattr(entry, "dist", None)
    if dist is None:
        return "unknown", "unknown"
    return str(dist.name), str(dist.version)


def load_plugin(entry: EntryPoint, *, enabled: bool = True) -> Plugin:
    """Import an entry point's module and collect its records, or report its fault.

    Nothing that the plugin raises gets out, unless OPENPRC_PLUGIN_DEBUG is set. Ctrl-C does.
    """
    name, version = distribution_of(entry)
    about: dict[str, Any] = {
        "name": entry.name,
        "module": entry.value,
        "distribution": name,
        "version": version,
    }
    if not enabled:
        return Plugin(**about, state="disabled", problem="left out by OPENPRC_PLUGINS")
    try:
        records = _collect(entry)
    except _Refused as refused:
        if debugging():
            raise
        return Plugin(**about, state=refused.state, problem=refused.problem, fix=refused.fix)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # Looking at the names of a module runs its code, too: __getattr__, __dir__, properties.
        if debugging():
            raise
        problem = f"it cannot be looked at: {reason(error)}"
        return Plugin(**about, state="broken", problem=problem, fix=_REPORT)
    return Plugin(**about, state="ok", records=records)


def _collect(entry: EntryPoint) -> dict[str, tuple[Any, ...]]:
    module = _import(entry)
    _check_api(module)
    manager = pluggy.PluginManager(GROUP)
    manager.add_hookspecs(hookspecs)
    try:
        manager.register(module, entry.name)
    except pluggy.PluginValidationError as error:
        raise _Refused(
            "broken",
            f"a hook has the wrong signature: {reason(error)}",
            "hooks take no arguments, see openprc.hooks.hookspecs",
        ) from error
    _check_hook_names(module)
    records: dict[str, tuple[Any, ...]] = {}
    for caller in manager.get_hookcallers(module) or []:
        for implementation in caller.get_hookimpls():
            records[caller.name] = _call(caller.name, implementation.function)
    return records


def _import(entry: EntryPoint) -> ModuleType:
    try:
        module = entry.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise _Refused(
            "broken",
            f"it cannot be imported: {reason(error)}",
            _REPORT,
        ) from error
    return module  # type: ignore[no-any-return]


def _check_api(module: ModuleType) -> None:
    stated = getattr(module, "OPENPRC_PLUGIN_API", None)
    if stated is None:
        raise _Refused(
            "broken",
            "it does not say which plugin API it was written for",
            f'set OPENPRC_PLUGIN_API = "{PLUGIN_API}" in {getattr(module, "__name__", "it")}',
        )
    found = re.fullmatch(r"(\d+)\.(\d+)", stated) if isinstance(stated, str) else None
    if found is None:
        raise _Refused(
            "broken",
            f"OPENPRC_PLUGIN_API is {stated!r}",
            f'write MAJOR.MINOR, such as "{PLUGIN_API}"',
        )
    mine = PLUGIN_API.partition(".")[0]
    if found[1] != mine:
        newer = int(found[1]) > int(mine)
        raise _Refused(
            "incompatible",
            f"it was written for plugin API {stated}; this openprc has {PLUGIN_API}",
            "update openprc" if newer else "update the plugin",
        )


def _check_hook_names(module: ModuleType) -> None:
    for name in dir(module):
        value = getattr(module, name, None)
        if getattr(value, f"{GROUP}_impl", None) is None:
            if name in RECORDS and callable(value):
                raise _Refused(
                    "broken", f"{name} is not marked as a hook", "put @hookimpl above it"
                )
            continue
        if name not in RECORDS:
            near = difflib.get_close_matches(name, RECORDS, n=1)
            hint = f"did you mean {near[0]}?" if near else "hooks: " + ", ".join(RECORDS)
            raise _Refused("broken", f"there is no hook {name}", hint)


def _call(hook: str, function: Any) -> tuple[Any, ...]:
    wanted = RECORDS[hook]
    fix = f"return a list of {wanted.__name__}"
    try:
        returned = function()
        items = None if isinstance(returned, str | bytes | Mapping) else tuple(returned)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise _Refused("broken", f"{hook} failed: {reason(error)}", fix) from error
    if items is None:
        raise _Refused("broken", f"{hook} returned {type(returned).__name__}", fix)
    for item in items:
        if not isinstance(item, wanted):
            raise _Refused("broken", f"{hook} returned a {type(item).__name__}", fix)
    names = [item.name for item in items]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise _Refused("broken", f"{hook} returned {double!r} twice", "give each its own name")
    return items


def select(entries: Iterable[EntryPoint], wanted: str | None) -> list[tuple[EntryPoint, bool]]:
    """Pair every entry point with whether OPENPRC_PLUGINS (`wanted`) lets it in."""
    if wanted is None:
        return [(entry, True) for entry in entries]
    names = {name.strip() for name in wanted.split(",") if name.strip()}
    return [(entry, bool({entry.name, distribution_of(entry)[0]} & names)) for entry in entries]
