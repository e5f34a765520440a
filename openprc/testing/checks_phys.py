"""PHYS: motions known in closed form, and the order at which they are approached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from openprc.schema.trajectory import Trajectory
from openprc.testing import closed_form_elements as elements
from openprc.testing import closed_form_scenes as scenes
from openprc.testing.cases import RunnerCase
from openprc.testing.check import check
from openprc.testing.closed_form_scenes import Array, Scene
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.simulations import refusal, run

Make = Callable[[float], Scene]

#: Steps of the order test, in units of the scene's own; the coarsest first.
COARSER = (4.0, 2.0, 1.0)
#: Least order, and the error relative to the scale below which it is not asked for: methods
#: that choose their step, or are of high order, are there already.
ORDER, PRECISE = 0.9, 1e-6

#: Number of the check: what it is about, and scenes of which the first that is modelled is taken.
_SCENES: dict[str, tuple[str, Sequence[Make]]] = {
    "PHYS-1": ("free fall", (scenes.free_fall, partial(scenes.free_fall, as_chain=True))),
    "PHYS-2": ("an oscillator without damping", (scenes.oscillator,)),
    "PHYS-3": ("an oscillator with a dashpot", (partial(scenes.oscillator, damping=0.5),)),
    "PHYS-4": ("a node slowed by a medium", (scenes.drag, partial(scenes.oscillator, drag=0.5))),
    "PHYS-5": ("a pendulum at large amplitude",
               (partial(scenes.pendulum, rigid=True), scenes.pendulum)),
    "PHYS-6": ("the centre of two free masses", (scenes.momentum,)),
    "PHYS-7": ("a body at rest", (scenes.rest, partial(scenes.rest, elements="bars"),
                                  partial(scenes.rest, elements="chain"))),
    "PHYS-8": ("an inextensible bar that turns", (partial(elements.spinning_pair, rigid=True),)),
    "PHYS-9": ("a spring that turns", (partial(elements.spinning_pair, rigid=False),)),
    "PHYS-10": ("a chain that vibrates along its axis",
                (elements.longitudinal_chain,
                 partial(elements.longitudinal_chain, bend=2.0),
                 partial(elements.longitudinal_chain, bend=2.0, clamped=2))),
    "PHYS-11": ("a wing on a hinge", (elements.hinge,)),
    "PHYS-12": ("an arm on a bending spring", (elements.bend,)),
}  # fmt: skip


def modelled(case: RunnerCase, makes: Sequence[Make], *, coarser: float = 1.0) -> Scene:
    """Return the first scene that the runner can model.

    Raises
    ------
    NotApplicable
        With the reason of the runner, when it can model none.
    """
    if case.record.time == ("pseudo",):
        raise NotApplicable("it makes load steps: nothing moves in physical time")
    reasons = []
    for make in makes:
        scene = make(case.dt_factor * coarser)
        reason = refusal(case, scene.experiment)
        if not reason:
            return scene
        reasons.append(reason)
    raise NotApplicable(f"not modelled: {reasons[0]}")


def motion(case: RunnerCase, scene: Scene, out: Path) -> tuple[Array, Array]:
    """Run a scene; return the motion found and the exact one, (T, N, 3) [m]."""
    run(case, scene.experiment, out)
    with Trajectory(out) as trajectory:
        if trajectory.time_kind == "pseudo":
            raise NotApplicable("it makes load steps: nothing moves in physical time")
        times, found = trajectory.time, trajectory.positions(unit="m")
    if found.shape[2] == 2:
        # A planar scene may be stored in the plane; out of it nothing moves.
        found = np.concatenate([found, np.zeros((*found.shape[:2], 1))], axis=2)
    exact = scene.exact(times)
    if scene.centre_only:
        masses = scene.experiment.geometry.masses
        found, exact = (
            np.einsum("n,tnx->tx", masses, x)[:, np.newaxis] / masses.sum() for x in (found, exact)
        )
    if found.shape != exact.shape:
        fail(
            f"positions of shape {found.shape}",
            expected=f"{exact.shape}",
            fix="record every node of the experiment in every frame",
        )
    return found, exact


def _judge(case: RunnerCase, folder: Path, *, number: str) -> None:
    what, makes = _SCENES[number]
    scene = modelled(case, makes)
    found, exact = motion(case, scene, folder / "scene.h5")
    off = np.linalg.norm(found - exact, axis=2)
    worst = float(off.max()) / scene.scale if np.isfinite(off).all() else np.inf
    if worst > scene.tolerance:
        frame, node = np.unravel_index(int(np.nanargmax(off)), off.shape)
        at = frame * scene.experiment.save_interval
        fail(
            f"{what}: node {node} is {off[frame, node]:.3g} m away from the closed form at "
            f"t = {at:g} s, {worst:.3g} of the scale of the motion",
            expected=f"at most {scene.tolerance:g} with dt = {scene.experiment.dt:g} s",
            fix="compare forces, masses and the first steps with the closed form of the scene "
            f"({_first_line(makes[0])})",
        )


def _first_line(make: Make) -> str:
    function = getattr(make, "func", make)
    return (function.__doc__ or "").partition("\n")[0].rstrip(".")


def _register() -> None:
    for number, (what, _) in _SCENES.items():

        def look(case: RunnerCase, folder: Path, number: str = number) -> None:
            _judge(case, folder, number=number)

        look.__doc__ = f"Run {what} and compare with the closed form."
        check(number, f"{what} moves as in closed form", "runner")(look)


_register()


@check("PHYS-13", "the error falls at least with the first power of the time step", "runner")
def order_of_convergence(case: RunnerCase, folder: Path) -> None:
    """Halve the step twice on an oscillator, or a vibrating chain."""
    makes = (scenes.oscillator, *_SCENES["PHYS-10"][1])
    errors = []
    for coarser in COARSER:
        scene = modelled(case, makes, coarser=coarser)
        found, exact = motion(case, scene, folder / f"{coarser:g}.h5")
        errors.append(float(np.linalg.norm(found - exact, axis=2).max()) / scene.scale)
    if errors[-1] <= PRECISE:
        return
    order = float(np.log(errors[0] / errors[-1]) / np.log(COARSER[0] / COARSER[-1]))
    if not order >= ORDER:
        shown = ", ".join(f"{error:.3g}" for error in errors)
        fail(
            f"errors {shown} for steps {COARSER} times {scene.experiment.dt:g} s: order "
            f"{order:.2g}",
            expected=f"at least {ORDER:g}, or an error below {PRECISE:g}",
            fix="look for a force that is missing or left on, which no small step mends",
        )


__all__ = ["COARSER", "modelled", "motion"]
