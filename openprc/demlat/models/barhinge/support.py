"""What the bar-hinge model cannot represent, and what a reader of its results should know."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.contact.findings import contact_refusals, contact_remarks
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.legacy.findings import LEGACY, legacy_refusals, legacy_remarks
from openprc.demlat.models.barhinge.rigid_findings import rigid_refusals, rigid_remarks
from openprc.demlat.planning.phase_drift import drift_remarks
from openprc.demlat.planning.stability import is_surely_sound, step_limit
from openprc.demlat.planning.tangent_operators import hinge_flatness
from openprc.demlat.signal_table import SAMPLE_SLACK, sample_signal
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: A coordinate beyond this many times the size of the scene is no result but a blow-up.
ESCAPE_FACTOR = 1e6
#: Altitude of a wing over the crease, per longest edge, below which a run says so.
THIN_WING = 1e-3


def scene_size(experiment: Experiment) -> float:
    """Return a length [m] that every coordinate of a sound run stays comparable to."""
    geometry, duration = experiment.geometry, experiment.duration
    lengths = [np.abs(geometry.positions).max(), np.max(geometry.bars.rest_length, initial=0.0)]
    # Flights of free nodes over the whole duration are sound as well.
    lengths.append(np.abs(geometry.velocities).max() * duration)
    lengths.append(np.abs(experiment.gravity).max() * duration**2)
    lightest = np.min(geometry.masses[geometry.masses > 0], initial=np.inf)
    for actuator in experiment.actuators:
        largest = np.abs(experiment.signals[actuator.signal].values).max()
        reach = {
            "position": largest,
            "velocity": largest * duration,
            "force": largest / lightest * duration**2,
        }
        lengths.append(reach[actuator.type])
    return float(max(lengths)) or 1.0


# --- what cannot be done, and what should be known -------------------------------------------


def supports(experiment: Experiment) -> list[Finding]:
    """Return what the engine cannot model in `experiment`; empty means all of it."""
    return list(_refusals(experiment))


def _refusals(experiment: Experiment) -> Iterator[Finding]:
    geometry = experiment.geometry
    scheme = INTEGRATORS.get(experiment.integrator)
    yield from rigid_refusals(experiment)
    yield from contact_refusals(experiment)
    if experiment.integrator == LEGACY:
        yield from legacy_refusals(experiment)
    if scheme is not None and scheme.step == "adaptive":
        yield from _tolerance(experiment)
    if experiment.integrator not in INTEGRATORS:
        yield Finding(
            code="DEM-INTEGRATOR",
            level="error",
            path="simulation.integrator",
            found=f"the integrator {experiment.integrator!r}",
            expected="one of " + ", ".join(INTEGRATORS),
            fix="choose one of these",
        )
    prescribed = experiment.held_axes
    for number, actuator in enumerate(experiment.actuators):
        clash = np.flatnonzero(prescribed[actuator.node] & np.array(actuator.axes))
        if actuator.type == "force" and len(clash):
            fixed = geometry.fixed[actuator.node]
            yield Finding(
                code="DEM-DEAD-FORCE",
                level="error",
                path=f"actuators[{number}].axes",
                found=f"a force on {'xyz'[clash[0]]} of node {actuator.node}, which is "
                + ("fixed" if fixed else "driven"),
                expected="forces on axes that can move",
                fix="drop the axis or the actuator: the force would have no effect",
            )
    power = geometry.hinges.law == "four-thirds"
    if power.any():
        yield Finding(
            code="DEM-HINGE-LAW",
            level="error",
            path="elements/hinges/law",
            found=f"the law 'four-thirds' on {int(power.sum())} hinges",
            expected="'linear' or 'enhanced-linear': the engine has no other; this one is without"
            " stiffness at rest and made for quasi-static runs",
            fix="give them a linear stiffness, or run it with --producer merlin",
        )
    degenerate = list(_degenerate_hinges(experiment))
    yield from degenerate
    if scheme is not None and not degenerate and experiment.step_check == "refuse":
        yield from _unstable_step(experiment)


def _tolerance(experiment: Experiment) -> Iterator[Finding]:
    least = 10.0 * float(np.finfo(experiment.precision).eps)
    if experiment.tolerance is not None and experiment.tolerance < least:
        yield Finding(
            code="DEM-TOLERANCE",
            level="error",
            path="simulation.tolerance",
            found=f"the tolerance {experiment.tolerance:g} in {experiment.precision}",
            expected=f"at least {least:.2g}, ten times the rounding of a number",
            fix="give a larger one",
        )


def _unstable_step(experiment: Experiment) -> Iterator[Finding]:
    if is_surely_sound(experiment):
        return
    limit = step_limit(experiment)
    if experiment.dt > limit.limit:
        yield Finding(
            code="DEM-UNSTABLE-STEP",
            level="error",
            path="simulation.dt",
            found=f"dt = {experiment.dt:g} s with the integrator {limit.scheme!r}, whose motion"
            f" would blow up: {limit.setter} sets the stability limit",
            expected=f"at most {limit.limit:.4g} s",
            fix=f"take {limit.recommended:.3g} s or less (set_simulation_params(dt='auto') does),"
            " choose an integrator that chooses its step, or set simulation.step_check to 'warn'",
        )


def _degenerate_hinges(experiment: Experiment) -> Iterator[Finding]:
    positions, indices = experiment.geometry.positions, experiment.geometry.hinges.indices
    if len(indices) == 0:
        return
    j, k, i, l = (positions[indices[:, column]] for column in range(4))  # noqa: E741
    crease = np.linalg.norm(k - j, axis=1)
    heights = [np.linalg.norm(np.cross(wing - j, k - j), axis=1) for wing in (i, l)]
    # Height over the crease times its length, against the square of the size of the hinge.
    size = np.max([np.linalg.norm(wing - j, axis=1) for wing in (i, k, l)], axis=0)
    bad = np.flatnonzero(np.minimum(*heights) <= 1e-9 * size**2)
    if len(bad) or not crease.all():
        yield Finding(
            code="DEM-DEGENERATE-HINGE",
            level="error",
            path="elements/hinges/indices",
            found=f"hinge {int(bad[0])} {indices[bad[0]].tolist()} has a wing on its crease line",
            expected="four nodes that form two triangles",
            fix="give the nodes in the order [j, k, i, l]: crease first, then the wings",
        )


def remarks(experiment: Experiment) -> Iterator[str]:
    """Yield what the reader of the result should know; nothing of it stops the run."""
    yield from experiment.notes
    yield from _step_remarks(experiment)
    yield from drift_remarks(experiment)
    yield from _thin_hinges(experiment)
    yield from contact_remarks(experiment)
    yield from rigid_remarks(experiment)
    if experiment.integrator == LEGACY:
        yield from legacy_remarks(experiment)
    step = experiment.save_interval / experiment.steps_per_frame
    for name in dict.fromkeys(actuator.signal for actuator in experiment.actuators):
        signal = experiment.signals[name]
        if signal.duration < experiment.duration - 1.5 * signal.dt:
            yield (
                f"signal {name!r} ends at {signal.duration:g} s of {experiment.duration:g} s:"
                " its last value stays"
            )
        ratio = signal.dt / step
        if signal.interpolation != "cubic" and abs(ratio - round(ratio)) > SAMPLE_SLACK:
            yield (
                f"samples of signal {name!r} ({signal.dt:g} s apart) do not fall on time steps"
                f" ({step:g} s): the error there is of lower order than 4"
            )
    yield from _initial_jumps(experiment)


def _step_remarks(experiment: Experiment) -> Iterator[str]:
    if is_surely_sound(experiment):
        return
    remark = step_limit(experiment).remark(experiment.dt)
    if remark:
        yield remark


def _thin_hinges(experiment: Experiment) -> Iterator[str]:
    hinges = experiment.geometry.hinges
    flatness = hinge_flatness(experiment.geometry.positions, hinges.indices)
    thin = np.flatnonzero((flatness < THIN_WING) & (hinges.rigid | (hinges.stiffness > 0.0)))
    if len(thin):
        yield (
            f"{len(thin)} hinges have a wing close to the crease line, such as hinge"
            f" {int(thin[0])} ({flatness[thin[0]]:.2g} of its longest edge): forces go as one over"
            " that distance, and steps that are sound at the start may not be later"
        )


def _initial_jumps(experiment: Experiment) -> Iterator[str]:
    geometry = experiment.geometry
    size = float(np.ptp(geometry.positions, axis=0).max())
    for actuator in experiment.actuators:
        if actuator.type != "position":
            continue
        target = sample_signal(experiment.signals[actuator.signal], np.zeros(1))[0]
        gap = np.where(actuator.axes, target - geometry.positions[actuator.node], 0.0)
        if np.abs(gap).max() > 1e-6 * size:
            yield (
                f"signal {actuator.signal!r} starts {np.abs(gap).max():.3g} m away from where"
                f" node {actuator.node} is in the geometry: the run starts with the node moved"
            )
