"""One body on every producer: where they have to agree, and how nearly they do.

    python benchmarks/cross_producers.py [--only cantilever chain hauser miura]
        [--hauser-steps 10000] [--merlin RUN.mat ...] [--json FILE]

cantilever: the deflection of a clamped chain of 5, 10 and 20 segments under a force at its tip,
at rest. PyElastica's rod also shears, by F L / (a G A), which is taken off (a = 27/28, G = E / 3).
Producers against demlat to 1e-5, and against the discrete formula to 2e-4.

chain: the frequency of the slowest mode of hanging chains of 1, 2, 5 and 10 masses against the
roots of Laguerre's polynomials, to 1e-5.

hauser: the random network of Hauser et al. 2011 (doi:10.1007/s00422-012-0471-0), pushed for its
Volterra and NARMA tasks, by PyBullet and by demlat's velocity Verlet at one step size. The largest
distance between both runs, to 1e-12 m; and the normalised mean squared error (NMSE) of a linear
readout of all extensions, to 1e-4, with penalties of 1e-10 and 1e-8 a row. Without a penalty
(least squares by QR) weights amplify the last bit of the states: that row has no bar, and stands
beside a control, the states of demlat's run with 1e-15 m of noise on every coordinate.

miura: a Miura sheet folded slowly: demlat in time, and equilibria by the merlin producer, against
the one way in which rigid panels fold; and, with ``--merlin``, each workspace run again by the
merlin producer (and in time, loaded slowly, by demlat) against the states that MERLIN saved in it.
All to 1e-3 of the motion.

Cost is CPU time of one process; setting up and writing the file are in it, compiling is not.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from openprc_merlin.workspace_experiment import workspace_experiment
from rich.console import Console
from rich.table import Table

from openprc.analysis.tasks.narma import NarmaTask
from openprc.analysis.tasks.volterra import VolterraTask
from openprc.compare.runs.producers import ProducerRun, run_producers
from openprc.compare.runs.requests import read_requests
from openprc.compare.task_scores import state_nmse
from openprc.hooks.importing import import_file
from openprc.reservoir import LeastSquares, Ridge
from openprc.reservoir.training.row_split import RowSplit
from openprc.scenes.cantilever import AREA, LENGTH, MODULUS
from openprc.scenes.catalog import build_scene
from openprc.scenes.hauser_network import network_input
from openprc.schema.trajectory import Trajectory

SEGMENTS, MASSES = (5, 10, 20), (1, 2, 5, 10)
SHEAR_FACTOR = 27.0 / 28.0
#: Shares of the rows that are washed out and trained on; 60,000 and 200,000 of 275,000.
WASHOUT, TRAINED = 60.0 / 275.0, 200.0 / 275.0


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure of one producer beside what it has to be."""

    check: str
    case: str
    producer: str
    figure: float | None
    against: str
    expected: float | None
    deviation: float | None
    bar: float | None
    cpu_seconds: float | None
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the bar is kept; a row without one is for information."""
        if self.bar is None:
            return True
        return self.deviation is not None and abs(self.deviation) <= self.bar


def runs_of(
    name: str, options: dict[str, object], producers: str, folder: Path
) -> tuple[ProducerRun, ...]:
    """Run a scene of the library."""
    scene = build_scene(name, options)
    return run_producers(scene.experiment, read_requests(producers), folder)


def missing(run: ProducerRun, check: str, case: str, bar: float) -> Row:
    """Return the row of a producer without a run."""
    return Row(
        check=check, case=case, producer=run.name, figure=None, against="", expected=None,
        deviation=None, bar=bar, cpu_seconds=None, note=f"{run.status}: {run.reason}",
    )  # fmt: skip


# --- cantilever -------------------------------------------------------------------------------


def cantilever(folder: Path) -> Iterator[Row]:
    """Yield the deflections."""
    force = 0.005
    shear = force * LENGTH / (SHEAR_FACTOR * MODULUS / 3.0 * AREA)
    for n in SEGMENTS:
        options = {"n": n, "force": force}
        scene = build_scene("cantilever", options)
        formula = scene.reference.probes[0]
        found: dict[str, float] = {}
        producers = "demlat,pybullet,pyelastica:substeps=auto"
        for run in runs_of("cantilever", options, producers, folder / f"cantilever{n}"):
            case = f"n = {n}"
            if run.path is None:
                yield missing(run, "cantilever", case, 1e-5)
                continue
            with Trajectory(run.path) as trajectory:
                deflection = formula.measure(trajectory)
            note = ""
            if run.producer == "pyelastica":
                deflection -= shear
                note = f"less its shear, {shear:.5e} m"
            found[run.name] = deflection
            for against, expected, bar in (
                ("formula", formula.value, 2e-4),
                ("demlat", found["demlat"], 1e-5),
            ):
                if against == run.name:
                    continue
                yield Row(
                    check="cantilever", case=case, producer=run.producer, figure=deflection,
                    against=against, expected=expected, deviation=deflection / expected - 1.0,
                    bar=bar, cpu_seconds=run.cpu_seconds, note=note,
                )  # fmt: skip


# --- hanging chain ----------------------------------------------------------------------------


def chain(folder: Path) -> Iterator[Row]:
    """Yield the frequencies."""
    for n in MASSES:
        options = {"n": n, "stiffness": 1e6}
        frequency = build_scene("hanging-chain", options).reference.probes[0]
        for run in runs_of("hanging-chain", options, "demlat,pybullet", folder / f"chain{n}"):
            if run.path is None:
                yield missing(run, "chain", f"N = {n}", 1e-5)
                continue
            with Trajectory(run.path) as trajectory:
                measured = frequency.measure(trajectory)
            yield Row(
                check="chain", case=f"N = {n}", producer=run.producer, figure=measured,
                against="Laguerre", expected=frequency.value,
                deviation=measured / frequency.value - 1.0, bar=1e-5,
                cpu_seconds=run.cpu_seconds,
            )  # fmt: skip


# --- Hauser's network -------------------------------------------------------------------------


#: Readouts whose errors have to agree, and the one without a penalty, which shows rounding.
PENALISED = {
    "ridge 1e-10 a row": Ridge(1e-10, alpha_scaling="n"),
    "ridge 1e-8 a row": Ridge(1e-8, alpha_scaling="n"),
}
READOUTS = {**PENALISED, "QR": LeastSquares()}
#: Noise of the control [m]: the rounding of coordinates of 10 m.
LAST_BIT = 1e-15


def extensions(path: Path, *, noise: float = 0.0) -> np.ndarray:
    """Return the extensions of all springs at every frame, (T, M) [m].

    Parameters
    ----------
    path : Path
    noise : float [m]
        Standard deviation of what is added to every coordinate.
    """
    with Trajectory(path) as run:
        ends, rest = run.indices("bars"), run.element_static("bars", "rest_length")
        x = run.positions()
    if noise:
        x = x + np.random.default_rng(0).normal(0.0, noise, x.shape)
    return np.linalg.norm(x[:, ends[:, 1]] - x[:, ends[:, 0]], axis=2) - rest


def hauser(folder: Path, *, steps: int, fine: float) -> Iterator[Row]:
    """Yield how far runs are apart, and the errors of readouts."""
    train, washout = round(TRAINED * steps), round(WASHOUT * steps)
    split = RowSplit(washout, train, steps - washout - train)
    for drive, task, amplitude in (
        ("volterra", VolterraTask(), 0.2),
        ("narma", NarmaTask(10, any_range=True), 0.1),
    ):
        u = network_input(steps, amplitude=amplitude)
        producers = f"demlat:verlet:dt={fine:g},pybullet:dt={fine:g}"
        options = {"drive": drive, "n_steps": steps}
        runs = runs_of("hauser-network", options, producers, folder / f"hauser-{drive}")
        lacking = [missing(run, "hauser", drive, 1e-4) for run in runs if run.path is None]
        if lacking:
            yield from lacking
            continue
        ours, bullet = (run.path for run in runs)
        cost = {run.path: run.cpu_seconds for run in runs}
        yield farthest(ours, bullet, drive, cost[bullet])

        def errors(path: Path, names: Iterable[str], noise: float = 0.0) -> dict[str, float]:
            states = extensions(path, noise=noise)[:steps]
            return {
                name: state_nmse(states, u, task=task, split=split, readout=READOUTS[name])  # noqa: B023 - used at once
                for name in names
            }

        known = errors(ours, READOUTS)
        for producer, found in (
            ("pybullet", errors(bullet, READOUTS)),
            ("demlat + 1e-15 m", errors(ours, ["QR"], LAST_BIT)),
        ):
            for name, error in found.items():
                yield Row(
                    check="hauser", case=f"{drive} NMSE, {name}", producer=producer, figure=error,
                    against="demlat", expected=known[name], deviation=error / known[name] - 1.0,
                    bar=1e-4 if name in PENALISED else None, cpu_seconds=None,
                    note="" if name in PENALISED else "the last bit, amplified",
                )  # fmt: skip


def farthest(ours: Path, bullet: Path, drive: str, seconds: float | None) -> Row:
    """Return the row of the largest distance of a node between two runs."""
    with Trajectory(ours) as run:
        here = run.positions()
    with Trajectory(bullet) as run:
        apart = float(np.linalg.norm(run.positions() - here, axis=2).max())
    motion = float(np.linalg.norm(here - here[0], axis=2).max())
    return Row(
        check="hauser", case=f"{drive}, distance [m]", producer="pybullet", figure=apart,
        against="demlat", expected=0.0, deviation=apart, bar=1e-12, cpu_seconds=seconds,
        note=f"motion {motion:.1e} m",
    )  # fmt: skip


# --- Miura ------------------------------------------------------------------------------------


def miura(folder: Path, workspaces: list[Path]) -> Iterator[Row]:
    """Yield the distances from known states, in shares of the largest motion."""
    scene = build_scene("miura", {"variant": "folding", "facet": 1e6})
    requests = read_requests("demlat,merlin")
    for run in run_producers(scene.experiment, requests, folder / "miura"):
        if run.path is None:
            yield missing(run, "miura", "folding", 1e-3)
            continue
        with Trajectory(run.path) as trajectory:
            places = trajectory.positions()
        times = scene.experiment.frame_times[: len(places)]
        yield distance_row(
            places, scene.reference.exact(times), "folding", run.producer, "rigid panels",
            run.cpu_seconds,
        )  # fmt: skip
    for path in workspaces:
        yield from saved_states(path, folder / path.stem)


def saved_states(path: Path, folder: Path) -> Iterator[Row]:
    """Yield how near runs come to the states that MERLIN saved."""
    experiment = workspace_experiment(path)
    saved = import_file(path, folder / "saved.h5", options={"unit": "m"}).path
    run, *_ = run_producers(experiment, read_requests("merlin"), folder)
    if run.path is None:
        yield missing(run, "miura", path.stem, 1e-3)
        return
    with Trajectory(saved) as known, Trajectory(run.path) as ours:
        there, here = known.positions(unit="m"), ours.positions(unit="m")
    count = min(len(there), len(here))
    yield distance_row(
        here[:count], there[:count], path.stem, "merlin", f"{count} saved states", run.cpu_seconds
    )


def distance_row(
    here: np.ndarray, there: np.ndarray, case: str, producer: str, against: str,
    seconds: float | None,
) -> Row:  # fmt: skip
    """Return the row of the largest distance of a node over the largest way of one."""
    motion = float(np.linalg.norm(there - there[0], axis=2).max())
    apart = float(np.linalg.norm(here - there, axis=2).max())
    return Row(
        check="miura", case=case, producer=producer, figure=apart, against=against, expected=None,
        deviation=apart / motion, bar=1e-3, cpu_seconds=seconds,
    )  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    checks = ["cantilever", "chain", "hauser", "miura"]
    parser.add_argument("--only", nargs="+", choices=checks, default=checks)
    parser.add_argument("--hauser-steps", type=int, default=10_000)
    parser.add_argument("--hauser-dt", type=float, default=1.25e-4, help="of both [s]")
    parser.add_argument("--merlin", nargs="+", type=Path, default=[], metavar="RUN.mat")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    console = Console(width=max(Console().width, 120))
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for check in options.only:
            found = {
                "cantilever": lambda: cantilever(folder),
                "chain": lambda: chain(folder),
                "hauser": lambda: hauser(
                    folder, steps=options.hauser_steps, fine=options.hauser_dt
                ),
                "miura": lambda: miura(folder, options.merlin),
            }[check]()
            mine = list(found)
            rows += mine
            console.print(show(check, mine))
    barred = [row for row in rows if row.bar is not None]
    kept = sum(row.holds for row in barred)
    console.print(f"{kept} of {len(barred)} figures are within their bars")
    if options.json:
        content = [asdict(row) | {"holds": row.holds} for row in rows]
        options.json.write_text(json.dumps(content, indent=2) + "\n")


def show(check: str, rows: list[Row]) -> Table:
    """Return the table of a check."""
    table = Table(title=check, title_justify="left")
    for name in ("case", "producer"):
        table.add_column(name)
    for name in ("figure", "expected", "deviation", "bar", "CPU [s]"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("against", "", "note"):
        table.add_column(name)
    for row in rows:
        numbers = [
            "-" if value is None else style.format(value)
            for value, style in (
                (row.figure, "{:.8g}"), (row.expected, "{:.8g}"), (row.deviation, "{:.2e}"),
                (row.bar, "{:.0e}"), (row.cpu_seconds, "{:.2f}"),
            )
        ]  # fmt: skip
        verdict = "-" if row.bar is None else "holds" if row.holds else "NO"
        table.add_row(row.case, row.producer, *numbers, row.against, verdict, row.note)
    return table


if __name__ == "__main__":
    main()
