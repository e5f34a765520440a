"""Quasi-static paths of MERLIN runs, solved again: increments a second, and how near they come.

    python benchmarks/quasi_static_paths.py RUN.mat ... [--rounds 3] [--json FILE]

Each workspace becomes an experiment that is run as `openprc run --producer merlin` would do
it, without writing. Cost is CPU time of one thread, the median of rounds that take turns. The
limit is what no Newton iteration can do without: factorising and solving with the tangents of
the same path, one a correction, measured in the same rounds. Accuracy is the largest distance
from a node of a saved state to the same node of ours, and the force out of balance of both.

MERLIN itself needs MATLAB or Octave. The peer's column is a published figure, not measured
here: the paper's authors' scripts under Octave 7.3 on a shared two-core machine, CPU time where
that is said and wall-clock time where not. Treat the ratio as an order of magnitude.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from openprc_merlin import containers, workspace
from openprc_merlin.arc_length import arc_length_path
from openprc_merlin.displacement_control import controlled_path
from openprc_merlin.equilibrium_path import Balance, PathPoint, PathSettings
from openprc_merlin.path_control import ARC_ITERATIONS, STATION_ITERATIONS, read_drives
from openprc_merlin.runner import PathRunner
from openprc_merlin.workspace_experiment import workspace_experiment
from rich.console import Console
from rich.table import Table

from openprc.demlat.statics import StaticProblem
from openprc.demlat.statics.symmetric_factors import SymmetricFactors

#: Published increments per second of MERLIN's own scripts, and what the second is of.
PUBLISHED = {
    "merlin1_miura_bending": (9.8, "CPU"),
    "merlin1_kresling_folding": (14.0, "wall"),
    "merlin2_gmiura_n5b8_disp": (3.2, "wall"),
}


@dataclass
class Result:
    """One run.

    Attributes
    ----------
    n_nodes, increments, iterations : int
    seconds, least_seconds : float [s]
        CPU time of the path, and of its factorisations and solutions alone.
    distance : float
        Largest, to the saved states, relative to the median bar length; NaN where increments
        differ because the body is soft at rest.
    residual, saved_residual : float
        Largest force out of balance, of ours and of the saved states.
    """

    name: str
    n_nodes: int
    increments: int
    iterations: int
    seconds: float
    least_seconds: float
    distance: float
    residual: float
    saved_residual: float


def timed(work: Callable[[], object]) -> float:
    """Return the CPU time of `work` [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


def measure(path: Path, *, rounds: int) -> Result:
    """Run one workspace."""
    space = workspace.build(containers.read(path).variables, file=path)
    experiment = workspace_experiment(path)
    assert not list(PathRunner().supports(experiment))
    drives = read_drives(experiment)
    along = space.load.mode == "force"
    problem = StaticProblem(
        geometry=experiment.geometry, held=drives.held, positions=drives.stations[0].positions
    )
    settings = PathSettings(max_iterations=ARC_ITERATIONS if along else STATION_ITERATIONS)
    balance = Balance(problem, drives.reference, settings=settings)
    first = float((drives.stations[1].loads * drives.reference).sum())

    def follow() -> list[PathPoint]:
        if along:
            share = first / float((drives.reference**2).sum())
            steps = arc_length_path(balance, problem.positions, first_factor=share)
            return list(islice(steps, space.n_increments))
        stations = drives.stations
        steps = controlled_path(balance, problem.positions, stations[1:], begin=stations[0])
        return list(steps)

    points = follow()
    # A correction each, as many as there were at every increment.
    tangents = [problem.hessian(point.positions) for point in points]
    counts = [max(point.iterations - along, 1) for point in points]
    right = np.ones((len(problem.free), 1 + along))

    def least() -> None:
        for tangent, count in zip(tangents, counts, strict=True):
            for _ in range(count):
                SymmetricFactors(tangent).solve(right)

    whole, part = [], []
    for _ in range(rounds):
        whole.append(timed(follow))
        part.append(timed(least))
    saved = space.nodes + space.displacements
    factors = space.load.history[:, 0] if along else np.zeros(len(saved))
    kept = [
        balance.point(x, factor, iterations=0, n_negative=None).residual
        for x, factor in zip(saved, factors, strict=True)
    ]
    apart = max(np.abs(p.positions - x).max() for p, x in zip(points, saved, strict=True))
    apart /= problem.length_scale
    return Result(
        name=path.stem,
        n_nodes=space.n_nodes,
        increments=len(points),
        iterations=sum(point.iterations for point in points),
        seconds=statistics.median(whole),
        least_seconds=statistics.median(part),
        distance=float(apart) if apart < 1e-2 else np.nan,
        residual=max(point.residual for point in points),
        saved_residual=max(kept),
    )


def table_of(results: list[Result]) -> Table:
    """Return one row a run."""
    table = Table(title="quasi-static paths", title_justify="left")
    for name in (
        *("", "nodes", "increments", "iterations", "incr./CPU s", "published", "ratio"),
        *("over the limit", "distance", "residual", "saved residual"),
    ):
        table.add_column(name, justify="right" if name else "left")
    for result in results:
        rate = result.increments / result.seconds
        published = PUBLISHED.get(result.name)
        table.add_row(
            result.name,
            f"{result.n_nodes}",
            f"{result.increments}",
            f"{result.iterations}",
            f"{rate:.3g}",
            "" if published is None else f"{published[0]:g} ({published[1]})",
            "" if published is None else f"~{rate / published[0]:.1f}",
            f"{result.seconds / result.least_seconds:.1f}",
            "other steps" if np.isnan(result.distance) else f"{result.distance:.0e}",
            f"{result.residual:.0e}",
            f"{result.saved_residual:.0e}",
        )
    table.caption = (
        "published: MERLIN's scripts under Octave 7.3, elsewhere; over the limit: CPU time over"
        " that of the factorisations and solutions alone"
    )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("workspaces", nargs="+", type=Path, metavar="RUN.mat")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    results = [measure(path, rounds=options.rounds) for path in options.workspaces]
    Console().print(table_of(results))
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=1))


if __name__ == "__main__":
    main()
