"""What a term costs that a scene does not need: CPU time and instructions, with it and without.

    python benchmarks/omitted_terms.py [--scenes lat30 miu20] [--steps 200] [--rounds 7] [--json]

A scene with everything in it (bars with dashpots, hinges and bends with dashpots, weight, drag,
contact, actuators, energy ledger, three axes, float64) is stepped beside copies that lack one
thing each. Both of a pair are the engine's own loop over steps, specialised for what the scene
has; times are CPU time of one thread, medians over rounds in which all copies take turns. The
search for contacts takes longer than all the rest, and wants three axes, float64 and the ledger:
what the others cost is measured without it. Hinges want three axes, which are measured without
them.

"expected" is the ratio of floating-point operations, counted in the laws as they are written
(`OPERATIONS`); "of it" is the measured ratio over the expected one: 1 where leaving out a term
gains what its arithmetic is worth, more where it saves memory traffic or roots and divisions
besides, less where other things take the time. Searching for contacts has no such count.
"code" is the ratio of the numbers of machine instructions of the compiled loop.

All loops are compiled anew, to be counted: that takes minutes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from engine_scenes import MASS, SIDE, make_scene, to_experiment
from rich.console import Console
from rich.table import Table

from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.integrators.stepping import FixedControl, take_fixed_steps
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.schema.experiment import Actuator, Collision, Experiment, Signal
from openprc.schema.geometry import Bends, Hinges

HINGE_DAMPING, BEND_STIFFNESS, BEND_DAMPING = 1e-5, 1e-3, 1e-6
GRAVITY = (0.0, 0.0, -0.1)  # [m/s2], weak, so that the sheets stay in shape
#: Of one evaluation of all forces, in three axes and in two: additions, multiplications,
#: divisions and roots of an element, and of a node with its share of the scheme.
OPERATIONS = {
    "node": (27, 18),
    "gravity": (3, 2),
    "drag": (12, 8),
    "bars": (24, 17),
    "bar damping": (13, 9),
    "hinges": (165, 165),
    "hinge damping": (36, 36),
    "bends": (125, 125),
    "bend damping": (60, 60),
}
Change = Callable[[Experiment], Experiment]


@dataclass(frozen=True)
class Variant:
    """A scene as it is stepped.

    Attributes
    ----------
    experiment : Experiment
    ledger : bool
    """

    experiment: Experiment
    ledger: bool = True


def full_scene(name: str) -> Experiment:
    """Return a scene of the engine's benchmarks with everything added that it lacks."""
    scene = make_scene(name)
    base = to_experiment(scene, duration=scene.dt, save_interval=scene.dt, step_check="warn")
    geometry = base.geometry
    hinges = geometry.hinges
    if not len(hinges):
        n = round(np.sqrt(geometry.n_nodes))
        node = np.arange(n * n, dtype=np.int32).reshape(n, n)
        # Along every inner edge between two cells, flat at rest.
        columns = (node[:-1, 1:-1], node[1:, 1:-1], node[:-1, :-2], node[1:, 2:])
        indices = np.stack([column.ravel() for column in columns], axis=1)
        hinges = Hinges(
            indices=indices,
            stiffness=np.full(len(indices), 1e-3),
            rest_angle=np.full(len(indices), np.pi),
        )
    hinges = replace(hinges, damping=np.full(len(hinges), HINGE_DAMPING))
    width = 41 if name.startswith("miu") else round(np.sqrt(geometry.n_nodes))
    rows = np.arange(geometry.n_nodes // width * width, dtype=np.int32).reshape(-1, width)
    indices = np.stack([rows[:, :-2].ravel(), rows[:, 1:-1].ravel(), rows[:, 2:].ravel()], axis=1)
    angles = _angles(geometry.positions, indices)
    bends = Bends(
        indices=indices,
        stiffness=np.full(len(indices), BEND_STIFFNESS),
        rest_angle=angles,
        damping=np.full(len(indices), BEND_DAMPING),
    )
    free = np.flatnonzero(~geometry.fixed)[-1]
    return replace(
        base,
        geometry=replace(
            geometry,
            hinges=hinges,
            bends=bends,
            collidable=np.ones(geometry.n_nodes, dtype=bool),
        ),
        gravity=GRAVITY,
        collision=Collision(enabled=True, radius=0.1 * SIDE),
        signals={"push": Signal(name="push", values=[0.0, 1e-3 * MASS], dt=1.0)},
        actuators=(Actuator(node=int(free), signal="push", type="force"),),
    )


def _angles(x: np.ndarray, indices: np.ndarray) -> np.ndarray:
    u, v = x[indices[:, 0]] - x[indices[:, 1]], x[indices[:, 2]] - x[indices[:, 1]]
    sine = np.linalg.norm(np.cross(u, v), axis=1)
    return np.arctan2(sine, np.einsum("ea,ea->e", u, v))


# --- what is left out ----------------------------------------------------------------------------


def without(part: str) -> Change:
    """Return what takes a part out of an experiment."""

    def undamped(kind: str) -> Change:
        def change(e: Experiment) -> Experiment:
            elements = getattr(e.geometry, kind)
            still = replace(elements, damping=np.zeros(len(elements)))
            return replace(e, geometry=replace(e.geometry, **{kind: still}))

        return change

    return {
        "hinges": lambda e: replace(e, geometry=replace(e.geometry, hinges=Hinges())),
        "bends": lambda e: replace(e, geometry=replace(e.geometry, bends=Bends())),
        "bar damping": undamped("bars"),
        "hinge damping": undamped("hinges"),
        "bend damping": undamped("bends"),
        "gravity": lambda e: replace(e, gravity=(0.0, 0.0, 0.0)),
        "drag": lambda e: replace(e, damping=0.0),
        "contact": lambda e: replace(e, collision=Collision()),
        "actuators": lambda e: replace(e, actuators=(), signals={}),
    }[part]


def flat(e: Experiment) -> Experiment:
    """Return the body in the plane z = 0; it may have no hinges and no contact."""
    x = e.geometry.positions * np.array([1.0, 1.0, 0.0])
    down = replace(e.geometry, positions=x)
    return replace(e, geometry=down, gravity=(0.0, -0.1, 0.0), actuators=())


def pairs(full: Experiment) -> dict[str, tuple[Variant, Variant]]:
    """Return the scene with and without every term."""
    free = without("contact")(full)
    found = {"contact": (Variant(full), Variant(free))}
    for part in ("hinges", "bends", "bar damping", "hinge damping", "bend damping",
                 "gravity", "drag", "actuators"):  # fmt: skip
        found[part] = Variant(free), Variant(without(part)(free))
    found["energy ledger"] = Variant(free), Variant(free, ledger=False)
    found["float64"] = Variant(free), Variant(replace(free, precision="float32"))
    flattened = flat(without("hinges")(free))
    # A weight along z makes it a scene in space, which is otherwise the same.
    found["third axis"] = (
        Variant(replace(flattened, gravity=(0.0, -0.1, -1e-9))),
        Variant(flattened),
    )
    bare = free
    for part in ("hinges", "bends", "bar damping", "gravity", "drag", "actuators"):
        bare = without(part)(bare)
    found["all but bars"] = Variant(full), Variant(bare)
    return found


def operations(e: Experiment) -> float:
    """Return the floating-point operations of one evaluation, but for contact."""
    axes = 1 if e.planar else 0
    geometry, n = e.geometry, e.geometry.n_nodes
    counts = {
        "node": n,
        "gravity": n * any(e.gravity),
        "drag": n * (e.damping > 0),
        "bars": len(geometry.bars),
        "bar damping": int((geometry.bars.damping > 0).sum()),
        "hinges": len(geometry.hinges),
        "hinge damping": int((geometry.hinges.damping > 0).sum()),
        "bends": len(geometry.bends),
        "bend damping": int((geometry.bends.damping > 0).sum()),
    }
    return float(sum(OPERATIONS[name][axes] * count for name, count in counts.items()))


# --- stepping ------------------------------------------------------------------------------------


class Stepper:
    """The engine's loop on one variant."""

    def __init__(self, variant: Variant, *, integrator: str, steps: int) -> None:
        experiment = replace(variant.experiment, integrator=integrator)
        assembly = assemble([experiment], ledger=variant.ledger)
        self.assembly = assembly
        h = experiment.dt / assembly.scaler.time
        settings = Settings(h=h, frame_time=steps * h, ledger=variant.ledger)
        self.scheme = INTEGRATORS[integrator].load().for_body(assembly.body, settings)
        self.control = FixedControl(settings.frame_time, steps, h, 1e9)
        self.start = [None if part is None else np.array(part) for part in assembly.state]
        known = set(many_steps.overloads)
        self.run()
        (new,) = set(many_steps.overloads) - known or {None}
        self.instructions = None if new is None else _instructions(new)

    def run(self) -> float:
        """Take the steps from the start; return the CPU time [s]."""
        state, body = self.assembly.state, self.assembly.body
        for part, first in zip(state, self.start, strict=True):
            if part is not None:
                part[...] = first
        began = time.process_time()
        _, stopped = many_steps(self.scheme, body, state, None, self.control, 0)
        took = time.process_time() - began
        if stopped >= 0:
            raise RuntimeError(f"the scene came apart: coordinate {stopped}")
        return took


#: The engine's loop over steps, without the saving of frames. It is not kept on disk: numba shows
#: the instructions of nothing that it takes from there.
many_steps = numba.njit(error_model="numpy", nogil=True)(take_fixed_steps)


def _instructions(signature: Any) -> int:
    text = many_steps.overloads[signature].library.get_asm_str()
    lines = (line.strip() for line in text.splitlines() if line.startswith("\t"))
    return sum(1 for line in lines if line and not line.startswith((".", "#")))


def measure(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Return what every term costs on one scene."""
    progress = Console(stderr=True)
    found = pairs(full_scene(name))
    steppers: dict[int, Stepper] = {}
    kept = {}
    for term, both in found.items():
        for variant in both:
            key = (id(variant.experiment), variant.ledger)
            if key not in steppers:
                progress.print(f"{name}: compiling loop {len(steppers) + 1}, for {term}")
                steppers[key] = Stepper(variant, integrator=options.integrator, steps=options.steps)
        kept[term] = tuple((id(v.experiment), v.ledger) for v in both)
    times: dict[Any, list[float]] = {key: [] for key in steppers}
    for _ in range(options.rounds):
        for key, stepper in steppers.items():
            times[key].append(stepper.run())
    median = {key: statistics.median(values) for key, values in times.items()}
    terms = {}
    for term, (a, b) in kept.items():
        with_it, without_it = found[term]
        expected = operations(with_it.experiment) / operations(without_it.experiment)
        if term == "float64":
            expected = 2.0  # half the bytes, and twice the lanes
        counted = term not in ("contact", "actuators", "energy ledger", "all but bars")
        ratio = median[a] / median[b]
        code = steppers[a].instructions, steppers[b].instructions
        terms[term] = {
            "with_us": 1e6 * median[a] / options.steps,
            "without_us": 1e6 * median[b] / options.steps,
            "gain": ratio,
            "expected": expected if counted else None,
            "of_it": ratio / expected if counted else None,
            "instructions": code,
        }
    return {"scene": name, "size": make_scene(name).size, "terms": terms}


def show(result: dict[str, Any]) -> Table:
    """Return a table of one scene."""
    nodes, bars, _hinges = result["size"]
    title = f"{result['scene']}: {nodes:,} nodes, {bars:,} bars; times of a step"
    table = Table(title=title)
    for heading in ("omitted", "with [us]", "without [us]", "gain", "expected", "of it",
                    "instructions", "code"):  # fmt: skip
        table.add_column(heading, justify="left" if heading == "omitted" else "right")
    for term, row in result["terms"].items():
        a, b = row["instructions"]
        both = a is not None and b is not None
        table.add_row(
            term,
            f"{row['with_us']:.1f}",
            f"{row['without_us']:.1f}",
            f"{row['gain']:.2f}",
            "-" if row["expected"] is None else f"{row['expected']:.2f}",
            "-" if row["of_it"] is None else f"{row['of_it']:.2f}",
            f"{a:,} to {b:,}" if both else "-",
            f"{a / b:.2f}" if both else "-",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=["lat30", "miu20"],
                        default=["lat30", "miu20"])  # fmt: skip
    parser.add_argument("--integrator", choices=["rk4", "verlet"], default="verlet")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results = []
    console = Console(width=max(Console().width, 110))
    for name in options.scenes:
        results.append(measure(name, options))
        if not options.json:
            console.print(show(results[-1]))
    if options.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
