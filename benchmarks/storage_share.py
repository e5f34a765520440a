"""How much of a run goes into storing it: files, frames and derived quantities.

    python benchmarks/storage_share.py [--scenes lat10 miu4x8] [--steps 20000] [--json FILE]

Runs from input files to output file, rk4 with 0.1 ms, every hundredth step saved in float64 with
velocities and all quantities of elements. The parts are timed where they happen, CPU time of one
thread, medians over rounds. "Storing" is opening, appending, committing and closing the file;
"checking" is the validation of the finished file and the estimate of the stable step, whose
cost does not grow with the steps; what derived quantities cost is the difference between the
loop with frames and the same number of steps without.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from engine_scenes import make_scene, to_experiment
from peers.ours import ours
from rich.console import Console
from rich.table import Table

from openprc.demlat import BarHingeModel, Engine
from openprc.hooks import running
from openprc.schema import save_experiment
from openprc.schema.writer import TrajectoryWriter

DT, SAVE_EVERY = 1e-4, 100


class Clock:
    """Adds up the CPU time spent in functions, that of nested ones counted once."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self.stack: list[float] = []

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Time every call of ``owner.name``."""
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self.stack.append(0.0)
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.process_time() - began
                self.spent[part] += took - self.stack.pop()
                if self.stack:
                    self.stack[-1] += took

        setattr(owner, name, timed)


def share(name: str, steps: int, rounds: int) -> dict[str, float]:
    """Return medians [ms] of the parts of a run."""
    scene = replace(make_scene(name), dt=DT)
    frame = SAVE_EVERY * DT
    experiment = to_experiment(scene, duration=steps * DT, save_interval=frame, dt=DT)
    experiment = replace(experiment, overwrite=True)
    bare = ours(scene)
    found: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        save_experiment(experiment, folder)
        for number in range(rounds + 1):
            clock.spent.clear()
            began = time.process_time()
            Engine(BarHingeModel).run(folder)
            total = time.process_time() - began
            began = time.process_time()
            bare(steps)
            loop = time.process_time() - began
            if number == 0:
                continue  # compiles
            found["total"].append(total)
            found["steps"].append(loop)
            for part in ("storing", "checking"):
                found[part].append(clock.spent[part])
    return {part: 1e3 * statistics.median(values) for part, values in found.items()}


clock = Clock()
for _name in ("__init__", "append", "commit", "close", "__exit__"):
    clock.watch(TrajectoryWriter, _name, "storing")
clock.watch(running, "refuse_invalid", "checking")
clock.watch(BarHingeModel, "supports", "checking")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=["lat10", "miu4x8"])
    parser.add_argument("--steps", type=int, nargs="+", default=[20_000, 100_000])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = Table(title="CPU time of a run [ms]")
    for heading in ("scene", "steps", "total", "steps only", "storing", "checking", "stored share"):
        table.add_column(heading, justify="right")
    report = []
    for name in options.scenes:
        for steps in options.steps:
            parts = share(name, steps, options.rounds)
            stored = parts["storing"] / parts["total"]
            report.append({"scene": name, "steps": steps, "stored_share": stored} | parts)
            cells = [f"{parts[part]:.0f}" for part in ("total", "steps", "storing", "checking")]
            table.add_row(name, f"{steps:,}", *cells, f"{stored:.1%}")
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
