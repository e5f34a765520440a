"""The engine next to others: one scene, one thread, the same numbers, taking turns.

    python benchmarks/engine_peers.py --peer-python PATH [--scenes lat10 miu4x8]
                                      [--rounds 7] [--json FILE]

Scenes are those of ``engine_scenes.py``; a step is one of the classical Runge-Kutta scheme
(four force evaluations, 1 ms, float64). PATH is the Python of an environment into which the
peers were installed::

    pip install openprc==0.1.1 tqdm taichi warp-lang mujoco numba h5py

A peer that cannot be started, or cannot model a scene, is left out with the reason. All of
them run as processes of their own and take turns in every round; times are CPU time. Of a
ratio, the median over rounds of the ratio within a round comes first, and after the slash
that of the best rounds: other work on the machine can only slow a peer down. The error is
the largest deviation from the scheme in NumPy after 20 steps. Sweeps step different designs
side by side on two threads; theirs are wall-clock times of one scene. The limit is what the
arithmetic of the scene takes at the measured peak of multiply-adds, or its roots and
divisions at the measured throughput of the divider, whichever is longer.

The last tables are from input files to output file: 20,000 steps of 0.1 ms (upstream: 1000),
every hundredth saved. What our run costs beyond "steps only" is files and derived quantities.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from engine_scenes import COUNTS, Scene, make_scene, reference_positions, save_scene
from peers.machine import Limits, measure_limits
from peers.serving import CHECKED_STEPS, SAVE_EVERY
from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
BLOCK_S = 0.15  # CPU time that a block of steps should take
FEWEST, MOST = 5, 20_000  # steps a block
RUN_SCENES = ("lat10", "miu4x8")
RUN_DT = 1e-4  # [s]
OURS, UPSTREAM, TAICHI = "openprc", "upstream", "taichi serial"


@dataclass(frozen=True)
class Peer:
    """What is timed: a module of `peers`, and whether it is run by this interpreter."""

    name: str
    module: str
    own: bool = False
    run_steps: int | None = None  # steps a block, as many as fit if None


STEPPING = (
    Peer(OURS, "ours", own=True),
    Peer("sweep, 8 lanes, 2 threads", "ours_sweep", own=True),
    Peer("sweep, 16 float32, 2 threads", "ours_sweep_single", own=True),
    Peer("scalar numba", "numba_scalar", own=True),
    Peer(TAICHI, "taichi_serial"),
    Peer("warp cpu", "warp_cpu"),
    Peer("mujoco tendons", "mujoco_tendons"),
    Peer(UPSTREAM, "upstream"),
)
# Upstream's cost is proportional to the steps, and its scheme would not survive more of them.
RUNNING = (
    Peer(OURS, "ours_run", own=True, run_steps=20_000),
    Peer("openprc, steps only", "ours", own=True, run_steps=20_000),
    Peer(UPSTREAM, "upstream_run", run_steps=1000),
)


@dataclass(frozen=True)
class Result:
    """What one peer did with one scene; times per step and copy of the scene.

    Attributes
    ----------
    us : tuple of float [us]
        One value a round.
    error : float or None [m]
    skipped : str
        Why there is nothing else.
    """

    scene: str
    peer: str
    us: tuple[float, ...] = ()
    n_steps: int = 0
    threads: int = 1
    error: float | None = None
    skipped: str = ""


class Process:
    """A peer at work on one scene."""

    def __init__(self, peer: Peer, scene: Scene, folder: Path, peer_python: Path | None) -> None:
        self.peer, self.scene, self.reason = peer, scene, ""
        self.positions_file = folder / f"{peer.module}.npy"
        self.log = (folder / f"{peer.module}.log").open("w+")
        python = Path(sys.executable) if peer.own else peer_python
        if python is None:
            self.child, self.reason = None, "no --peer-python was given"
            return
        environment = dict(os.environ)
        if not peer.own:
            # Another package by the name openprc must not be found first.
            environment.pop("PYTHONPATH", None)
        self.child = subprocess.Popen(
            [python, "-m", f"peers.{peer.module}", folder / "scene.npz", self.positions_file],
            cwd=HERE,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
        )
        ready = self._answer()
        self.reason = self.reason or ready.get("skip", "")
        self.threads, self.copies = ready.get("threads", 1), ready.get("scenes", 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.child is not None:
            self.child.communicate()
        self.log.close()

    def microseconds(self, n_steps: int) -> float:
        """Run `n_steps` steps; return the time of one, of one copy of the scene [us]."""
        assert self.child is not None
        assert self.child.stdin is not None
        self.child.stdin.write(f"{n_steps}\n")
        self.child.stdin.flush()
        answer = self._answer()
        if self.reason:
            return float("nan")
        # Several threads together use more CPU time than anybody waits for.
        seconds = answer["cpu_s"] if self.threads == 1 else answer["wall_s"]
        return seconds * 1e6 / n_steps / self.copies

    def fitting_steps(self) -> int:
        """Return how many steps make a block."""
        if self.peer.run_steps:
            return self.peer.run_steps
        first = self.microseconds(FEWEST)
        if self.reason:
            return FEWEST
        return int(np.clip(BLOCK_S * 1e6 / (first * self.copies), FEWEST, MOST))

    def error(self, reference: np.ndarray) -> float | None:
        """Return the largest deviation of a coordinate [m]."""
        if not self.positions_file.exists():
            return None
        return float(np.abs(np.load(self.positions_file) - reference).max())

    def _answer(self) -> dict[str, Any]:
        assert self.child is not None
        assert self.child.stdout is not None
        for line in self.child.stdout:
            # Some packages greet on being imported, before the answers have their own pipe.
            if line.startswith("{"):
                return json.loads(line)
        self.child.wait()
        self.log.seek(0)
        last_words = (self.log.read().strip().splitlines() or ["nothing said"])[-1]
        self.reason = f"ended with {self.child.returncode}: {last_words}"
        return {}


def compare(
    peers: tuple[Peer, ...],
    scene: Scene,
    *,
    peer_python: Path | None,
    rounds: int,
) -> list[Result]:
    """Let the peers take turns on a scene."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        save_scene(scene, folder / "scene.npz")
        reference = reference_positions(scene, n_steps=CHECKED_STEPS)
        processes = [
            stack.enter_context(Process(peer, scene, folder, peer_python)) for peer in peers
        ]
        blocks = {p.peer.name: p.fitting_steps() for p in processes if not p.reason}
        times: dict[str, list[float]] = {peer.name: [] for peer in peers}
        for _ in range(rounds):
            for process in processes:
                if not process.reason:
                    microseconds = process.microseconds(blocks[process.peer.name])
                    times[process.peer.name].append(microseconds)
        results = []
        for process in processes:
            peer = process.peer.name
            if process.reason:
                results.append(Result(scene=scene.name, peer=peer, skipped=process.reason))
                continue
            results.append(
                Result(
                    scene=scene.name,
                    peer=peer,
                    us=tuple(times[peer]),
                    n_steps=blocks[peer],
                    threads=process.threads,
                    error=process.error(reference),
                )
            )
    return results


def ratios(results: list[Result], over: str, under: Result) -> tuple[float, float] | None:
    """Return how many times longer than `under` the peer called `over` takes.

    The median over rounds of the ratio within a round, and the ratio of the best rounds.
    """
    times = next((r.us for r in results if r.peer == over), ())
    if not times or not under.us:
        return None
    within = statistics.median(a / b for a, b in zip(times, under.us, strict=True))
    return within, min(times) / min(under.us)


def shown(values: tuple[float, float] | None) -> str:
    """Return both ratios as text, or a dash."""
    return "-" if values is None else " / ".join(f"{value:.3g}" for value in values)


def as_rows(results: list[Result], limits: Limits | None) -> list[dict[str, Any]]:
    """Return what the tables and the file show; the results are of one scene."""
    limit = limits.step_us(make_scene(results[0].scene)) if limits else {}
    bound = max(limit.values(), default=0.0)
    rows = []
    for result in results:
        row: dict[str, Any] = asdict(result)
        if result.us:
            median = statistics.median(result.us)
            row |= {
                "median_us": median,
                "upstream_over_this": ratios(results, UPSTREAM, result),
                "taichi_over_this": ratios(results, TAICHI, result),
                "fraction_of_limit": bound / median if bound else None,
            }
        rows.append(row | {"limit_us": limit})
    return rows


def scene_table(rows: list[dict[str, Any]], *, title: str, running: bool = False) -> Table:
    """Return the table of one scene."""
    left_out = [f"{row['peer']}: {row['skipped']}" for row in rows if row["skipped"]]
    table = Table(
        title=title, title_justify="left", caption="\n".join(left_out), caption_justify="left"
    )
    table.add_column("", no_wrap=True)
    headings = ["us/step", "best", "x upstream"]
    if not running:
        headings += ["x taichi", "of limit", "error [m]"]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        if row["skipped"]:
            continue
        cells = [f"{row['median_us']:.4g}", f"{min(row['us']):.4g}"]
        cells.append(shown(row["upstream_over_this"]))
        if not running:
            cells.append(shown(row["taichi_over_this"]))
            cells.append(f"{row['fraction_of_limit']:.1%}")
            cells.append("-" if row["error"] is None else f"{row['error']:.1e}")
        table.add_row(row["peer"], *cells)
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    timed = [name for name in COUNTS if not name.endswith("-stiff")]
    parser.add_argument("--peer-python", type=Path, metavar="PATH")
    parser.add_argument("--scenes", nargs="+", choices=timed, default=timed)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--no-runs", action="store_true", help="leave the last tables out")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.peer_python is not None:
        # Peers start in another folder; a link stays a link, or it would leave its environment.
        options.peer_python = options.peer_python.absolute()
        if not options.peer_python.is_file():
            parser.error(f"--peer-python: there is no {options.peer_python}")
    console = Console(width=max(Console().width, 112))
    how = {"peer_python": options.peer_python, "rounds": options.rounds}

    limits = measure_limits()
    console.print(
        f"one core: {limits.gflops:.0f} GFLOP/s in multiply-adds, {limits.root_ns:.2f} ns a root,"
        f" {limits.division_ns:.2f} ns a division (float64, vectorised)"
    )
    steps, runs = [], []
    for name in options.scenes:
        scene = make_scene(name)
        rows = as_rows(compare(STEPPING, scene, **how), limits)
        steps += rows
        bounds = ", ".join(f"{key} {value:.3g} us" for key, value in rows[0]["limit_us"].items())
        title = "{}: {} nodes, {} bars, {} hinges\nlimits: {}".format(name, *scene.size, bounds)
        console.print(scene_table(rows, title=title))
    for name in RUN_SCENES if not options.no_runs else ():
        if name in options.scenes:
            scene = replace(make_scene(name), dt=RUN_DT)
            rows = as_rows(compare(RUNNING, scene, **how), None)
            runs += rows
            title = f"{name}, files to file, steps of {RUN_DT:g} s, every {SAVE_EVERY}th saved"
            console.print(scene_table(rows, title=title, running=True))
    if options.json:
        content = {"limits": limits.as_dict(), "steps": steps, "runs": runs}
        options.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
