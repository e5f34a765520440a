"""What the runner models, what it refuses, and what a reader of its results should know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema import Experiment

#: Fixed-step schemes whose place leapfrog takes, with a hint; the rest is refused.
REPLACED = ("rk4", "pefrl", "respa", "midpoint", "rattle", "rk4-dae", "rk4-projection")
OWN = "verlet"


def as_leapfrog(experiment: Experiment) -> Experiment:
    """Return the experiment with the engine's name for the scheme that the runner uses."""
    return replace(experiment, integrator=OWN, precision="float64")


def refusals(experiment: Experiment) -> Iterator[Finding]:
    """Yield what the runner cannot model ("error"), and what it does differently ("hint")."""
    own = list(_own_refusals(experiment))
    yield from own
    if not any(finding.level == "error" for finding in own):
        # The engine knows what its force laws and the step of this scheme can do.
        from openprc.demlat.models.barhinge.support import supports  # noqa: PLC0415

        yield from supports(as_leapfrog(experiment))


def _own_refusals(experiment: Experiment) -> Iterator[Finding]:
    geometry = experiment.geometry
    yield from _integrator(experiment)
    for name, elements in (("bars", geometry.bars), ("hinges", geometry.hinges)):
        if elements.rigid.any():
            yield Finding(
                code=f"PYB-RIGID-{name.upper()}",
                level="error",
                path=f"elements/{name}/rigid",
                found=f"{int(elements.rigid.sum())} rigid {name}: PyBullet offers no constraint on"
                " a distance or a dihedral angle of points",
                expected="soft ones, whose forces can be applied",
                fix="give them a stiffness about 100 times that of the soft ones, or run it with"
                " demlat (rattle)",
            )
    stopped = geometry.hinges.limited & (geometry.hinges.law == "linear")
    if stopped.any():
        yield Finding(
            code="PYB-HINGE-STOPS",
            level="error",
            path="elements/hinges/limit_low",
            found=f"hard stops on {int(stopped.sum())} hinges, which act by impacts",
            expected="hinges that forces can describe",
            fix="give them the law 'enhanced-linear', whose moment grows towards the stops, or run"
            " it with demlat (rk4-projection)",
        )
    if experiment.collision.enabled and geometry.collidable.any():
        yield Finding(
            code="PYB-CONTACT",
            level="error",
            path="physics.enable_collision",
            found="contact: PyBullet's impacts do not obey the coefficient of restitution (with 1 a"
            " ball bounces higher than it fell from)",
            expected="a body without contact",
            fix="set enable_collision to false, or run it with demlat",
        )
    if experiment.precision != "float64":
        yield Finding(
            code="PYB-PRECISION",
            level="error",
            path="simulation.precision",
            found=f"the precision {experiment.precision!r}",
            expected="'float64', in which PyBullet computes",
            fix="leave simulation.precision out; export.precision may be float32",
        )


def _integrator(experiment: Experiment) -> Iterator[Finding]:
    name = experiment.integrator
    if name == OWN:
        return
    if name in REPLACED:
        yield Finding(
            code="PYB-INTEGRATOR",
            level="hint",
            path="simulation.integrator",
            found=f"the integrator {name!r}: PyBullet has one of its own, of second order",
            expected=f"{OWN!r}, which is the same scheme in demlat",
            fix=f"compare with demlat's {OWN}, or mind that errors differ",
        )
        return
    yield Finding(
        code="PYB-INTEGRATOR",
        level="error",
        path="simulation.integrator",
        found=f"the integrator {name!r}",
        expected=f"one with a fixed step, best {OWN!r}: PyBullet steps evenly, to no tolerance",
        fix=f"say --integrator {OWN}, and choose dt by the accuracy that is wanted",
    )


def scene_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield what the engine would remark about the scene with this scheme, and the scheme."""
    from openprc.demlat.models.barhinge.support import remarks  # noqa: PLC0415

    if experiment.integrator != OWN:
        yield (
            f"the experiment names the integrator {experiment.integrator!r}, which PyBullet does"
            " not have"
        )
    yield from remarks(as_leapfrog(experiment))
