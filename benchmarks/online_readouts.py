"""What learning row by row costs, and what stepping a body symbol by symbol does.

    python benchmarks/online_readouts.py [--peer-python PATH] [--widths 20 100 300] [--rounds 7]
                                         [--json FILE]

First table: recursive least squares of one target on so many states, microseconds of CPU time a
row, one thread. "blocks" is one call for all rows; "rows" is one call of ``partial_fit`` a row,
weights ready after each, and "loop" the same without scikit-learn's conventions, as FORCE
training has it. PATH is the Python of an environment with reservoirpy, whose ``RLS`` is called
once for all rows and goes through them in Python. Everybody takes turns in every round; a ratio
is the median over rounds of the ratio within a round, and after the slash that of the best
rounds. Errors are of bias and weights on ``y = X w + 12`` without noise, for states about 0 and
about 1e4 standard deviations off it. The limit of "blocks" is 2 D^2 operations a row (Householder),
that of the others 3 D^2 (Givens) and D^2 for the weights, at the speed of a matrix product.

Second table: the spring lattice of ``openprc demo``, of which a symbol takes 50 steps, stepped
with a symbol at a time and in one run with the symbols given in advance.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.asking import PeerProcess
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from openprc.demlat import BarHingeModel
from openprc.demlat.samples import HOLD, write_sample
from openprc.demlat.stepping import SteppedExperiment
from openprc.reservoir.readout.rls import RLS
from openprc.reservoir.readout.triangular import TriangularFactor
from openprc.schema import load_experiment

PENALTY, FORGETTING, N_ROWS = 1e-6, 1.0, 3000
PEER = "reservoirpy RLS"


class Peer(PeerProcess):
    """reservoirpy in a process of its own."""

    def __init__(self, python: Path, folder: Path) -> None:
        self.out = folder / "weights.npy"
        super().__init__(python, "peers.reservoirpy_rls", folder / "rows.npz", self.out)

    def __call__(self) -> tuple[float, NDArray[np.float64]]:
        """Return the CPU time of all rows [s], and bias and weights."""
        return float(self.ask("fit")["cpu_s"]), np.load(self.out)


def timed(call: Callable[[], NDArray[np.float64]]) -> tuple[float, NDArray[np.float64]]:
    """Return CPU seconds and what was learned."""
    start = time.process_time()
    learned = call()
    return time.process_time() - start, learned


def by_blocks(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Learn in one call."""
    model = RLS(PENALTY, forgetting=FORGETTING).fit(x, y)
    return np.concatenate([[model.intercept_], model.coef_])


def by_rows(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Learn with a call for every row."""
    model = RLS(PENALTY, forgetting=FORGETTING)
    for row in range(len(x)):
        model.partial_fit(x[row : row + 1], y[row : row + 1])
    return np.concatenate([[model.intercept_], model.coef_])


def by_loop(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Learn every row and solve for the weights after it."""
    factor = TriangularFactor(x.shape[1], 1, penalty=PENALTY, forgetting=FORGETTING)
    targets = y[:, np.newaxis]
    for row, target in zip(x, targets, strict=True):
        factor.add_row(row, target)
        learned = factor.solution()
    return learned[:, 0]


WAYS: dict[str, Callable[..., NDArray[np.float64]]] = {
    "blocks": by_blocks,
    "rows": by_rows,
    "loop": by_loop,
}


def flops_per_second() -> float:
    """Return operations per second of a matrix product."""
    a = np.random.default_rng(0).normal(size=(600, 600))
    best = min(timed(lambda: a @ a)[0] for _ in range(7))
    return 2.0 * 600**3 / best


def readouts(width: int, rounds: int, peer_python: Path | None, speed: float) -> dict[str, Any]:
    """Return microseconds a row and errors, by name."""
    rng = np.random.default_rng(width)
    z, weights = rng.normal(size=(N_ROWS, width)), rng.normal(size=width)
    found: dict[str, Any] = {"width": width, "us": {}, "error": {}, "offset_error": {}}
    for offset, key in ((0.0, "error"), (1e4, "offset_error")):
        x = z + offset
        y = z @ weights + 12.0
        truth = np.concatenate([[12.0 - offset * weights.sum()], weights])
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            np.savez(folder / "rows.npz", x=x, y=y, penalty=PENALTY, forgetting=FORGETTING)
            calls: dict[str, Any] = {
                name: lambda way=way, x=x, y=y: timed(lambda: way(x, y))
                for name, way in WAYS.items()
            }
            if peer_python is not None:
                calls[PEER] = stack.enter_context(Peer(peer_python, folder))
            for call in calls.values():
                call()
            for _ in range(rounds if offset == 0.0 else 1):
                for name, call in calls.items():
                    seconds, learned = call()
                    if offset == 0.0:
                        found["us"].setdefault(name, []).append(1e6 * seconds / N_ROWS)
                    error = np.abs(learned - truth) / (np.abs(truth) if offset else 1.0)
                    found[key][name] = float(error.max())
    found["limit_us"] = {
        "blocks": 2e6 * width**2 / speed,
        "rows": 4e6 * width**2 / speed,
        "loop": 4e6 * width**2 / speed,
    }
    return found


def stepping(rounds: int, n_symbols: int = 200) -> dict[str, list[float]]:
    """Return microseconds a symbol of the demo's lattice, in one run and stepped."""
    with tempfile.TemporaryDirectory() as folder:
        write_sample(Path(folder))
        experiment = load_experiment(folder)
    symbols = experiment.signals["force"].values[:n_symbols]
    experiment = replace(experiment, duration=n_symbols * HOLD, save_interval=HOLD)
    found: dict[str, list[float]] = {}
    for integrator in ("rk4", "verlet"):
        scene = replace(experiment, integrator=integrator)
        body = SteppedExperiment(scene, hold=HOLD, sensors=["displacements"])
        calls: dict[str, Callable[[], Any]] = {
            f"{integrator}, one run": lambda scene=scene: list(
                BarHingeModel(scene, backend="cpu").blocks()
            ),
            f"{integrator}, stepped": lambda body=body: body.run(symbols),
        }
        for number in range(rounds + 1):
            for name, call in calls.items():
                start = time.process_time()
                call()
                if number:  # the first round compiles
                    took = time.process_time() - start
                    found.setdefault(name, []).append(1e6 * took / n_symbols)
    return found


def ratio(one: list[float], other: list[float]) -> str:
    """Return the median ratio within a round, and that of the best rounds."""
    within = statistics.median(a / b for a, b in zip(one, other, strict=True))
    return f"{within:.1f} / {min(one) / min(other):.1f}"


def main() -> None:
    """Time everything and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--peer-python", type=Path)
    parser.add_argument("--widths", type=int, nargs="+", default=[20, 100, 300])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console()
    with threadpool_limits(1):
        speed = flops_per_second()
        learned = [readouts(w, options.rounds, options.peer_python, speed) for w in options.widths]
        stepped = stepping(options.rounds)
    table = Table(title=f"recursive least squares, {N_ROWS} rows")
    for column in ("states", "", "us/row", "faster than peer", "times limit", "error", "offset"):
        table.add_column(column, justify="left" if not column else "right")
    for found in learned:
        for name, us in found["us"].items():
            peer = found["us"].get(PEER)
            limit = found["limit_us"].get(name)
            table.add_row(
                str(found["width"]),
                name,
                f"{statistics.median(us):.1f}",
                ratio(peer, us) if peer and name != PEER else "",
                f"{min(us) / limit:.1f}" if limit else "",
                f"{found['error'][name]:.1e}",
                f"{found['offset_error'][name]:.1e}",
            )
    console.print(table)
    table = Table(title="the lattice of the demo, 16 nodes, 50 steps a symbol")
    for column in ("", "us/symbol", "of one run"):
        table.add_column(column, justify="right" if column else "left")
    for name, us in stepped.items():
        whole = stepped[f"{name.split(',', maxsplit=1)[0]}, one run"]
        table.add_row(name, f"{statistics.median(us):.1f}", ratio(us, whole))
    console.print(table)
    if options.json:
        options.json.write_text(json.dumps({"readouts": learned, "stepping": stepped}, indent=1))


if __name__ == "__main__":
    main()
