"""Which physics an experiment uses, with counts: what has to be modelled, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment
    from openprc.schema.geometry import Bars, Hinges

#: Names of physics that need what `openprc.hooks.specs.ELEMENTS` calls differently.
_ELEMENT_OF = {
    "nodes": "nodes",
    "bars": "bars",
    "rigid bars": "bars",
    "hinges": "hinges",
    "rigid hinges": "hinges",
    "bends": "bends",
    "gravity": "gravity",
    "drag": "damping",
    "bar damping": "damping",
    "hinge damping": "damping",
    "bend damping": "damping",
    "contact of nodes": "contact",
    "contact with faces": "contact",
    "position drives": "position-actuators",
    "force drives": "force-actuators",
    "velocity drives": "velocity-actuators",
}


@dataclass(frozen=True, kw_only=True)
class Physics:
    """One thing that a scene uses.

    Parameters
    ----------
    name : str
        Such as "bars", "hinge damping", "force drives".
    count : int
        How many elements, nodes or actuators it concerns; of "dimensions", 2 or 3.
    text : str
        What is to be known besides: laws, ranges, interpolants.
    """

    name: str
    count: int
    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {"name": self.name, "count": self.count, "text": self.text}


def physics_of(experiment: Experiment) -> tuple[Physics, ...]:
    """Return what an experiment uses; what is not there is not listed.

    Parameters
    ----------
    experiment : Experiment

    Examples
    --------
    >>> from openprc.scenes.physics import physics_of
    >>> from openprc.schema.experiment import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> bars = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0], damping=[0.1])
    >>> body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    >>> scene = Experiment(geometry=body, duration=1.0, dt=0.05, save_interval=0.1)
    >>> [item.name for item in physics_of(scene)]
    ['nodes', 'dimensions', 'bars', 'bar damping']
    """
    return tuple(item for item in _all(experiment) if item.count)


def elements_of(experiment: Experiment) -> tuple[str, ...]:
    """Return what an experiment uses in the words of `openprc.hooks.specs.ELEMENTS`."""
    named = (_ELEMENT_OF.get(item.name) for item in physics_of(experiment))
    return tuple(dict.fromkeys(name for name in named if name is not None))


def _all(experiment: Experiment) -> Iterator[Physics]:
    geometry = experiment.geometry
    massless = ~(geometry.masses > 0.0)
    yield _nodes(experiment)
    yield Physics(
        name="dimensions",
        count=2 if experiment.planar else 3,
        text="everything stays in the plane z = 0" if experiment.planar else "motion in space",
    )
    yield Physics(
        name="massless nodes",
        count=int(massless.sum()),
        text=f"{int((massless & ~geometry.fixed).sum())} of them not fixed",
    )
    moving = np.linalg.norm(geometry.velocities, axis=1)
    yield Physics(
        name="initial velocities",
        count=int((moving > 0.0).sum()),
        text=f"up to {moving.max(initial=0.0):.3g} m/s",
    )
    yield from _bars(experiment, geometry.bars)
    yield from _hinges(geometry.hinges)
    bends = geometry.bends
    curved = int((np.abs(bends.rest_angle - np.pi) > 1e-9).sum())
    yield Physics(
        name="bends",
        count=len(bends),
        text=f"{_range(bends.stiffness, 'N*m/rad')}; {curved} rest at an angle"
        if curved
        else f"{_range(bends.stiffness, 'N*m/rad')}; all rest straight",
    )
    yield _damping("bend damping", bends.damping, "N*m*s/rad")
    yield from _fields(experiment)
    yield from _contact(experiment)
    yield from _drives(experiment)


def _nodes(experiment: Experiment) -> Physics:
    geometry, held = experiment.geometry, experiment.held_axes
    driven = held.any(axis=1) & ~geometry.fixed
    return Physics(
        name="nodes",
        count=geometry.n_nodes,
        text=f"{int(geometry.fixed.sum()):,} fixed, {int(driven.sum()):,} with a prescribed motion;"
        f" {int((~held).sum()):,} free coordinates",
    )


def _bars(experiment: Experiment, bars: Bars) -> Iterator[Physics]:
    soft = ~bars.rigid
    yield Physics(
        name="bars",
        count=int(soft.sum()),
        text=f"{_laws(bars.law[soft])}; {_range(bars.stiffness[soft], 'N/m')}",
    )
    yield Physics(
        name="rigid bars", count=int(bars.rigid.sum()), text="their lengths are constraints"
    )
    stressed = bars.prestress != 0.0
    yield Physics(
        name="prestress",
        count=int(stressed.sum()),
        text=f"relaxed at {_range(1.0 + bars.prestress[stressed], 'rest lengths')}",
    )
    printed = experiment.bar_damping == "printed"
    law = "the whole relative velocity" if printed else "the rate of the length"
    damping = _damping(
        "bar damping", np.where(soft, bars.damping, 0.0), "1" if printed else "N*s/m"
    )
    yield Physics(name=damping.name, count=damping.count, text=f"on {law}; {damping.text}")
    cubic = (bars.law == "cubic") & soft
    yield _damping("cubic bar damping", np.where(cubic, bars.damping_cubic, 0.0), "N*s3/m3")


def _hinges(hinges: Hinges) -> Iterator[Physics]:
    soft = ~hinges.rigid
    yield Physics(
        name="hinges",
        count=int(soft.sum()),
        text=f"{_laws(hinges.law[soft])}; {_range(hinges.stiffness[soft], 'N*m/rad')}",
    )
    yield Physics(
        name="rigid hinges", count=int(hinges.rigid.sum()), text="their angles are constraints"
    )
    yield _damping("hinge damping", np.where(soft, hinges.damping, 0.0), "N*m*s/rad")
    hard = hinges.limited & (hinges.law == "linear")
    yield Physics(name="hinge stops", count=int(hard.sum()), text="hard: reached with an impact")
    walls = int((hinges.law == "enhanced-linear").sum())
    yield Physics(name="hinge walls", count=walls, text="a moment that grows towards 0 and 2 pi")


def _fields(experiment: Experiment) -> Iterator[Physics]:
    geometry = experiment.geometry
    heavy = int(((geometry.masses > 0.0) & ~geometry.fixed).sum())
    x, y, z = experiment.gravity
    yield Physics(
        name="gravity",
        count=heavy if any(experiment.gravity) else 0,
        text=f"[{x:g}, {y:g}, {z:g}] m/s2",
    )
    yield Physics(
        name="drag",
        count=heavy if experiment.damping else 0,
        text=f"{experiment.damping:g} kg/s on a node of the mean mass",
    )


def _contact(experiment: Experiment) -> Iterator[Physics]:
    collision, geometry = experiment.collision, experiment.geometry
    touching = int(geometry.collidable.sum()) if collision.enabled else 0
    restitution = 1.0 if collision.restitution is None else collision.restitution
    radius = "no radius given" if collision.radius is None else f"radius {collision.radius:g} m"
    friction = f", friction {collision.friction:g}" if collision.friction else ", no friction"
    how = f"{radius}, restitution {restitution:g}{friction}"
    yield Physics(name="contact of nodes", count=touching if touching > 1 else 0, text=how)
    faces = len(geometry.faces) if collision.faces and touching else 0
    yield Physics(name="contact with faces", count=faces, text=f"of {touching:,} nodes; {how}")


def _drives(experiment: Experiment) -> Iterator[Physics]:
    for kind in ("force", "position", "velocity"):
        actuators = [a for a in experiment.actuators if a.type == kind]
        names = list(dict.fromkeys(a.signal for a in actuators))
        between = list(dict.fromkeys(experiment.signals[name].interpolation for name in names))
        nodes = len({a.node for a in actuators})
        yield Physics(
            name=f"{kind} drives",
            count=len(actuators),
            text=f"on {nodes:,} nodes by {len(names):,} signals ({', '.join(between)})",
        )


def _damping(name: str, values: NDArray[np.float64], unit: str) -> Physics:
    some = values[values != 0.0]
    return Physics(name=name, count=len(some), text=_range(some, unit))


def _laws(laws: NDArray[np.str_]) -> str:
    names, counts = np.unique(laws, return_counts=True)
    return ", ".join(f"{count:,} {name}" for name, count in zip(names, counts, strict=True))


def _range(values: NDArray[np.float64], unit: str) -> str:
    if not len(values):
        return ""
    low, high = float(values.min()), float(values.max())
    return f"{low:.3g} {unit}" if low == high else f"{low:.3g} to {high:.3g} {unit}"
