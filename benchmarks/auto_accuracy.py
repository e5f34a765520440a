"""What an accuracy that is asked for gets: scheme, step, error, and cost next to the best choice.

    python benchmarks/auto_accuracy.py [--scenes lat10] [--accuracies 1e-4] [--oracle] [--json FILE]

The error is the largest, over frames, of the rms position error over the rms displacement of a
reference: DOP853 at a tolerance of 1e-13, or a closed form where there is one. With ``--oracle``
every scheme is run down a ladder of steps or tolerances, a factor of sqrt(2) or sqrt(10) apart,
and the cheapest one that is exact enough, in evaluations weighted as the choice weights them, is
what the choice is compared with. ``--costs`` prints the CPU time of an evaluation of each scheme
over that of rk4, which the weights come from.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from engine_scenes import make_scene, to_experiment
from rich.console import Console
from rich.table import Table

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.accuracy import choose_for_accuracy, settled
from openprc.demlat.planning.accuracy_pilot import error_curve
from openprc.demlat.planning.accuracy_schemes import Eligible, eligible_schemes, steps_unit
from openprc.errors import OpenPRCError
from openprc.schema import Experiment
from openprc.schema.experiment import AUTO
from openprc.testing.closed_form_scenes import oscillator, pendulum

ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-8)
ROUNDS = 5


def from_engine(name: str, *, duration: float, damped: bool = True) -> Experiment:
    """Return a scene of the engine's benchmarks, with or without its dampers."""
    scene = to_experiment(make_scene(name), duration=duration, save_interval=duration / 50)
    if damped:
        return scene
    bars = replace(scene.geometry.bars, damping=np.zeros(len(scene.geometry.bars)))
    return replace(scene, damping=0.0, geometry=replace(scene.geometry, bars=bars))


SCENES: dict[str, Callable[[], Experiment]] = {
    "oscillator": lambda: oscillator(1.0).experiment,
    "damped oscillator": lambda: oscillator(1.0, damping=0.5).experiment,
    "pendulum": lambda: pendulum(1.0).experiment,
    "lattice": lambda: from_engine("lat10", duration=1.0),
    "lattice undamped": lambda: from_engine("lat10", duration=1.0, damped=False),
    "miura": lambda: from_engine("miu4x8", duration=1.0),
    "miura stiff": lambda: from_engine("miu4x8-stiff", duration=0.1),
}


def frames(experiment: Experiment) -> tuple[np.ndarray, int, float]:
    """Return positions (T, N, dims) [m], evaluations and CPU time [s]."""
    model = BarHingeModel(experiment, backend="cpu")
    blocks = model.blocks()
    kept = [next(blocks)[1].x.copy()]
    began = time.process_time()
    kept += [block.x.copy() for _, block in blocks]
    seconds = time.process_time() - began
    steps = experiment.steps_per_frame * (experiment.n_frames - 1)
    planned = INTEGRATORS[experiment.integrator].stages * steps
    return np.concatenate(kept), model.effort.get("evaluations", planned), seconds


def oracle(experiment: Experiment, truth: np.ndarray, accuracy: float, most: float) -> float | None:
    """Return the least cost of any scheme and setting on its ladder; None where there is none."""
    best: float | None = None
    for scheme in eligible_schemes(replace(experiment, accuracy=accuracy, integrator=AUTO)):
        for cost, run in _ladder(experiment, scheme):
            if cost is not None and cost > (best or most):
                break
            try:
                positions, evaluations, _ = frames(run)
            except OpenPRCError:
                continue
            spent = scheme.step_cost * evaluations if cost is None else cost
            if error_curve(positions, truth[..., : positions.shape[2]]).max() <= accuracy:
                best = spent if best is None else min(best, spent)
                break
    return best


def _ladder(experiment: Experiment, scheme: Eligible) -> Any:
    common = {"integrator": scheme.scheme.name, "step_check": "warn"}
    if scheme.adaptive:
        for exponent in np.arange(2.0, 13.1, 0.5):
            yield None, replace(experiment, **common, tolerance=10.0**-exponent)
        return
    unit, save = steps_unit(experiment), experiment.save_interval
    first, before = save / scheme.coarsest, 0
    for power in range(30):
        n = unit * max(1, int(np.ceil(first * 2.0 ** (power / 2) / unit)))
        if n == before:
            continue
        before = n
        cost = scheme.cost(n * (experiment.n_frames - 1), save / n)
        yield cost, replace(experiment, **common, dt=save / n)


def measure(name: str, accuracy: float, *, with_oracle: bool) -> dict[str, Any]:
    """Return a row of the table."""
    plain = SCENES[name]()
    truth = frames(replace(plain, integrator="dop853", tolerance=1e-13))[0]
    asked = replace(
        plain, accuracy=accuracy, integrator=AUTO, dt=plain.save_interval, dt_stated=False
    )
    began = time.process_time()
    choice = choose_for_accuracy(asked)
    pilot = time.process_time() - began
    positions, evaluations, seconds = frames(settled(asked))
    cost = choice.candidates[0].cost
    best = oracle(plain, truth, accuracy, most=4.0 * cost) if with_oracle else None
    return {
        "scene": name,
        "accuracy": accuracy,
        "choice": choice.setting,
        "estimated_error": choice.error,
        "achieved_error": float(error_curve(positions, truth).max()),
        "promised": choice.promised,
        "evaluations": evaluations,
        "cost_over_oracle": None if best is None else cost / best,
        "pilot_share_of_duration": min(choice.pilot_duration / choice.duration, 1.0),
        "pilot_cost_over_run": choice.pilot_share,
        "pilot_cpu_s": pilot,
        "run_cpu_s": seconds,
    }


def costs() -> dict[str, dict[str, float]]:
    """Return CPU time of an evaluation over that of rk4, medians of interleaved rounds."""
    found = {}
    for scene in ("lat10", "miu4x8"):
        plain = to_experiment(make_scene(scene), duration=0.5, save_interval=0.05)
        times: dict[str, list[float]] = {}
        for number in range(ROUNDS + 1):
            for name in ("rk4", "verlet", "pefrl", "rk45", "dop853"):
                still = plain
                if name == "pefrl":
                    bars = plain.geometry.bars
                    bars = replace(bars, damping=np.zeros(len(bars)))
                    still = replace(plain, damping=0.0, geometry=replace(plain.geometry, bars=bars))
                _, count, seconds = frames(replace(still, integrator=name, step_check="warn"))
                if number:  # the first round compiles
                    times.setdefault(name, []).append(seconds / count)
        middle = {name: statistics.median(values) for name, values in times.items()}
        found[scene] = {name: value / middle["rk4"] for name, value in middle.items()}
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--accuracies", nargs="+", type=float, default=list(ACCURACIES))
    parser.add_argument("--oracle", action="store_true", help="search for the best fixed choice")
    parser.add_argument("--costs", action="store_true")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    console = Console(width=max(Console().width, 150))
    if options.costs:
        table = Table(title="CPU time of an evaluation over that of rk4", title_justify="left")
        found = costs()
        for column in ("scheme", *found):
            table.add_column(column, justify="left" if column == "scheme" else "right")
        for name in next(iter(found.values())):
            table.add_row(name, *(f"{ratios[name]:.2f}" for ratios in found.values()))
        console.print(table)
        if options.json:
            options.json.write_text(json.dumps(found, indent=2) + "\n")
        return
    rows = [
        measure(scene, accuracy, with_oracle=options.oracle)
        for scene in options.scenes
        for accuracy in options.accuracies
    ]
    table = Table(title="accuracy asked for, estimated and achieved", title_justify="left")
    for column in (
        *("scene", "asked", "choice", "estimated", "achieved", "evaluations"),
        *("of best", "pilot / run", "pilot, run [ms]"),
    ):
        table.add_column(column, justify="left" if column in ("scene", "choice") else "right")
    for row in rows:
        ratio = row["cost_over_oracle"]
        table.add_row(
            row["scene"],
            f"{row['accuracy']:.0e}",
            row["choice"],
            f"{row['estimated_error']:.1e}",
            f"{row['achieved_error']:.1e}",
            f"{row['evaluations']:,}",
            "-" if ratio is None else f"{ratio:.2f}",
            f"{row['pilot_cost_over_run']:.2g}",
            f"{1e3 * row['pilot_cpu_s']:.3g}, {1e3 * row['run_cpu_s']:.3g}",
        )
    console.print(table)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
