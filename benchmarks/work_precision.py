"""Error against cost of every integrator that the engine offers, on three scenes.

    python benchmarks/work_precision.py [--scenes lat10] [--integrators rk4] [--rounds 3]
                                        [--longest 10] [--plot FILE.png] [--json FILE]

Every integrator runs down a ladder of time steps (or of tolerances, if it chooses its steps)
until the error is below 3e-8 or a run would take longer than ``--longest`` seconds. The error
is the largest, over ten sample times, of the rms position error over the rms displacement of
the reference from the start, and the reference the one of ``openprc tradeoff``, whose own
uncertainty and second method are printed. Cost is CPU time of one thread,
setting up and compiling left out, and the number of force evaluations where it is known.

The yardstick is our own throw-away scalar Runge-Kutta loop (``peers/numba_scalar.py``).
The table interpolates, on logarithmic axes, what a given error costs: CPU time, how many
times less than the yardstick, force evaluations.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from engine_scenes import Scene, make_scene, to_experiment
from peers.numba_scalar import flat_tables, inverse_masses, rk4
from peers.ours import Outcome, prepare_integration, refusal
from rich.console import Console
from rich.progress import track
from rich.table import Table

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import stable_step
from openprc.errors import OpenPRCError
from openprc.tradeoff.outcome import relative_error
from openprc.tradeoff.pareto import cost_of, evaluations
from openprc.tradeoff.point import Point
from openprc.tradeoff.reference import converged_reference

DURATIONS = {"lat10": 1.0, "miu4x8": 1.0, "miu4x8-stiff": 0.5}  # [s]
N_SAMPLES = 10
TARGETS = (1e-2, 1e-4, 1e-6)
GOOD_ENOUGH = 3e-8
#: Steps start this many times above the stability limit of rk4, for those that can take it.
OVERSTEP = 16
#: A scheme that gives nothing with this share of the step that is stable for rk4 never will.
HOPELESS = 1.0 / 64.0
TOLERANCES = tuple(10.0 ** -(0.5 * i) for i in range(4, 25))
YARDSTICK = "scalar rk4"


class LeftOut(Exception):
    """An integrator cannot run a scene."""


@dataclass
class Rung:
    """One run, repeated.

    Attributes
    ----------
    step : float [s]
        Or the tolerance [1], where `adaptive`.
    error : float [1]
        NaN where there was no result; `note` says why.
    seconds : list of float [s]
    """

    step: float
    adaptive: bool
    begin: Callable[[], Callable[[], Outcome]]
    error: float = math.nan
    evaluations: int | None = None
    note: str = ""
    seconds: list[float] = field(default_factory=list)

    def measure(self, reference: np.ndarray) -> None:
        """Run once more."""
        try:
            run = self.begin()
            start = time.process_time()
            outcome = run()
        except OpenPRCError as problem:
            self.note = str(problem).splitlines()[0]
            return
        self.seconds.append(time.process_time() - start)
        self.evaluations = outcome.evaluations
        self.error = relative_error(outcome.positions, reference)

    @property
    def cost(self) -> float:
        """Median CPU time [s]."""
        return statistics.median(self.seconds)

    @property
    def point(self) -> Point:
        """The point of a trade-off that the rung is."""
        told = {"group": "integrator", "label": "", "setting": {"step": self.step}}
        if not math.isfinite(self.error):
            return Point(**told, status="refused", note=self.note)
        return Point(
            **told,
            trajectory_error=self.error,
            cpu_seconds=self.cost,
            evaluations=self.evaluations,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        values = asdict(self)
        del values["begin"]
        return values | {"error": None if math.isnan(self.error) else self.error}


# --- ladders ----------------------------------------------------------------------------------


def yardstick(
    scene: Scene, *, duration: float, steps_per_frame: int
) -> Callable[[], Callable[[], Outcome]]:
    """Return what begins the scalar loop, keeping the same frames as the engine."""
    tables, inverse = flat_tables(scene), inverse_masses(scene)
    h = duration / N_SAMPLES / steps_per_frame

    def run() -> Outcome:
        x, v = scene.positions.copy(), scene.velocities.copy()
        frames = [x.copy()]
        for _ in range(N_SAMPLES):
            rk4(x, v, inverse, h, steps_per_frame, tables)
            frames.append(x.copy())
        return Outcome(np.array(frames), 4 * steps_per_frame * N_SAMPLES)

    return lambda: run


def ladder(
    scene: Scene, name: str, *, duration: float, reference: np.ndarray, longest: float
) -> list[Rung]:
    """Return the measured rungs of one integrator, coarse ones first."""
    frame = duration / N_SAMPLES
    common = {"duration": duration, "save_interval": frame, "step_check": "warn"}
    plain = to_experiment(scene, **common, dt=frame)
    fewest = math.ceil(frame / stable_step(plain))
    adaptive = name != YARDSTICK and INTEGRATORS[name].step == "adaptive"

    def rungs() -> Any:
        if adaptive:
            for tolerance in TOLERANCES:
                experiment = to_experiment(
                    scene, **common, dt=frame / fewest, integrator=name, tolerance=tolerance
                )
                yield Rung(tolerance, True, prepare_integration(experiment))
            return
        first = 1 if name == YARDSTICK else OVERSTEP
        counts = {max(1, fewest // 2**k) for k in range(first.bit_length())}
        for n in itertools.chain(sorted(counts), (fewest * 2**k for k in itertools.count(1))):
            if name == YARDSTICK:
                run = yardstick(scene, duration=duration, steps_per_frame=n)
            else:
                experiment = to_experiment(scene, **common, dt=frame / n, integrator=name)
                if reason := refusal(experiment):
                    raise LeftOut(f"{name} cannot run {scene.name}: {reason}")
                run = prepare_integration(experiment)
            yield Rung(frame / n, False, run)

    measured: list[Rung] = []
    for number, rung in enumerate(rungs()):
        rung.measure(reference)
        if number == 0:
            # The first one may have compiled.
            rung.seconds.clear()
            rung.measure(reference)
        measured.append(rung)
        if rung.error < GOOD_ENOUGH or (rung.seconds and 2.0 * rung.cost > longest):
            break
        if rung.note and not adaptive and rung.step < HOPELESS * frame / fewest:
            break
    return measured


# --- output -----------------------------------------------------------------------------------


def scene_table(title: str, rungs: dict[str, list[Rung]]) -> Table:
    """Return what the targets cost, one row an integrator."""
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for target in TARGETS:
        table.add_column(f"to {target:.0e}", justify="right", no_wrap=True)

    ladders = {name: [rung.point for rung in steps] for name, steps in rungs.items()}
    for name, steps in ladders.items():
        cells = []
        for target in TARGETS:
            cost, base = (cost_of(r, target) for r in (steps, ladders[YARDSTICK]))
            if cost is None:
                cells.append("never")
                continue
            cells.append(f"{1e3 * cost:.3g} ms")
            if base is not None:
                cells[-1] += f"  {base / cost:.2f} x"
            count = cost_of(steps, target, cost=evaluations)
            if count is not None:
                cells[-1] += f"  {count:.0f} ev"
        table.add_row(name, *cells)
    return table


def draw(path: Path, results: dict[str, dict[str, list[Rung]]]) -> None:
    """Write the plot."""
    import matplotlib as mpl  # noqa: PLC0415 - only for those who ask for a plot

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(
        2, len(results), figsize=(4.5 * len(results), 7.5), squeeze=False, layout="constrained"
    )
    for column, (scene, rungs) in enumerate(results.items()):
        for name, steps in rungs.items():
            good = [r for r in steps if not math.isnan(r.error) and r.error < 1.0]
            style = {"marker": "o", "markersize": 3, "label": name}
            style |= {"color": "0.6"} if name == YARDSTICK else {}
            errors = [r.error for r in good]
            axes[0, column].loglog([1e3 * r.cost for r in good], errors, **style)
            if all(r.evaluations for r in good):
                axes[1, column].loglog([r.evaluations for r in good], errors, **style)
        axes[0, column].set(title=f"{scene}, {DURATIONS[scene]:g} s", xlabel="CPU time [ms]")
        axes[1, column].set(xlabel="force evaluations [1]")
        for axis in axes[:, column]:
            axis.grid(which="both", alpha=0.3)
            axis.set_ylabel("rms error / rms displacement [1]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3 * len(results))
    figure.savefig(path, dpi=150)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    # Repeating old runs is no use of work, and constraints have nothing to do here.
    offered = [n for n, s in INTEGRATORS.items() if s.step != "legacy" and s.rigid == "no"]
    parser.add_argument("--scenes", nargs="+", choices=list(DURATIONS), default=list(DURATIONS))
    parser.add_argument("--integrators", nargs="+", choices=offered, default=offered)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--longest", type=float, default=10.0, help="seconds of one run")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    console = Console(width=max(Console().width, 110))

    results: dict[str, dict[str, list[Rung]]] = {}
    uncertainty: dict[str, float] = {}
    left_out: list[str] = []
    for scene_name in options.scenes:
        scene, duration = make_scene(scene_name), DURATIONS[scene_name]
        known = converged_reference(
            to_experiment(scene, duration=duration, save_interval=duration / N_SAMPLES, dt=1e-4),
            longest=options.longest,
        )
        reference, uncertainty[scene_name] = known.positions, known.uncertainty
        console.print(f"{scene_name}: {known.sentence()}")
        rungs = results[scene_name] = {}
        for name in track([YARDSTICK, *options.integrators], scene_name, transient=True):
            try:
                rungs[name] = ladder(
                    scene, name, duration=duration, reference=reference, longest=options.longest
                )
            except LeftOut as reason:
                left_out.append(str(reason))
        # Further rounds go through everything in turn, so that a busy spell hits all alike.
        for _ in range(options.rounds - 1):
            for rung in itertools.chain(*rungs.values()):
                if rung.seconds:
                    rung.measure(reference)
        title = f"{scene_name}, {duration:g} s; reference good to {uncertainty[scene_name]:.0e}"
        console.print(scene_table(title, rungs))
    for line in left_out:
        console.print(line)
    if options.plot:
        draw(options.plot, results)
    if options.json:
        content = {
            scene: {
                "duration_s": DURATIONS[scene],
                "reference_uncertainty": uncertainty[scene],
                "integrators": {n: [r.as_dict() for r in steps] for n, steps in rungs.items()},
            }
            for scene, rungs in results.items()
        }
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
