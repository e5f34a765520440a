"""Which back end runs a scene, and why.

"auto" takes the first of CUDA, JAX and the compiled CPU kernels that is usable: installed, with
a device of its own, and able to do everything that the scene contains. JAX without a GPU or TPU
does not count, because XLA on a CPU is slower than the compiled kernels (`benchmarks/backends.py`
says how much).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from openprc.demlat.backends import devices
from openprc.errors import MissingDependency, UnsupportedScene
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

Name = Literal["cpu", "cuda", "jax"]
_IN_PLACE = "the run used the compiled CPU kernels, whose results differ by rounding only"


@dataclass(frozen=True)
class Choice:
    """A back end, and what the reader of the result should know about the choice.

    Attributes
    ----------
    name : {"cpu", "cuda", "jax"}
    reasons : tuple of str
        Remarks for the file; none where the user asked for what was used.
    """

    name: Name
    reasons: tuple[str, ...] = ()


def choose_backend(
    experiment: Experiment, wanted: Literal["auto", "cpu", "cuda", "jax"] = "auto"
) -> Choice:
    """Return the back end that runs `experiment`.

    A script that asks for CUDA runs on a machine without an NVIDIA device as well, and one that
    asks for JAX where JAX is not installed: then the choice is the CPU, and its reasons say so.

    Raises
    ------
    MissingDependency
        When there is a device for the back end that was asked for, and something else is missing.
    UnsupportedScene
        When the back end that was asked for could run, but not this scene.
    """
    if wanted == "cpu":
        return Choice("cpu")
    if wanted == "auto":
        return _first_usable(experiment)
    probe = devices.probe_cuda() if wanted == "cuda" else devices.probe_jax(only_accelerated=False)
    if not probe.present:
        return Choice("cpu", (f"backend {wanted!r} was asked for, and {probe.found}: {_IN_PLACE}",))
    if not probe.usable:
        raise MissingDependency(
            f"backend {wanted!r} was asked for; there is {probe.found}",
            expected=probe.missing,
            fix=f"install them with `pip install 'openprc[{wanted}]'`, or use backend='cpu'",
            key="backend",
        )
    findings = refusals(experiment, wanted)
    if findings:
        first = findings[0]
        raise UnsupportedScene(
            f"the back end {wanted!r} does not do " + "; ".join(f.found for f in findings),
            expected=first.expected,
            fix=first.fix,
            file=experiment.path,
            key=first.path,
        )
    return Choice(wanted, () if probe.accelerated else (f"backend {wanted!r}: {probe.found}",))


def _first_usable(experiment: Experiment) -> Choice:
    reasons = []
    names: tuple[Literal["cuda", "jax"], ...] = ("cuda", "jax")
    for name in names:
        probe = devices.probe_cuda() if name == "cuda" else devices.probe_jax(only_accelerated=True)
        if not (probe.usable and probe.accelerated):
            reasons.append(probe.found)
            continue
        findings = refusals(experiment, name)
        if not findings:
            reasons.append(probe.found)
            return Choice(name, (f"backend 'auto' chose {name}: " + "; ".join(reasons),))
        reasons.append(f"{name} does not do " + ", ".join(f.found for f in findings))
    return Choice("cpu", ("backend 'auto' chose cpu: " + "; ".join(reasons),))


def refusals(experiment: Experiment, backend: Literal["cuda", "jax"]) -> list[Finding]:
    """Return what of `experiment` the CUDA or JAX back end cannot do; empty means nothing."""
    return list(_refusals(experiment, backend))


def _refusals(experiment: Experiment, backend: str) -> Iterator[Finding]:
    geometry, collision = experiment.geometry, experiment.collision
    hinges = geometry.hinges

    def finding(code: str, path: str, found: str, expected: str) -> Finding:
        fix = "change that, or use backend='cpu'"
        return Finding(f"DEM-{backend.upper()}-{code}", "error", path, found, expected, fix)

    if experiment.integrator != "rk4":
        yield finding(
            "INTEGRATOR",
            "simulation.integrator",
            f"the integrator {experiment.integrator!r}",
            "the integrator 'rk4'",
        )
    for name, rigid in (("bars", geometry.bars.rigid), ("hinges", hinges.rigid)):
        if rigid.any():
            yield finding(
                f"RIGID-{name.upper()}",
                f"elements/{name}/rigid",
                f"{int(rigid.sum())} rigid {name}",
                f"soft {name}",
            )
    if len(geometry.bends):
        yield finding("BENDS", "elements/bends", f"{len(geometry.bends)} bends", "bars and hinges")
    stops = (hinges.law == "linear") & hinges.limited
    if stops.any():
        yield finding(
            "STOPS",
            "elements/hinges/limit_low",
            f"{int(stops.sum())} linear hinges with hard stops",
            "no limits, or hinges of the law 'enhanced-linear'",
        )
    n_collidable = int(geometry.collidable.sum())
    if collision.enabled and n_collidable > (0 if collision.faces else 1):
        yield finding(
            "COLLISION",
            "physics.enable_collision",
            f"contact of {n_collidable} collidable nodes",
            "no contact",
        )
    if experiment.precision != "float64":
        yield finding(
            "PRECISION",
            "simulation.precision",
            f"the precision {experiment.precision!r}",
            "float64: these back ends store positions, not displacements",
        )
