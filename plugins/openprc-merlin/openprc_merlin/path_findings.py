"""What statics cannot model in an experiment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.schema import Finding

if TYPE_CHECKING:
    from openprc.schema import Experiment


def path_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield what refuses `experiment` (level "error"), and what has no effect ("warning")."""
    geometry = experiment.geometry
    for path, what in without_effect(experiment).items():
        yield Finding(
            code="MERLIN-NO-EFFECT",
            level="warning",
            path=path,
            found=f"{what}, which has no effect on equilibria",
            expected="an experiment whose result does not depend on it",
            fix="leave it out, or use a producer that integrates the motion",
        )
    for name, elements in (("bars", geometry.bars), ("hinges", geometry.hinges)):
        if elements.rigid.any():
            yield _refused(
                f"RIGID-{name.upper()}",
                f"elements/{name}/rigid",
                f"{int(elements.rigid.sum())} rigid {name}",
                f"{name} with a stiffness: tangents have no place for constraints",
                "give them a stiffness about 100 times that of the soft ones",
            )
    stops = geometry.hinges.limited & (geometry.hinges.law != "enhanced-linear")
    if stops.any():
        yield _refused(
            "STOPS",
            "elements/hinges/limit_low",
            f"hard stops on {int(stops.sum())} hinges",
            "hinges without limits, or of the law 'enhanced-linear'",
            "give them that law, whose moment grows beyond the limits",
        )
    if experiment.collision.enabled and geometry.collidable.sum() > 1:
        yield _refused(
            "CONTACT",
            "physics.enable_collision",
            f"contact between {int(geometry.collidable.sum())} collidable nodes",
            "a scene without contact; 'enhanced-linear' hinges keep panels apart",
            "switch collision off, or use a producer that integrates the motion",
        )
    yield from _actuators(experiment)


def without_effect(experiment: Experiment) -> dict[str, str]:
    """Return what plays no part in a quasi-static run, by its path."""
    geometry = experiment.geometry
    named = {
        "nodes/velocities": ("an initial velocity", geometry.velocities.any()),
        "physics.damping": ("drag", experiment.damping != 0.0),
        **{
            f"elements/{name}/damping": (f"damping of {name}", elements.damping.any())
            for name, elements in (
                ("bars", geometry.bars),
                ("hinges", geometry.hinges),
                ("bends", geometry.bends),
            )
        },
        "elements/bars/damping_cubic": ("damping of bars", geometry.bars.damping_cubic.any()),
    }
    return {path: what for path, (what, is_there) in named.items() if is_there}


def _actuators(experiment: Experiment) -> Iterator[Finding]:
    velocity = experiment.driven_axes("velocity")
    if velocity.any():
        yield _refused(
            "VELOCITY",
            "actuators",
            f"velocity actuators on {int(velocity.any(axis=1).sum())} nodes",
            "positions or forces: a quasi-static run has no velocities",
            "integrate the signal and drive the position",
        )
    if not any(actuator.type in ("position", "force") for actuator in experiment.actuators):
        yield _refused(
            "UNDRIVEN",
            "actuators",
            "nothing drives the body",
            "force actuators, whose values at the end of the run are the reference load, or"
            " position actuators that move",
            "add some; one state of rest is found by openprc.demlat.statics.find_equilibrium",
        )
    held = experiment.held_axes
    for number, actuator in enumerate(experiment.actuators):
        clash = np.flatnonzero(held[actuator.node] & np.array(actuator.axes))
        if actuator.type == "force" and len(clash):
            yield _refused(
                "DEAD-FORCE",
                f"actuators[{number}].axes",
                f"a force on {'xyz'[clash[0]]} of node {actuator.node}, which is held there",
                "forces on axes that can move",
                "drop the axis or the actuator: the force would have no effect",
            )


def _refused(code: str, path: str, found: str, expected: str, fix: str) -> Finding:
    return Finding(
        code=f"MERLIN-{code}", level="error", path=path, found=found, expected=expected, fix=fix
    )
