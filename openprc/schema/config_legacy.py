"""The older layout of config.json, translated into the present one before validation.

The older layout has ``simulation.{duration, dt_base, dt_save}``, ``global_physics``,
``material`` and actuators with ``node_idx``, ``signal_name`` and ``dof``. Mistakes are
reported under those names, since those are the ones in the user's file.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: New path to old path, both dotted; actuators are handled one by one.
_SIMULATION = {
    "duration": "duration",
    "dt_base": "dt",
    "dt": "dt",
    "dt_save": "save_interval",
    "save_interval": "save_interval",
}
_PHYSICS = {
    "gravity": "gravity",
    "global_damping": "damping",
    "enable_collision": "enable_collision",
    "collision_radius": "collision_radius",
    "collision_restitution": "collision_restitution",
    "collision_iterations": "collision_iterations",
}
_ACTUATOR = {
    "node_idx": "node",
    "node_id": "node",
    "signal_name": "signal",
    "signal": "signal",
    "type": "type",
    "dof": "axes",
}
#: A copy of global_damping that only a post-processor ever read.
_MATERIAL = {"damping_coefficient": ""}
_ROOT = ("simulation", "global_physics", "material", "actuators")


@dataclass
class OldNames:
    """Where each translated field stood in the user's file, and what had no place there."""

    renamed: dict[tuple[int | str, ...], str] = field(default_factory=dict)
    #: (the user's key, what is wrong with it, what to do)
    mistakes: list[tuple[str, str, str]] = field(default_factory=list)

    def user_key(self, path: tuple[int | str, ...]) -> str:
        """Return the name in the user's file for a path in the present layout."""
        tail = ""
        while path:
            if path in self.renamed:
                return self.renamed[path] + tail
            part = path[-1]
            tail = (f"[{part}]" if isinstance(part, int) else f".{part}") + tail
            path = path[:-1]
        return tail.lstrip(".")

    def unknown_key(self, where: str, key: str, known: list[str]) -> None:
        """Remember a key that has no meaning, with the nearest one that has."""
        close = difflib.get_close_matches(key.lower(), known, n=1, cutoff=0.5)
        hint = f"did you mean {close[0]!r}?" if close else "remove it; known: " + ", ".join(known)
        self.mistakes.append((f"{where}.{key}" if where else key, "unknown key", hint))


def is_legacy(data: Mapping[str, Any]) -> bool:
    """Say whether `data` has the older layout: no version, and one of its own key names."""
    if "openprc_config" in data:
        return False
    simulation = data.get("simulation")
    if "global_physics" in data or "material" in data:
        return True
    if isinstance(simulation, Mapping) and ("dt_base" in simulation or "dt_save" in simulation):
        return True
    actuators = data.get("actuators")
    return isinstance(actuators, list) and any(
        isinstance(entry, Mapping) and {"node_idx", "node_id", "signal_name", "dof"} & set(entry)
        for entry in actuators
    )


def translate(data: Mapping[str, Any]) -> tuple[dict[str, Any], OldNames]:
    """Return the same settings in the present layout, and the names they came from.

    Values are passed on unchanged, right or wrong: validation happens once, afterwards.
    """
    names = OldNames()
    new: dict[str, Any] = {"openprc_config": "1.0"}
    for key in data:
        if key not in _ROOT:
            names.unknown_key("", key, list(_ROOT))
    new["simulation"] = _section(data, "simulation", "simulation", _SIMULATION, names)
    for target, old in (("dt", "dt_base"), ("save_interval", "dt_save")):
        names.renamed.setdefault(("simulation", target), f"simulation.{old}")
    new["physics"] = _section(data, "global_physics", "physics", _PHYSICS, names)
    physics = new["physics"]
    if isinstance(physics, dict):
        # Programs disagree about the default (0 or -9.81), so the file has to say it.
        if "gravity" not in physics:
            names.mistakes.append(
                ("global_physics.gravity", "the key is missing", "write 0 or -9.81 [m/s2]")
            )
        # Old programs wrote switches as 0 and 1.
        if physics.get("enable_collision") in (0, 1):
            physics["enable_collision"] = bool(physics["enable_collision"])
    _section(data, "material", "material", _MATERIAL, names)
    new["actuators"] = _actuators(data.get("actuators", []), names)
    return new, names


def _section(
    data: Mapping[str, Any], old: str, new: str, table: Mapping[str, str], names: OldNames
) -> Any:
    names.renamed[(new,)] = old
    section = data.get(old, {})
    if not isinstance(section, Mapping):
        return section
    result: dict[str, Any] = {}
    for key, value in section.items():
        if key not in table:
            names.unknown_key(old, key, list(table))
            continue
        if table[key] in result:
            names.mistakes.append((f"{old}.{key}", f"gives {table[key]!r} again", "remove it"))
            continue
        result[table[key]] = value
        names.renamed[(new, table[key])] = f"{old}.{key}"
    return result


def _actuators(entries: Any, names: OldNames) -> Any:
    if not isinstance(entries, list):
        return entries
    result: list[Any] = []
    for number, entry in enumerate(entries):
        where = f"actuators[{number}]"
        if not isinstance(entry, Mapping):
            result.append(entry)
            continue
        translated: dict[str, Any] = {}
        for key, value in entry.items():
            if key not in _ACTUATOR:
                names.unknown_key(where, key, list(_ACTUATOR))
                continue
            translated[_ACTUATOR[key]] = value
            names.renamed[("actuators", number, _ACTUATOR[key])] = f"{where}.{key}"
        axes = translated.get("axes")
        if isinstance(axes, list) and all(axis in (0, 1) for axis in axes):
            translated["axes"] = [bool(axis) for axis in axes]
        for target, old in (("node", "node_idx"), ("signal", "signal_name")):
            names.renamed.setdefault(("actuators", number, target), f"{where}.{old}")
        result.append(translated)
    return result
