"""What is studied: a scene of the library, or an experiment folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from openprc.errors import ConfigError
from openprc.scenes.catalog import build_scene
from openprc.scenes.scene import Reference, Scene
from openprc.schema.experiment import Experiment, load_experiment


def find_subject(name: str, options: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene of that name, or the experiment in the folder of that name.

    Raises
    ------
    ConfigError
        When there is neither, or an option is wrong.
    """
    folder = Path(name)
    if not folder.is_dir():
        return build_scene(name, options)
    if options:
        raise ConfigError(
            f"the option {next(iter(options))!r} of an experiment folder",
            expected="options of a scene of the library only",
            fix="change the experiment itself",
            key="--set",
        )
    return as_scene(load_experiment(folder), name=folder.resolve().name)


def as_scene(experiment: Experiment, *, name: str) -> Scene:
    """Return an experiment as a scene of which nothing is known."""
    symbols = [
        actuator.signal
        for actuator in experiment.actuators
        if experiment.signals[actuator.signal].sequence is not None
    ]
    return Scene(
        name=name,
        experiment=experiment,
        reference=Reference(
            kind="converged", text="nothing is known of its motion", source="this study"
        ),
        scale=1.0,
        input_name=symbols[0] if symbols else None,
    )
