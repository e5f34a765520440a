"""Which terms the engine compiles for a scene, and which it leaves out.

Read off the tables that the compiled loop is specialised for: what is None or empty there has no
code.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.models.barhinge.assembly import LEAST_ELEMENTS, assemble

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.tables import Body
    from openprc.schema.experiment import Experiment

TermState = Literal["runs", "left out", "idle"]

#: What groups of elements are called.
_LAWS = {
    "LinearBars": "linear bars",
    "Cables": "cables",
    "Struts": "struts",
    "OgdenBars": "Ogden bars",
    "CubicBars": "cubic bars",
    "PrintedDampers": "dampers on the relative velocity",
    "LinearHinges": "linear hinges",
    "WalledHinges": "hinges with walls",
    "LinearBends": "bends",
}


@dataclass(frozen=True, kw_only=True)
class EngineTerm:
    """A term of the compiled loop.

    Attributes
    ----------
    name : str
    state : {"runs", "left out", "idle"}
        "idle": there is code for it, which the scene does not need.
    text : str
    """

    name: str
    state: TermState
    text: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self)


def engine_terms(experiment: Experiment) -> tuple[EngineTerm, ...]:
    """Return the terms of the loop that a run of `experiment` would compile on the CPU.

    Parameters
    ----------
    experiment : Experiment
        One that the engine supports; nothing is compiled.
    """
    scheme = INTEGRATORS[experiment.integrator]
    if scheme.step == "legacy":
        return (
            EngineTerm(name="loop", state="runs", text="a program of its own, all terms in it"),
        )
    assembly = assemble([experiment])
    body = assembly.body
    terms = [*_shape(body), *_elements(experiment, body), *_nodal(experiment, body)]
    terms += _idle(experiment, bool(len(body.lanes) > 1))
    ledger = assembly.state.ledger is not None
    terms.append(
        EngineTerm(
            name="energy ledger",
            state="runs" if ledger else "left out",
            text="work and losses are integrated along" if ledger else "",
        )
    )
    return tuple(terms)


def _shape(body: Body) -> Iterator[EngineTerm]:
    width = len(body.lanes)
    number = "float32" if isinstance(body.lanes[0], np.float32) else "float64"
    yield EngineTerm(
        name="loop",
        state="runs",
        text=f"{width} elements at a time, in {number}"
        if width > 1
        else f"element by element, in {number}: one loop for all bodies with fewer than"
        f" {LEAST_ELEMENTS} elements, or of schemes without vectors",
    )
    flat = len(body.space) == 2
    yield EngineTerm(
        name="third axis",
        state="left out" if flat else "runs",
        text="everything stays in the plane z = 0" if flat else "",
    )


def _elements(experiment: Experiment, body: Body) -> Iterator[EngineTerm]:
    geometry = experiment.geometry
    for kind, groups in (("bars", body.bars), ("hinges", body.hinges), ("bends", body.bends)):
        used = {type(group).__name__: 0 for group in groups}
        for group in groups:
            used[type(group).__name__] += int((group.element >= 0).sum())
        active = {name: count for name, count in used.items() if count}
        yield EngineTerm(
            name=kind,
            state="runs" if active else "idle" if used else "left out",
            text=", ".join(f"{count:,} {_LAWS[name]}" for name, count in active.items()),
        )
        dashpots = [getattr(group, "damping", None) for group in groups]
        compiled = any(values is not None for values in dashpots)
        needed = any(values is not None and bool(np.any(values)) for values in dashpots)
        if compiled or len(getattr(geometry, kind)):
            yield EngineTerm(
                name=f"damping of {kind}",
                state="runs" if needed else "idle" if compiled else "left out",
            )
    yield EngineTerm(
        name="rigid elements", state="left out" if body.constraints is None else "runs"
    )


def _nodal(experiment: Experiment, body: Body) -> Iterator[EngineTerm]:
    for name, values, needed in (
        ("gravity", body.weight, any(experiment.gravity)),
        ("drag", body.drag, experiment.damping > 0.0),
        ("actuators", body.drives, len(experiment.actuators) > 0),
    ):
        yield EngineTerm(
            name=name, state="left out" if values is None else "runs" if needed else "idle"
        )
    yield EngineTerm(name="contact", state="runs" if body.contacts else "left out")


def _idle(experiment: Experiment, lean: bool) -> Iterator[EngineTerm]:
    geometry = experiment.geometry
    still = {
        name: int(geometry.fixed[elements.indices].all(axis=1).sum())
        for name, elements in (
            ("bars", geometry.bars),
            ("hinges", geometry.hinges),
            ("bends", geometry.bends),
        )
    }
    if any(still.values()):
        some = ", ".join(f"{count:,} {name}" for name, count in still.items() if count)
        yield EngineTerm(
            name="elements between fixed nodes", state="left out" if lean else "runs", text=some
        )
