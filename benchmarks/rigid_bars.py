"""Rigid bars: error against cost of the integrators for constraints, and of the paper's package.

    python benchmarks/rigid_bars.py [--peer-python PATH] [--rounds 3] [--json FILE]

A Miura sheet of 4 x 8 cells, every bar rigid (one edge is fixed), starts less folded than its
hinges rest and moves for half a second. The error is the largest, over ten sample times, of the
rms position error over the rms displacement from the start; the reference is rk4-dae at a
sixteenth of its finest step here. Violation is the largest error of a bar's length in any
frame, relative to the length. Cost is CPU time of one thread, compiling left out; the peer
takes turns with our own integrators. A peer is run by the interpreter of ``--peer-python``,
in which its package is installed.

The paper's package does not come near the reference here, at any step: its five sweeps spread
what a constraint needs over hundreds of steps, and its formula for the angle is off by 1e-4 rad
on every flat facet.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from engine_peers import Peer, Process
from engine_scenes import Scene, make_scene, save_scene, to_experiment
from rich.console import Console
from rich.progress import track
from rich.table import Table

from openprc.demlat import BarHingeModel
from openprc.schema import Experiment

DURATION, N_SAMPLES = 0.5, 10  # [s]
OURS = ("rattle", "rk4-projection", "rk4-dae")
STEPS = {
    "rattle": (40, 80, 160, 320, 640, 1280, 2560, 5120),
    "rk4-projection": (40, 80, 160, 320, 640, 1280, 2560),
    "rk4-dae": (20, 40, 80, 160, 320, 640),
    "paper's package": (640, 1280, 2560, 5120),
}
REFERENCE_STEPS = 16 * STEPS["rk4-dae"][-1]
TARGETS = (3e-2, 1e-2, 1e-4, 1e-6)
PEER = Peer("paper's package", "upstream_rigid")


@dataclass
class Rung:
    """One scheme at one step.

    Attributes
    ----------
    n_steps : int
    error, violation : float [1]
    seconds : list of float [s]
    """

    n_steps: int
    error: float = math.nan
    violation: float = math.nan
    seconds: list[float] = field(default_factory=list)

    @property
    def cost(self) -> float:
        """Median CPU time [s]."""
        return statistics.median(self.seconds)


def relative_error(positions: np.ndarray, reference: np.ndarray) -> float:
    """Return max over t > 0 of rms(x - x_ref) / rms(x_ref - x_0); frames are (T, N, 3) [m]."""
    wrong = np.sqrt(np.mean((positions[1:] - reference[1:]) ** 2, axis=(1, 2)))
    moved = np.sqrt(np.mean((reference[1:] - reference[0]) ** 2, axis=(1, 2)))
    return float((wrong / moved).max())


def rigid_experiment(scene: Scene, name: str, *, n_steps: int) -> Experiment:
    """Return the scene with every bar rigid."""
    frame = DURATION / N_SAMPLES
    experiment = to_experiment(
        scene, duration=DURATION, save_interval=frame, dt=DURATION / n_steps, integrator=name
    )
    geometry = experiment.geometry
    bars = replace(
        geometry.bars,
        rigid=np.ones(len(geometry.bars), dtype=bool),
        rest_length=np.linalg.norm(
            scene.positions[scene.bars[:, 1]] - scene.positions[scene.bars[:, 0]], axis=1
        ),
    )
    return replace(experiment, geometry=replace(geometry, bars=bars))


def frames_of(experiment: Experiment) -> tuple[np.ndarray, float]:
    """Return all frames (T, N, 3) [m] and the CPU time [s]."""
    model = BarHingeModel(experiment)
    start = time.process_time()
    frames = np.concatenate([out.x.copy() for _, out in model.blocks()])
    return frames, time.process_time() - start


def violation_of(frames: np.ndarray, experiment: Experiment) -> float:
    """Return the largest relative error of a length."""
    bars = experiment.geometry.bars
    along = frames[:, bars.indices[:, 1]] - frames[:, bars.indices[:, 0]]
    return float(np.abs(np.linalg.norm(along, axis=2) / bars.rest_length - 1.0).max())


def measure(
    scene: Scene, *, rounds: int, peer_python: Path | None
) -> tuple[dict[str, list[Rung]], str]:
    """Return the rungs of every scheme, and why the peer is missing if it is."""
    reference, _ = frames_of(rigid_experiment(scene, "rk4-dae", n_steps=REFERENCE_STEPS))
    ladder = {name: [Rung(n) for n in STEPS[name]] for name in OURS}
    for name in OURS:
        frames_of(rigid_experiment(scene, name, n_steps=STEPS[name][0]))  # compiles
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        plain = rigid_experiment(scene, "rattle", n_steps=10)
        marked = replace(
            scene,
            dt=DURATION,
            stiffness=np.full(len(scene.bars), -1.0),
            rest_length=plain.geometry.bars.rest_length,
        )
        save_scene(marked, folder / "scene.npz")
        peer = stack.enter_context(Process(PEER, marked, folder, peer_python))
        if not peer.reason:
            ladder[PEER.name] = [Rung(n) for n in STEPS[PEER.name]]
        for _ in track(range(rounds), "rounds", transient=True):
            for name, rungs in ladder.items():
                for rung in rungs:
                    if name == PEER.name:
                        rung.seconds.append(peer.microseconds(rung.n_steps) * rung.n_steps / 1e6)
                        frames = np.concatenate([reference[:1], np.load(peer.positions_file)])
                    else:
                        experiment = rigid_experiment(scene, name, n_steps=rung.n_steps)
                        frames, seconds = frames_of(experiment)
                        rung.seconds.append(seconds)
                    rung.error = relative_error(frames, reference)
                    rung.violation = violation_of(frames, plain)
        return ladder, peer.reason


def cost_to(rungs: list[Rung], target: float) -> float | None:
    """Return the time [s] that an error of `target` takes, interpolated on logarithmic axes."""
    before: Rung | None = None
    for rung in rungs:
        if not rung.error < math.inf:
            continue
        if rung.error <= target:
            if before is None:
                return rung.cost
            share = math.log(before.error / target) / math.log(before.error / rung.error)
            return before.cost * (rung.cost / before.cost) ** share
        before = rung
    return None


def orders(rungs: list[Rung]) -> list[float]:
    """Return the order between successive steps."""
    return [
        math.log(a.error / b.error) / math.log(b.n_steps / a.n_steps)
        for a, b in itertools.pairwise(rungs)
    ]


def rung_table(ladder: dict[str, list[Rung]]) -> Table:
    """Return one row a scheme and step."""
    table = Table(title="rigid Miura 4x8, 0.5 s", title_justify="left")
    for name in ("", "dt [ms]", "error", "order", "violation", "CPU [ms]"):
        table.add_column(name, justify="left" if not name else "right")
    for name, rungs in ladder.items():
        slopes = ["", *(f"{order:.2f}" for order in orders(rungs))]
        for rung, slope in zip(rungs, slopes, strict=True):
            table.add_row(
                name,
                f"{1e3 * DURATION / rung.n_steps:.3g}",
                f"{rung.error:.1e}",
                slope,
                f"{rung.violation:.0e}",
                f"{1e3 * rung.cost:.3g}",
            )
        table.add_section()
    return table


def target_table(ladder: dict[str, list[Rung]]) -> Table:
    """Return what the targets cost, with ratios to the peer's time to its easiest one."""
    table = Table(title="CPU time to an error", title_justify="left")
    table.add_column("")
    for target in TARGETS:
        table.add_column(f"{target:.0e}", justify="right")
    base = cost_to(ladder.get(PEER.name, []), TARGETS[0])
    for name, rungs in ladder.items():
        cells = []
        for target in TARGETS:
            cost = cost_to(rungs, target)
            cells.append("not reached" if cost is None else f"{1e3 * cost:.3g} ms")
            if cost is not None and base is not None:
                cells[-1] += f"  {cost / base:.3f}"
        table.add_row(name, *cells)
    table.caption = f"behind the times: over the time that {PEER.name} takes to {TARGETS[0]:.0%}"
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer-python", type=Path, metavar="PATH")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.peer_python is not None:
        options.peer_python = options.peer_python.absolute()
    console = Console()
    ladder, reason = measure(
        make_scene("miu4x8-stiff"), rounds=options.rounds, peer_python=options.peer_python
    )
    console.print(rung_table(ladder), target_table(ladder))
    if reason:
        console.print(f"{PEER.name} is left out: {reason}")
    if options.json is not None:
        values: dict[str, Any] = {n: [asdict(r) for r in rungs] for n, rungs in ladder.items()}
        options.json.write_text(json.dumps(values, indent=1))


if __name__ == "__main__":
    main()
