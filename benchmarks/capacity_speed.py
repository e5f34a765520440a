"""Information processing capacity: against one ridge per target, and against one ridge for all.

    python benchmarks/capacity_speed.py [--peer-python PATH] [--sizes 5000x100x30x2 ...]
                                        [--rounds 7] [--loop-rounds 3] [--json FILE]

A size is rows x states x largest delay x degree; 5000x100x30x2 has 527 targets. States are of a
tanh network driven by uniform symbols. PATH is the Python of an environment with::

    pip install openprc==0.1.1 reservoirpy h5py scikit-learn

Every way is a process of its own with one BLAS thread, and they take turns in every round; times
are CPU time, of the second of two calls but for loops. Ours are whole calls: checks of the
drive, polynomials, targets, thresholds. Other
packages are given states at unit variance and the targets ready made, which is not timed; only
upstream makes its own. Held-out capacities are fitted on 70 % of the rows and scored on the rest;
in-sample ones need no second set. A ratio is the median over rounds of the ratio within a round,
and after the slash that of the best rounds. The floor is 2 T D K + T D^2 operations at the
measured rate of one matrix product of that size, in the precision of the way.

The error is the largest deviation of a capacity: of in-sample ones from those by the singular
vectors of the states, of held-out ones from those of a ridge by singular values, in float64.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from openprc.analysis.capacity import Terms, polynomial_rows
from openprc.analysis.capacity.targets import RowSpan, TargetRows

HERE = Path(__file__).parent
SIZES = ("5000x100x30x2", "5000x500x30x2")
RIDGE = 1e-6
TRAIN_SHARE = 0.7


@dataclass(frozen=True)
class Way:
    """How capacities are measured, and by whose interpreter."""

    key: str
    label: str
    own: bool = True
    loop: bool = False
    heldout: bool = True
    single: bool = False


WAYS = (
    Way("insample64", "openprc, in-sample, float64", heldout=False),
    Way("insample32", "openprc, in-sample, float32", heldout=False, single=True),
    Way("heldout64", "openprc, held-out, float64"),
    Way("heldout32", "openprc, held-out, float32", single=True),
    Way("sklearn_once", "scikit-learn Ridge, one call"),
    Way("reservoirpy_once", "reservoirpy Ridge, one call", own=False),
    Way("upstream", "upstream, loop over targets", own=False, loop=True),
    Way("reservoirpy_loop", "reservoirpy Ridge, loop", own=False, loop=True),
    Way("sklearn_loop", "scikit-learn Ridge, loop", loop=True),
)


class Process:
    """A way at work on one problem."""

    def __init__(self, way: Way, folder: Path, peer_python: Path | None) -> None:
        self.way, self.out, self.reason = way, folder / f"{way.key}.npy", ""
        python = Path(sys.executable) if way.own else peer_python
        self.child = None
        if python is None:
            self.reason = "no --peer-python was given"
            return
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        if not way.own:
            # Another package by the name openprc must not be found first.
            environment.pop("PYTHONPATH", None)
        self.log = (folder / f"{way.key}.log").open("w+")
        self.child = subprocess.Popen(
            [python, "-m", "peers.capacity_peer", way.key, folder / "problem.npz", self.out],
            cwd=HERE,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
        )
        self._answer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.child is not None:
            self.child.communicate()
            self.log.close()

    def seconds(self) -> float:
        """Measure once; return the CPU time [s]."""
        assert self.child is not None
        assert self.child.stdin is not None
        self.child.stdin.write("again\n")
        self.child.stdin.flush()
        return float(self._answer().get("cpu_s", "nan"))

    def _answer(self) -> dict[str, Any]:
        assert self.child is not None
        assert self.child.stdout is not None
        line = self.child.stdout.readline()
        if line:
            return json.loads(line)
        self.child.wait()
        self.log.seek(0)
        last = (self.log.read().strip().splitlines() or ["nothing said"])[-1]
        self.reason = f"ended with {self.child.returncode}: {last}"
        return {}


def make_problem(n_rows: int, n_states: int, tau: int, degree: int) -> dict[str, Any]:
    """Return states of a tanh network, its input, and the targets in our order."""
    rng = np.random.default_rng(0)
    first = 200 + tau
    u = rng.uniform(-1.0, 1.0, first + n_rows)
    recurrent = rng.normal(size=(n_states, n_states)) * 0.9 / np.sqrt(n_states)
    into = rng.uniform(-0.5, 0.5, n_states)
    bias = 0.2 * rng.normal(size=n_states)
    states = np.empty((len(u), n_states))
    x = np.zeros(n_states)
    for k, value in enumerate(u):
        x = np.tanh(recurrent @ x + into * value + bias)
        states[k] = x
    terms = Terms.within(dict.fromkeys(range(1, degree + 1), tau))
    table = polynomial_rows(u, max_degree=degree, basis="legendre")
    targets = TargetRows(terms, [table])
    span = RowSpan(first, len(u))
    rows = targets.fill(range(len(terms)), span, np.empty((len(terms), n_rows)))
    exponents = np.zeros((len(terms), tau + 1), dtype=np.int64)
    place = np.arange(len(terms))[:, None]
    np.add.at(exponents, (np.broadcast_to(place, terms.degrees.shape), terms.delays), terms.degrees)
    return {
        "u": u,
        "states": states,
        "targets": rows,
        "first": first,
        "n_train": round(TRAIN_SHARE * n_rows),
        "n_test": n_rows - round(TRAIN_SHARE * n_rows),
        "tau": tau,
        "degree": degree,
        "ridge": RIDGE,
        "upstream_order": upstream_order(exponents),
    }


def upstream_order(exponents: np.ndarray) -> np.ndarray:
    """Return, for each of our targets, its place in upstream's enumeration.

    By total degree, then by the powers of the delays, smallest first.
    """
    keys = np.column_stack([exponents.sum(axis=1), exponents])
    sequence = np.lexsort(keys.T[::-1])
    place = np.empty(len(keys), dtype=np.int64)
    place[sequence] = np.arange(len(keys))
    return place


def references(problem: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return in-sample and held-out capacities by singular values, in float64."""
    first, n_train = problem["first"], problem["n_train"]
    states, targets = problem["states"][first:], problem["targets"].T
    left = np.linalg.svd(states - states.mean(axis=0), full_matrices=False)[0]
    centred = targets - targets.mean(axis=0)
    inside = np.square(left.T @ centred).sum(axis=0) / np.square(centred).sum(axis=0)
    x, mean = states[:n_train], states[:n_train].mean(axis=0)
    scale = x.std(axis=0)
    left, sizes, right = np.linalg.svd((x - mean) / scale, full_matrices=False)
    z = targets[:n_train]
    weights = right.T @ (
        (sizes / (sizes**2 + problem["ridge"] * n_train))[:, None] * (left.T @ (z - z.mean(axis=0)))
    )
    test = targets[n_train:]
    residual = test - z.mean(axis=0) - (states[n_train:] - mean) / scale @ weights
    power = np.square(test - test.mean(axis=0)).sum(axis=0)
    return inside, 1.0 - np.square(residual).sum(axis=0) / power


def floor_seconds(problem: dict[str, Any], dtype: type) -> float:
    """Return the time of the least arithmetic at the measured rate of one product [s]."""
    rows = np.ascontiguousarray(problem["targets"], dtype=dtype)
    states = np.ascontiguousarray(problem["states"][problem["first"] :], dtype=dtype)
    times = []
    for _ in range(7):
        start = time.process_time()
        rows @ states
        times.append(time.process_time() - start)
    k, n = rows.shape
    d = states.shape[1]
    return min(times) * (2 * n * d * k + n * d * d) / (2 * n * d * k)


def compare(
    problem: dict[str, Any], *, peer_python: Path | None, rounds: int, loop_rounds: int
) -> list[dict[str, Any]]:
    """Let all ways take turns; return one row each."""
    inside, outside = references(problem)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        np.savez(folder / "problem.npz", **problem)
        working = [stack.enter_context(Process(way, folder, peer_python)) for way in WAYS]
        times: dict[str, list[float]] = {way.key: [] for way in WAYS}
        floors: dict[str, list[float]] = {"double": [], "single": []}
        for process in working:
            if not process.reason and not process.way.loop:
                process.seconds()  # imports on first use
        for turn in range(rounds):
            floors["double"].append(floor_seconds(problem, np.float64))
            floors["single"].append(floor_seconds(problem, np.float32))
            for process in working:
                if process.reason or (process.way.loop and turn >= loop_rounds):
                    continue
                if not process.way.loop:
                    # Loops warm the caches for themselves; a single call has to be made twice.
                    process.seconds()
                if not process.reason:
                    times[process.way.key].append(process.seconds())
        rows = []
        for process in working:
            way = process.way
            row: dict[str, Any] = {"key": way.key, "label": way.label, "skipped": process.reason}
            if not process.reason:
                found = np.load(process.out)
                floor = floors["single" if way.single else "double"]
                row |= {
                    "ms": [1e3 * t for t in times[way.key]],
                    "over_floor": ratio(times[way.key], floor),
                    "error": float(np.abs(found - (outside if way.heldout else inside)).max()),
                    "sum": float(found.sum()),
                }
            rows.append(row)
        for row in rows:
            if row["skipped"]:
                continue
            row["times_slower"] = {
                other: ratio(times[other], times[row["key"]])
                for other in times
                if times[other] and other != row["key"]
            }
        return rows


def ratio(over: list[float], under: list[float]) -> tuple[float, float]:
    """Return the median of the ratio within rounds, and the ratio of the best rounds."""
    within = statistics.median(a / b for a, b in zip(over, under, strict=False))
    return within, min(over) / min(under)


def shown(values: tuple[float, float] | None) -> str:
    """Return both ratios as text, or a dash."""
    return "-" if values is None else " / ".join(f"{value:.3g}" for value in values)


def result_table(rows: list[dict[str, Any]], title: str) -> Table:
    """Return the table of one size: how many times longer each peer takes than the way."""
    left_out = [f"{row['label']}: {row['skipped']}" for row in rows if row["skipped"]]
    table = Table(
        title=title, title_justify="left", caption="\n".join(left_out), caption_justify="left"
    )
    table.add_column("", no_wrap=True)
    headings = ("ms", "best", "of floor", "upstream loop", "reservoirpy loop", "sklearn loop",
                "sklearn once", "reservoirpy once", "error")  # fmt: skip
    for heading in headings:
        table.add_column(heading, justify="right")
    others = ("upstream", "reservoirpy_loop", "sklearn_loop", "sklearn_once", "reservoirpy_once")
    for row in rows:
        if row["skipped"]:
            continue
        slower = row["times_slower"]
        table.add_row(
            row["label"],
            f"{statistics.median(row['ms']):.4g}",
            f"{min(row['ms']):.4g}",
            shown(row["over_floor"]),
            *(shown(slower.get(other)) for other in others),
            f"{row['error']:.1e}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", type=Path, metavar="PATH")
    parser.add_argument("--sizes", nargs="+", default=SIZES, metavar="TxDxTAUxDEGREE")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--loop-rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.peer_python is not None:
        # The processes start in another folder; a link stays a link, or it leaves its environment.
        options.peer_python = options.peer_python.absolute()
        if not options.peer_python.is_file():
            parser.error(f"--peer-python: there is no {options.peer_python}")
    console = Console(width=max(Console().width, 150))
    content = []
    with threadpool_limits(1):
        for size in options.sizes:
            n_rows, n_states, tau, degree = (int(part) for part in size.split("x"))
            problem = make_problem(n_rows, n_states, tau, degree)
            rows = compare(
                problem,
                peer_python=options.peer_python,
                rounds=options.rounds,
                loop_rounds=options.loop_rounds,
            )
            title = (
                f"{n_rows} rows, {n_states} states, delays to {tau}, degree {degree}: "
                f"{len(problem['targets'])} targets; times slower than the way in the row"
            )
            console.print(result_table(rows, title))
            content.append({"size": size, "rows": rows})
    if options.json:
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
