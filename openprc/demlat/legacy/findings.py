"""What the stepping of openprc up to 0.1.1 cannot do, and what its results are worth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.contact.findings import can_touch
from openprc.demlat.planning.stability import step_limit
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Name of the integrator.
LEGACY = "legacy"


def legacy_refusals(experiment: Experiment) -> Iterator[Finding]:
    """Yield what that program did not have, did otherwise, or left out without a word.

    Rigid elements are refused with those of the other schemes.
    """
    geometry = experiment.geometry
    bars, hinges = geometry.bars, geometry.hinges
    if (bars.law != "linear").any() or (hinges.law != "linear").any():
        yield _refusal("elements/*/law", "an element with a law of its own", "linear elements")
    if len(geometry.bends):
        yield _refusal("elements/bends", "a bend", "bars and hinges")
    if hinges.damping.any():
        yield _refusal("elements/hinges/damping", "a hinge with damping", "undamped hinges")
    if hinges.limited.any():
        yield _refusal("elements/hinges/limit_low", "a hinge with limits", "hinges without limits")
    if experiment.bar_damping != "axial":
        yield _refusal(
            "physics.bar_damping", f"bar_damping {experiment.bar_damping!r}", "axial dashpots"
        )
    if experiment.precision != "float64":
        yield _refusal("simulation.precision", experiment.precision, "float64")
    if any(experiment.gravity[:2]):
        yield _refusal("physics.gravity", "gravity that is not along z", "gravity along z")
    if can_touch(experiment):
        yield _refusal("physics.enable_collision", "contact", "a scene without contact")
    yield from _drive_refusals(experiment)


def _drive_refusals(experiment: Experiment) -> Iterator[Finding]:
    seen: set[int] = set()
    for number, actuator in enumerate(experiment.actuators):
        key = f"actuators[{number}]"
        if actuator.type == "velocity":
            yield _refusal(f"{key}.type", "an actuator of a velocity", "positions and forces")
        if not all(actuator.axes):
            # Depending on the version and the type it drove the others as well.
            yield _refusal(f"{key}.axes", "an actuator of some axes only", "all three axes")
        if actuator.node in seen:
            yield _refusal(
                f"{key}.node", f"a second actuator of node {actuator.node}", "one for a node"
            )
        seen.add(actuator.node)


def _refusal(path: str, found: str, expected: str) -> Finding:
    return Finding(
        code="DEM-LEGACY",
        level="error",
        path=path,
        found=f"{found} with the integrator {LEGACY!r}",
        expected=f"{expected}: it reproduces a program that had nothing else",
        fix="choose another integrator, such as 'rk4'",
    )


def legacy_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield what a reader of the result should know."""
    limit = step_limit(experiment)
    gain, loss = 0.5 * limit.omega**2 * experiment.dt, 2.0 * limit.zeta * limit.omega
    yield (
        "integrator 'legacy' repeats the stepping of openprc up to 0.1.1, to reproduce stored runs:"
        " it is of first order and feeds energy into the motion, exp(w^2 dt t / 2) for a mode of"
        f" angular frequency w. The energy of the fastest one ({limit.omega:.3g} rad/s) grows by"
        f" {gain:.2g} per s that way, and damping takes {loss:.2g} per s"
    )
    yield (
        "integrator 'legacy' takes the nearest sample of a signal and holds it during a step, and"
        " rounds saved positions and velocities to float32"
    )
    # That program cut off the decimals where this one rounds.
    cut = max(1, int(experiment.save_interval / experiment.dt))
    if cut != experiment.steps_per_frame:
        yield (
            f"openprc up to 0.1.1 saved every {cut} steps for this save_interval, not every"
            f" {experiment.steps_per_frame}: its frames are not at the times of these"
        )
    if np.any(experiment.geometry.velocities):
        yield "openprc up to 0.1.1 had no initial velocities: it would have started at rest"
