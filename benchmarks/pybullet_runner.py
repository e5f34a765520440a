"""What PyBullet as an integrator of bar-hinge bodies costs, and how exact it is.

    python benchmarks/pybullet_runner.py [--rounds 7] [--json FILE]

The same experiments are stepped, in turns, by

- *runner*: openprc-pybullet, half-kick start: PyBullet integrates, compiled forces of OpenPRC;
- *runner, plain*: the same without the half kick, which is semi-implicit Euler;
- *script*: what one writes by hand without OpenPRC: the same calls of PyBullet, forces of the
  same laws in NumPy, velocities read at every step;
- *calls alone*: those calls with a constant force: the limit for any way of using PyBullet;
- *demlat*: the engine's own velocity Verlet, which is the same scheme as the half kick.

Times are CPU time of one thread per node and step, start-up and compiling left out; medians over
rounds, and of a ratio the median of the ratios within a round. The error is the largest deviation
of a coordinate from dop853 at a tolerance of 1e-12, over the largest displacement, after the
time given.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from openprc_pybullet.client import direct_client
from openprc_pybullet.half_kick import HalfKickLoop
from openprc_pybullet.neutral_world import NeutralWorld
from rich.console import Console
from rich.progress import track
from rich.table import Table

from openprc.demlat import BarHingeModel
from openprc.demlat.forces import ForceField
from openprc.schema import Experiment
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import Bars, Geometry

RUNNER, PLAIN, SCRIPT, CALLS, DEMLAT = "runner", "runner, plain", "script", "calls alone", "demlat"
#: Steps of a timed block, by what they cost; demlat's are hundredfold cheaper.
BLOCK_S, DEMLAT_STEPS = 0.25, 40
#: Simulated time after which errors are read [s].
CHECKED = 0.5


@dataclass
class Scene:
    """An experiment, and what was measured on it."""

    name: str
    experiment: Experiment
    seconds: dict[str, list[float]] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)

    def cost(self, name: str) -> float:
        """Median CPU time of a node and a step [us]."""
        return 1e6 * statistics.median(self.seconds[name])

    def ratio(self, name: str, base: str) -> float:
        """Median over the rounds of one cost over another."""
        pairs = zip(self.seconds[name], self.seconds[base], strict=True)
        return statistics.median(one / other for one, other in pairs)


def network(n_nodes: int, *, driven: bool, dt: float) -> Experiment:
    """Return a square lattice with springs along sides and diagonals, its left side fixed."""
    side = round(n_nodes**0.5)
    number = np.arange(side * side).reshape(side, side)
    runs = (
        (number[:-1], number[1:]), (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]), (number[1:, :-1], number[:-1, 1:]),
    )  # fmt: skip
    pairs = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in runs])
    x, y = np.divmod(np.arange(side * side), side)
    positions = np.stack([0.1 * x, 0.1 * y, np.zeros(side * side)], axis=1)
    lengths = np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1)
    body = Geometry(
        positions=positions,
        masses=np.full(side * side, 0.01),
        fixed=x == 0,
        bars=Bars(
            indices=pairs,
            stiffness=np.full(len(pairs), 50.0),
            rest_length=lengths,
            damping=np.full(len(pairs), 0.02 if driven else 0.0),
        ),
    )
    times = dt * np.arange(round(CHECKED / dt) + 1)
    push = Signal(name="push", values=0.05 * np.sin(2 * np.pi * 3.0 * times), dt=dt)
    return Experiment(
        geometry=body,
        signals={"push": push} if driven else {},
        actuators=(
            Actuator(node=side * side - 1, signal="push", type="force", axes=(True, True, False)),
        )
        if driven
        else (),
        gravity=(0.0, -9.81, 0.0),
        duration=CHECKED,
        dt=dt,
        save_interval=CHECKED,
        integrator="verlet",
    )


def chain(n_nodes: int, *, dt: float) -> Experiment:
    """Return a chain that falls from the horizontal."""
    link = 1.0 / (n_nodes - 1)
    body = Geometry(
        positions=[[link * i, 0.0, 0.0] for i in range(n_nodes)],
        masses=np.full(n_nodes, 0.1),
        fixed=np.arange(n_nodes) == 0,
        bars=Bars(
            indices=[[i, i + 1] for i in range(n_nodes - 1)],
            stiffness=np.full(n_nodes - 1, 1e3),
            rest_length=np.full(n_nodes - 1, link),
        ),
    )
    return Experiment(
        geometry=body, gravity=(0.0, 0.0, -9.81), duration=CHECKED, dt=dt, save_interval=CHECKED,
        integrator="verlet",
    )  # fmt: skip


# --- what is timed ------------------------------------------------------------------------------


def numpy_forces(experiment: Experiment) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """Return forces of linear bars, weight and one pushed node, as one writes them by hand."""
    body, bars = experiment.geometry, experiment.geometry.bars
    i, j = bars.indices.T
    weight = body.masses[:, None] * np.array(experiment.gravity)
    pushes = [
        (a.node, np.array(a.axes), experiment.signals[a.signal]) for a in experiment.actuators
    ]

    def forces(x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        along, rate = x[j] - x[i], v[j] - v[i]
        length = np.sqrt(np.einsum("ea,ea->e", along, along))
        tension = bars.stiffness * (length - bars.rest_length)
        tension += bars.damping * np.einsum("ea,ea->e", along, rate) / length
        pull = (tension / length)[:, None] * along
        total = weight.copy()
        np.add.at(total, i, pull)
        np.add.at(total, j, -pull)
        for node, axes, signal in pushes:
            at = min(round(t / signal.dt), len(signal.values) - 1)
            total[node] += axes * signal.values[at, 0]
        return total

    return forces


def by_hand(experiment: Experiment, n_steps: int, *, alone: bool) -> float:
    """Step in PyBullet with forces in NumPy, or with none; return CPU time of all steps [s]."""
    body, h = experiment.geometry, experiment.dt
    forces = numpy_forces(experiment)
    with direct_client("a benchmark") as (bullet, client):
        x, v = body.positions.copy(), body.velocities.copy()
        world = NeutralWorld(
            bullet, client, step=h, positions=x, velocities=v,
            masses=np.where(body.fixed, 0.0, body.masses),
        )  # fmt: skip
        push = np.zeros_like(x)
        velocities = not alone or ForceField(experiment).needs_velocities
        begin = time.process_time()
        for step in range(n_steps):
            if not alone:
                push = forces(x, v, step * h)
            world.step(x, push)
            world.read_positions(x)
            if velocities:
                world.read_velocities(v)
        return time.process_time() - begin


def by_runner(experiment: Experiment, n_steps: int, *, half_kick: bool) -> float:
    """Step with the runner's loop; return CPU time of all steps [s]."""
    with direct_client("a benchmark") as (bullet, client):
        loop = HalfKickLoop(
            bullet, client, experiment=experiment, field=ForceField(experiment), half_kick=half_kick
        )
        begin = time.process_time()
        loop.advance(n_steps)
        return time.process_time() - begin


def by_demlat(experiment: Experiment, n_steps: int) -> float:
    """Step with the engine; return CPU time of all steps [s]."""
    duration = n_steps * experiment.dt
    blocks = BarHingeModel(replace(experiment, duration=duration, save_interval=duration)).blocks()
    next(blocks)  # the frame t = 0: everything is in place
    begin = time.process_time()
    next(blocks)
    return time.process_time() - begin


CONTENDERS: dict[str, Callable[[Experiment, int], float]] = {
    RUNNER: lambda e, n: by_runner(e, n, half_kick=True),
    PLAIN: lambda e, n: by_runner(e, n, half_kick=False),
    SCRIPT: lambda e, n: by_hand(e, n, alone=False),
    CALLS: lambda e, n: by_hand(e, n, alone=True),
    DEMLAT: lambda e, n: by_demlat(e, DEMLAT_STEPS * n),
}


def errors_of(experiment: Experiment) -> dict[str, float]:
    """Return the largest relative errors at `CHECKED`."""
    n_steps = experiment.steps_per_frame
    exact = last_of(replace(experiment, integrator="dop853", tolerance=1e-12))
    moved = np.abs(exact - experiment.geometry.positions[:, : exact.shape[1]]).max()
    found = {DEMLAT: last_of(experiment)}
    for name, half_kick in ((RUNNER, True), (PLAIN, False)):
        with direct_client("a benchmark") as (bullet, client):
            loop = HalfKickLoop(
                bullet, client, experiment=experiment, field=ForceField(experiment),
                half_kick=half_kick,
            )  # fmt: skip
            loop.advance(n_steps)
            found[name] = loop.positions[:, : exact.shape[1]].copy()
    return {name: float(np.abs(x - exact).max() / moved) for name, x in found.items()}


def last_of(experiment: Experiment) -> np.ndarray:
    """Return the positions in the engine's last frame: (N, dims) [m]."""
    return [block.x[-1].copy() for _, block in BarHingeModel(experiment).blocks()][-1]


def measure(scene: Scene, *, rounds: int) -> None:
    """Let all contenders take turns."""
    n_nodes = scene.experiment.geometry.n_nodes
    n_steps = max(50, round(BLOCK_S / (4e-6 * n_nodes + 2e-5)))
    scene.errors = errors_of(scene.experiment)
    for number in track(range(rounds + 1), scene.name, transient=True):
        for name, step in CONTENDERS.items():
            count = n_steps * (DEMLAT_STEPS if name == DEMLAT else 1)
            seconds = step(scene.experiment, n_steps) / (count * n_nodes)
            if number:  # the first round compiles
                scene.seconds.setdefault(name, []).append(seconds)


# --- what is shown ------------------------------------------------------------------------------


def table_of(scene: Scene) -> Table:
    """Return costs, ratios and errors of a scene."""
    title = f"{scene.name}, dt = {1e3 * scene.experiment.dt:g} ms"
    table = Table(title=title, title_justify="left")
    for head in ("", "us a node and step", "over the calls alone", "over demlat", "error at 0.5 s"):
        table.add_column(head, justify="right" if head else "left")
    for name in CONTENDERS:
        error = scene.errors.get(name)
        table.add_row(
            name,
            f"{scene.cost(name):.3g}",
            f"{scene.ratio(name, CALLS):.2f}",
            f"{scene.ratio(name, DEMLAT):.3g}",
            "" if error is None else f"{error:.1e}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    scenes = [
        Scene("chain of 10 nodes", chain(10, dt=1e-3)),
        Scene("lattice of 36 nodes, damped and driven", network(36, driven=True, dt=1e-3)),
        Scene("lattice of 100 nodes", network(100, driven=False, dt=1e-3)),
        Scene("lattice of 900 nodes", network(900, driven=False, dt=1e-3)),
    ]
    console = Console()
    for scene in scenes:
        measure(scene, rounds=options.rounds)
        console.print(table_of(scene))
    if options.json is not None:
        values = {
            scene.name: {"us": {n: scene.cost(n) for n in CONTENDERS}, "error": scene.errors}
            for scene in scenes
        }
        options.json.write_text(json.dumps(values, indent=1))


if __name__ == "__main__":
    main()
