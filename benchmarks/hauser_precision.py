"""What storage and readout do to the score of Hauser's network: digits of a motion of 1e-5.

    python benchmarks/hauser_precision.py [--networks 10] [--files 1] [--quick]
                                          [--plot FILE.png] [--json FILE]

Random networks of 30 masses and nonlinear springs (Hauser et al. 2011,
doi:10.1007/s00422-012-0471-0) imitate a Volterra system of second order (input
0.2 sin(2 pi 2.11 t) sin(2 pi 3.73 t) sin(2 pi 4.33 t) N) or NARMA10 of 0.1 of that product at
1 ms (pushed by the product brought to unit variance). All spring lengths, standardised on the
training rows, are read out with a bias; washout 60,000 rows, training 200,000 (NARMA: 150,000),
test 15,000. The error is the mean squared error over the variance of the target (NMSE), for
each way of storing the lengths and each readout: median [least, largest] over networks.

The body is integrated with rk4 at 1 ms, or at a half or a third of it where damping asks for that;
one row is of explicit Euler steps of 1 ms on the same networks, as in the original. "Expected"
are medians of ten other networks of the same family, from an independent program in Euler steps;
from family to family they differ, and in float64 the rounding of the integration itself counts.

With ``--files K`` the first K networks are also run to files, in float64 and in float32 storage,
and scored as anybody would: StateLoader, a feature, Trainer. What the engine remarks on the file
is printed below. ``--quick`` takes a tenth of the rows, too few to learn the weights well: it shows
that float32 lengths are lost, and no more.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from peers.hauser_euler import euler_lengths
from rich.console import Console
from rich.progress import track
from rich.table import Table

from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.volterra import VolterraTask
from openprc.analysis.visualization.figure import Plot, new_figure
from openprc.compare.task_scores import state_nmse
from openprc.demlat import BarHingeModel
from openprc.hooks.running import run_experiment
from openprc.reservoir import (
    BarExtensions,
    BarLengths,
    LeastSquares,
    Ridge,
    Split,
    StateLoader,
    Trainer,
)
from openprc.reservoir.training.row_split import RowSplit
from openprc.scenes.catalog import build_scene
from openprc.scenes.hauser_network import INTERVAL, network_input
from openprc.schema.experiment import Stored, save_experiment
from openprc.tradeoff.downstream_readouts import DenseSolve
from openprc.tradeoff.downstream_storage import rounded

Reals = np.ndarray


@dataclass(frozen=True)
class Drive:
    """A task of the network: target, and rows to wash out, to train and to test on."""

    name: str
    task: Any
    amplitude: float
    split: RowSplit

    @property
    def u(self) -> Reals:
        """What the target is computed from, at every frame."""
        return network_input(self.split.n_rows, amplitude=self.amplitude)

    def scene(self, seed: int) -> Any:
        """Return the network of a seed, for as many frames as there are rows."""
        options = {"drive": self.name, "n_steps": self.split.n_rows - 1, "seed": seed}
        return build_scene("hauser-network", options)


@dataclass(frozen=True)
class Way:
    """How lengths are stored and read out, and what is expected of it, by task."""

    name: str
    states: Callable[[Reals, Reals], Reals]
    readout: Any
    expected: dict[str, float]
    plotted: bool = True


def lengths(length: Reals, rest: Reals) -> Reals:
    """Return lengths as they are."""
    del rest
    return length


def lengths32(length: Reals, rest: Reals) -> Reals:
    """Return lengths as float32 keeps them."""
    del rest
    return rounded(length)


def extensions32(length: Reals, rest: Reals) -> Reals:
    """Return lengths less rest lengths as float32 keeps them."""
    return rounded(length - rest)


def noisy(length: Reals, rest: Reals) -> Reals:
    """Return lengths with the noise of a very good sensor."""
    del rest
    return length + 1e-9 * np.random.default_rng(0).normal(size=length.shape)


QR = LeastSquares()
WAYS = (
    Way("float64, QR", lengths, QR, {"volterra": 7.1e-6, "narma": 7.2e-4}),
    Way("float32 extensions, QR", extensions32, QR, {"volterra": 2.0e-4, "narma": 2.1e-3}),
    Way("float32 lengths, QR", lengths32, QR, {"volterra": 0.91, "narma": 0.58}),
    Way("float64 + 1e-9 m of noise, QR", noisy, QR, {"volterra": 0.15}, plotted=False),
    Way("float64, ridge 1e-8 a row", lengths, Ridge(1e-8, alpha_scaling="n"), {"volterra": 0.15}),
    Way("float64, ridge 1e-5 a row", lengths, Ridge(1e-5, alpha_scaling="n"), {"volterra": 0.95}),
    Way("float64, Ridge(1e-6)", lengths, Ridge(1e-6), {}),
)
RAW = "float64 raw, numpy lstsq"
RAW_EXPECTED = {"volterra": 0.125, "narma": 0.089}
EULER = "float64, QR; explicit Euler"
INPUT = "the input alone, linear"


def drives(*, quick: bool) -> tuple[Drive, ...]:
    """Return both tasks."""
    part = 10 if quick else 1
    return (
        Drive("volterra", VolterraTask(dt=INTERVAL), 0.2,
              RowSplit(60_000 // part, 200_000 // part, 15_000 // part)),
        Drive("narma", NarmaTask(10, any_range=True), 0.1,
              RowSplit(60_000 // part, 150_000 // part, 15_000 // part)),
    )  # fmt: skip


def simulate(experiment: Any) -> Reals:
    """Return the lengths of all bars at every frame, (T, M) [m]."""
    return np.concatenate([b.length.copy() for _, b in BarHingeModel(experiment).blocks()])


def score_network(drive: Drive, seed: int) -> dict[str, float]:
    """Return the NMSE of every way, of one network."""
    experiment = drive.scene(seed).experiment
    length, rest, u = simulate(experiment), experiment.geometry.bars.rest_length, drive.u

    def score(states: Reals, readout: Any) -> float:
        return state_nmse(states, u, task=drive.task, split=drive.split, readout=readout)

    found = {way.name: score(way.states(length, rest), way.readout) for way in WAYS}
    found[EULER] = score(euler_lengths(experiment), QR)
    found[RAW] = raw_lstsq(length, drive)
    found[INPUT] = score(u[:, None], QR)
    found["motion"] = float(np.median(length[drive.split.washout :].std(axis=0)))
    return found


def raw_lstsq(length: Reals, drive: Drive) -> float:
    """Return the NMSE of `numpy.linalg.lstsq`, default cutoff, on lengths as they are."""
    series = drive.task.target(drive.u)
    y = series.values[:, 0]
    train, test = drive.split.train_rows, drive.split.test_rows
    solved = DenseSolve("lstsq").fit(length[train], y[train] - y[train].mean())
    wrong = solved.predict(length[test]) + y[train].mean() - y[test]
    return float(np.mean(wrong**2) / y[test].var())


def score_files(drive: Drive, seed: int, folder: Path) -> tuple[dict[str, float], list[str]]:
    """Run a network to files, and return the NMSE by storage and feature, and the remarks."""
    scores: dict[str, float] = {}
    remarks: list[str] = []
    split = Split(unit="rows", clock="frames", **drive.split.spans)
    series = drive.task.target(drive.u)
    for precision in ("float64", "float32"):
        stored = Stored(precision=precision, velocities=False, elements=True)
        save_experiment(replace(drive.scene(seed).experiment, stored=stored), folder / precision)
        path = folder / f"{drive.name}-{precision}.h5"
        run = run_experiment(folder / precision, path)
        remarks += [f"{precision}: {note}" for note in run.notes if "digits" in note]
        with StateLoader(path) as loader:
            for feature in (BarLengths(), BarExtensions()):
                trainer = Trainer(feature, LeastSquares(), loader=loader, split=split)
                usable = series.usable
                result = trainer.train(series.for_rows(usable), drive.name, usable=usable)
                scores[f"{precision}, {type(feature).__name__}"] = result.nmse
        path.unlink()
    return scores, remarks


def summary(values: list[float]) -> str:
    """Return median [least, largest]."""
    return f"{statistics.median(values):.2g} [{min(values):.2g}, {max(values):.2g}]"


def rows_of(found: dict[str, list[dict[str, float]]]) -> Iterator[tuple[str, ...]]:
    """Yield the lines of the table."""
    expected = {way.name: way.expected for way in WAYS} | {
        EULER: WAYS[0].expected,
        RAW: RAW_EXPECTED,
        INPUT: {"volterra": 1.0, "narma": 1.0},
    }
    for name, values in expected.items():
        cells = [name]
        for drive, networks in found.items():
            cells.append(summary([network[name] for network in networks]))
            cells.append(f"{values[drive]:.2g}" if drive in values else "-")
        yield tuple(cells)


def draw(found: dict[str, list[dict[str, float]]], path: Path) -> Path:
    """Draw every network as a point, by storage and readout."""
    figure = new_figure((10.0, 4.5))
    names = [way.name for way in WAYS if way.plotted] + [RAW]
    axes = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for panel, (drive, networks) in zip(axes, found.items(), strict=True):
        expected = {way.name: way.expected for way in WAYS} | {RAW: RAW_EXPECTED}
        for place, name in enumerate(names):
            values = [network[name] for network in networks]
            spread = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else [0.0]
            panel.plot(values, place + np.asarray(spread), "o", ms=4, color="C0", alpha=0.7)
            panel.plot([statistics.median(values)], [place], "|", ms=22, color="k")
            if drive in expected[name]:
                panel.plot([expected[name][drive]], [place + 0.3], "v", ms=6, color="C3")
        panel.set_xscale("log")
        panel.set_xlabel("NMSE on test rows [1]")
        panel.set_title({"volterra": "Volterra, second order", "narma": "NARMA10 at 1 ms"}[drive])
        panel.set_yticks(range(len(names)), names)
        panel.grid(axis="x", alpha=0.3)
    axes[0].invert_yaxis()
    axes[0].plot([], [], "o", color="C0", label="a network")
    axes[0].plot([], [], "|", ms=12, color="k", label="median")
    axes[0].plot([], [], "v", color="C3", label="expected")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return Plot(figure, path).save()


def main() -> None:
    """Run all networks and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--networks", type=int, default=10)
    parser.add_argument("--files", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 140)
    chosen = drives(quick=options.quick)
    jobs = [(drive, seed) for drive in chosen for seed in range(options.networks)]
    found: dict[str, list[dict[str, float]]] = {drive.name: [] for drive in chosen}
    for drive, seed in track(jobs, "networks", console=Console(stderr=True)):
        found[drive.name].append(score_network(drive, seed))
    table = Table(title=f"NMSE of {options.networks} networks: median [least, largest]")
    for column in ("stored as, readout", "Volterra", "expected", "NARMA10", "expected"):
        table.add_column(column)
    for row in rows_of(found):
        table.add_row(*row)
    console.print(table)
    for name, networks in found.items():
        motion = statistics.median(network["motion"] for network in networks)
        console.print(f"{name}: lengths move by {motion:.2g} m (median standard deviation)")
    content: dict[str, Any] = {"networks": found, "files": []}
    if options.files:
        files = Table(title="by files: NMSE from StateLoader, feature, Trainer with LeastSquares")
        for column in ("task, network", "stored", "feature", "NMSE"):
            files.add_column(column)
        remarks: list[str] = []
        for drive in chosen:
            for seed in range(options.files):
                with tempfile.TemporaryDirectory() as folder:
                    scores, told = score_files(drive, seed, Path(folder))
                remarks += told
                content["files"].append({"task": drive.name, "seed": seed, "nmse": scores,
                                         "remarks": told})  # fmt: skip
                for name, value in scores.items():
                    stored, _, feature = name.partition(", ")
                    files.add_row(f"{drive.name}, {seed}", stored, feature, f"{value:.2g}")
        console.print(files)
        for remark in dict.fromkeys(remarks):
            console.print(f"remark of the engine, {remark}", markup=False)
    if options.plot:
        console.print(f"written: {draw(found, options.plot)}", markup=False)
    if options.json:
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
