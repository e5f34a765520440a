"""One body on every producer: where they have to agree, and how nearly they do.

    python benchmarks/cross_producers.py [--only cantilever chain hauser miura]
        [--hauser-steps 275000] [--merlin RUN.mat ...] [--json FILE]

cantilever: the deflection of a clamped chain of 5, 10 and 20 segments under a force at its tip,
at rest. PyElastica's rod also shears, by F L / (a G A), which is taken off (a = 27/28, G = E / 3).
Producers against demlat to 1e-5, and against the discrete formula to 2e-4.

chain: the frequency of the slowest mode of hanging chains of 1, 2, 5 and 10 masses against the
roots of Laguerre's polynomials, to 1e-5.

hauser: the error of a linear readout of the random network of Hauser et al. 2011
(doi:10.1007/s00422-012-0471-0) on its Volterra and NARMA tasks: PyBullet against demlat, to 1e-4.
Both take the steps of velocity Verlet; where a signal has a knot, demlat renews the force with
the velocity that it then knows, which PyBullet does not, so that they differ by a little less than
the scheme is wrong. Extensions of the springs in float64, standardised, least squares by QR.

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
from collections.abc import Iterator
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
from openprc.hooks.importing import import_file
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
    bar: float
    cpu_seconds: float | None
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the bar is kept."""
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


def readout_error(path: Path, target: np.ndarray) -> float:
    """Return the variance-normalised error of a linear readout of the extensions of all springs.

    Parameters
    ----------
    path : Path
    target : (K,)
    """
    with Trajectory(path) as run:
        ends, rest = run.indices("bars"), run.element_static("bars", "rest_length")
        x = run.positions()
    states = np.linalg.norm(x[:, ends[:, 1]] - x[:, ends[:, 0]], axis=2) - rest
    y, rows = target, len(target)
    states = states[:rows]
    first, last = round(WASHOUT * rows), round((WASHOUT + TRAINED) * rows)
    train, test = slice(first, last), slice(last, rows)
    centre, spread = states[train].mean(axis=0), states[train].std(axis=0)
    moving = spread > 1e-14
    z = (states[:, moving] - centre[moving]) / spread[moving]
    aim = (y - y[train].mean()) / y[train].std()
    q, r = np.linalg.qr(z[train])
    weights = np.linalg.solve(r, q.T @ aim[train])
    wrong = z[test] @ weights - aim[test]
    return float((wrong**2).mean() / aim[test].var())


def hauser(folder: Path, *, steps: int, fine: float) -> Iterator[Row]:
    """Yield the errors of readouts."""
    for drive, task, amplitude in (
        ("volterra", VolterraTask(), 0.2),
        ("narma", NarmaTask(10, any_range=True), 0.1),
    ):
        options = {"drive": drive, "n_steps": steps}
        target = task.target(network_input(steps, amplitude=amplitude)).values[:, 0]
        found: dict[str, float] = {}
        producers = f"demlat:verlet:dt={fine:g},pybullet:dt={fine:g}"
        for run in runs_of("hauser-network", options, producers, folder / f"hauser-{drive}"):
            if run.path is None:
                yield missing(run, "hauser", drive, 1e-4)
                continue
            error = readout_error(run.path, target)
            found[run.producer] = error
            same = run.producer == "demlat"
            yield Row(
                check="hauser", case=f"{drive}, {steps:,} rows", producer=run.producer,
                figure=error, against="" if same else "demlat",
                expected=None if same else found["demlat"],
                deviation=0.0 if same else error / found["demlat"] - 1.0, bar=1e-4,
                cpu_seconds=run.cpu_seconds,
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
    parser.add_argument("--hauser-steps", type=int, default=275_000)
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
    kept = sum(row.holds for row in rows)
    console.print(f"{kept} of {len(rows)} figures are within their bars")
    if options.json:
        content = [asdict(row) | {"holds": row.holds} for row in rows]
        options.json.write_text(json.dumps(content, indent=2) + "\n")


def show(check: str, rows: list[Row]) -> Table:
    """Return the table of a check."""
    table = Table(title=check, title_justify="left")
    for name in ("case", "producer"):
        table.add_column(name)
    for name in ("figure", "expected", "deviation", "bar", "CPU [s]"):
        table.add_column(name, justify="right")
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
        table.add_row(
            row.case, row.producer, *numbers, row.against, "holds" if row.holds else "NO", row.note
        )
    return table


if __name__ == "__main__":
    main()
