"""What is varied: a setting as plain data, and the experiment that it makes of a scene."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.errors import ConfigError
from openprc.tradeoff.outcome import bare

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Geometry

#: Groups of settings that `openprc tradeoff` varies itself, in this order.
ENGINE_GROUPS = ("integrator", "constraints", "precision", "storage", "backend", "model")
#: Groups of what is done with a finished run.
DOWNSTREAM_GROUPS = ("readout", "estimator")
GROUPS = ENGINE_GROUPS + DOWNSTREAM_GROUPS
#: Integrators that are varied unless asked otherwise: repeating old runs is no use of work.
OFFERED = tuple(name for name, scheme in INTEGRATORS.items() if scheme.step != "legacy")
#: Rigid bars in place of stiff ones.
RIGID = "rigid bars"


def key_of(group: str, setting: Mapping[str, Any]) -> str:
    """Return a text that is the same for the same setting."""
    return f"{group} {json.dumps(dict(setting), sort_keys=True)}"


def configured(experiment: Experiment, setting: Mapping[str, Any]) -> Experiment:
    """Return the experiment with a setting.

    Parameters
    ----------
    experiment : Experiment
    setting : mapping
        ``integrator``; ``steps_per_frame`` or ``tolerance``; ``precision``,
        ``constraint_tolerance``, ``step_check``, ``storage`` and ``model`` where they differ
        from what is usual. ``backend`` and ``producer`` say who runs it, and change nothing.

    Examples
    --------
    >>> from openprc.scenes.catalog import build_scene
    >>> from openprc.tradeoff.settings import configured
    >>> scene = build_scene("oscillator").experiment
    >>> configured(scene, {"integrator": "verlet", "steps_per_frame": 4}).steps_per_frame
    4
    """
    made = bare(experiment)
    if setting.get("model") == RIGID:
        made = replace(made, geometry=with_rigid_bars(made.geometry))
    made = replace(
        made,
        integrator=setting.get("integrator", made.integrator),
        tolerance=setting.get("tolerance"),
        constraint_tolerance=setting.get("constraint_tolerance"),
        precision=setting.get("precision", "float64"),
        step_check=setting.get("step_check", "refuse"),
    )
    if "steps_per_frame" in setting:
        made = replace(made, dt=made.save_interval / setting["steps_per_frame"])
    if "storage" in setting:
        made = replace(made, stored=replace(made.stored, precision=setting["storage"]))
    return made


def with_rigid_bars(geometry: Geometry) -> Geometry:
    """Return the body with every bar rigid that could become longer or shorter."""
    bars = geometry.bars
    loose = ~geometry.fixed[bars.indices].all(axis=1)
    lengths = np.linalg.norm(np.diff(geometry.positions[bars.indices], axis=1)[:, 0], axis=1)
    return replace(
        geometry,
        bars=replace(
            bars,
            rigid=bars.rigid | loose,
            # A rigid bar has the length that it starts with.
            rest_length=np.where(loose, lengths, bars.rest_length),
            law=np.where(loose, "linear", bars.law),
            prestress=np.where(loose, 0.0, bars.prestress),
        ),
    )


def check_names(names: tuple[str, ...], offered: tuple[str, ...], *, what: str) -> None:
    """Refuse names that are not offered.

    Raises
    ------
    ConfigError
    """
    unknown = [name for name in names if name not in offered]
    if unknown:
        raise ConfigError(
            f"the {what} {unknown[0]!r}",
            expected="some of " + ", ".join(offered),
            fix="correct the name",
            key=f"--{what}s",
        )
