"""What cannot be done with rigid elements, stops of hinges and implicit steps, and remarks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.models.barhinge.rigid_assembly import knows_constraints, rigid_scene, stops
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


def rigid_refusals(experiment: Experiment) -> Iterator[Finding]:
    """Yield what the experiment's integrator cannot do with its rigid elements and stops."""
    geometry, scheme = experiment.geometry, INTEGRATORS.get(experiment.integrator)
    if scheme is None:
        return
    able = ", ".join(name for name, other in INTEGRATORS.items() if other.rigid != "no")
    for name, elements in (("bars", geometry.bars), ("hinges", geometry.hinges)):
        if elements.rigid.any() and scheme.rigid == "no":
            yield Finding(
                code=f"DEM-RIGID-{name.upper()}",
                level="error",
                path=f"elements/{name}/rigid",
                found=f"{int(elements.rigid.sum())} rigid {name} with the integrator"
                f" {scheme.name!r}",
                expected=f"an integrator for constraints: {able}",
                fix="choose one of these, or give them a stiffness about 100 times that of the"
                " soft ones",
            )
    stopped = stops(geometry)
    if stopped.any() and not scheme.stops:
        able = ", ".join(name for name, other in INTEGRATORS.items() if other.stops)
        yield Finding(
            code="DEM-HINGE-STOPS",
            level="error",
            path="elements/hinges/limit_low",
            found=f"hard stops on {int(stopped.sum())} hinges with the integrator {scheme.name!r}",
            expected=f"an integrator that projects onto stops: {able}",
            fix="choose it, or give these hinges the law 'enhanced-linear', whose moment grows"
            " towards the stops",
        )
    if experiment.precision != "float64" and (scheme.rigid != "no" or not scheme.vectors):
        yield Finding(
            code="DEM-RIGID-PRECISION",
            level="error",
            path="simulation.precision",
            found=f"precision {experiment.precision!r} with the integrator {scheme.name!r}",
            expected="'float64': its equations are solved to more digits than float32 has",
            fix="leave simulation.precision out",
        )
    if scheme.rigid != "no":
        yield from _jumps(experiment)
        rigid = geometry.bars.rigid.any() or geometry.hinges.rigid.any()
        if experiment.collision.enabled and geometry.collidable.any() and not rigid:
            yield Finding(
                code="DEM-RIGID-CONTACT",
                level="error",
                path="physics.enable_collision",
                found=f"contact with the integrator {scheme.name!r}, which is for rigid elements",
                expected="an integrator for soft bodies",
                fix="use rk4: nothing is rigid here",
            )


def _jumps(experiment: Experiment) -> Iterator[Finding]:
    for number, actuator in enumerate(experiment.actuators):
        signal = experiment.signals[actuator.signal]
        moves = bool(np.ptp(signal.values, axis=0).any())
        if actuator.type == "position" and signal.interpolation == "hold" and moves:
            yield Finding(
                code="DEM-RIGID-JUMP",
                level="error",
                path=f"actuators[{number}].signal",
                found=f"the held signal {actuator.signal!r} moves node {actuator.node} at once,"
                f" which rigid elements cannot follow (integrator {experiment.integrator!r})",
                expected="positions without jumps",
                fix="interpolate the signal ('linear' or 'cubic'), or drive velocities",
            )


def rigid_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield what was decided about rigid elements.

    Raises
    ------
    ConfigError
        When they contradict each other or the positions at the start.
    """
    geometry = experiment.geometry
    if knows_constraints(experiment) and (geometry.bars.rigid.any() or geometry.hinges.rigid.any()):
        yield from rigid_scene(experiment).remarks
