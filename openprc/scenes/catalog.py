"""The scenes there are; nothing is built and nothing heavy is imported before one is asked for."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from openprc.errors import ConfigError
from openprc.scenes.scene import Scene, SceneSpec

SCENES: Mapping[str, SceneSpec] = MappingProxyType({})


def find_scene(name: str) -> SceneSpec:
    """Return the record of a scene.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if name not in SCENES:
        near = difflib.get_close_matches(name, SCENES, n=1)
        raise ConfigError(
            f"the scene {name!r}",
            expected="one of " + ", ".join(SCENES),
            fix=f"did you mean {near[0]!r}?" if near else "see `openprc scenes`",
        )
    return SCENES[name]


def build_scene(name: str, options: Mapping[str, Any] | None = None) -> Scene:
    """Return a scene with its options, given as text or values.

    Raises
    ------
    ConfigError
        When the name or an option is unknown, or a value is wrong.
    """
    spec = find_scene(name)
    module, _, function = spec.load.partition(":")
    scene: Scene = getattr(import_module(module), function)(**dict(options or {}))
    return scene


def write_scene(scene: Scene, folder: str | Path) -> tuple[Path, ...]:
    """Write ``input/{geometry.h5, signals.h5, config.json}`` of a scene below `folder`."""
    from openprc.schema.experiment import save_experiment  # noqa: PLC0415 - reads HDF5

    return save_experiment(scene.experiment, folder)
