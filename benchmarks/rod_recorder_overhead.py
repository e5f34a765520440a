"""What one callback of the PyElastica recorder costs, beside what PyElastica users do by hand.

    python benchmarks/rod_recorder_overhead.py [--frames 4000] [--rounds 9] [--json]

Every callback fires and sees the state of a finalized rod, whose arrays are strided views into
PyElastica's memory block. Three ways of keeping it take turns in one process; processor time, one
thread, medians of the rounds. "callback" is what the loop waits for at a step, "+ file" everything
until the numbers lie in a file:

*recorder*: openprc-pyelastica, to simulation.h5, in blocks in the same thread; it also forms
and stores length and strain of every element, and looks for divergence.
*list*: copies appended to a dict of lists, then np.savez; nothing is written before the end.
*export*: PyElastica's own ExportCallBack, npz parts of 32 MB; it always keeps directors, too.

The accuracy that stands beside the speed: the largest difference between the numbers in the file
and those of the rod, which is 0. The limit that is known is the bare copy of positions and
velocities into memory that is made beforehand.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import elastica as ea
import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.hooks import record_run
from openprc.schema import Trajectory

STEP = 1e-4  # [s]
ELEMENTS = (10, 50, 200)
#: What a callback may cost [us].
BAR = 10.0


class Simulator(ea.BaseSystemCollection, ea.CallBacks):
    """The least that has callbacks."""


class Appending(ea.CallBackBaseClass):
    """The idiom of PyElastica's examples."""

    def __init__(self, kept: dict[str, list[np.ndarray]], *, directors: bool) -> None:
        """Take the lists to fill."""
        super().__init__()
        self.kept = kept
        self.directors = directors

    def make_callback(self, system: ea.CosseratRod, time: float, current_step: int) -> None:
        """Append copies."""
        self.kept["time"].append(time)
        self.kept["step"].append(current_step)
        self.kept["position"].append(system.position_collection.copy())
        self.kept["velocity"].append(system.velocity_collection.copy())
        if self.directors:
            self.kept["directors"].append(system.director_collection.copy())


def new_simulator(n_elements: int) -> tuple[Simulator, ea.CosseratRod]:
    """Return a simulator with one rod, not finalized."""
    simulator = Simulator()
    rod = ea.CosseratRod.straight_rod(
        n_elements,
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        np.array([0.0, 1.0, 0.0]),
        1.0,
        0.02,
        1000.0,
        youngs_modulus=1e6,
        shear_modulus=1e6 / 3.0,
    )
    simulator.append(rod)
    return simulator, rod


def fire(simulator: Simulator, frames: int, *, first: int = 1) -> float:
    """Call the callbacks once for each frame and return the processor time [s]."""
    before = time.process_time()
    for step in range(first, first + frames):
        simulator.apply_callbacks(time=step * STEP, current_step=step)
    return time.process_time() - before


#: Calls that fit into a block of the recorder at every size that is measured.
CALLS = 150

Cost = tuple[float, float]


def by_recorder(n: int, frames: int, folder: Path, *, directors: bool) -> Cost:
    """Record; also check that the file holds what the rod showed."""
    simulator, _ = new_simulator(n)
    recording = record_run(
        simulator, folder / "calls.h5", producer="pyelastica", directors=directors
    )
    simulator.finalize()
    calls = 0.0
    for first in range(1, frames + 1, CALLS):
        recording.session.flush()
        calls += fire(simulator, min(CALLS, frames + 1 - first), first=first)
    recording.close()
    simulator, rod = new_simulator(n)
    target = folder / "run.h5"
    recording = record_run(
        simulator, target, producer="pyelastica", overwrite=True, directors=directors
    )
    simulator.finalize()
    taken = fire(simulator, frames)
    # Only the numbers: validating the file is the same for each producer, and not timed here.
    before = time.process_time()
    recording.session.flush(commit=True)
    taken += time.process_time() - before
    recording.close()
    with Trajectory(target) as run:
        assert run.n_frames == frames + 1
        assert np.array_equal(run.positions()[-1], rod.position_collection.T)
    return calls, taken


def by_list(n: int, frames: int, folder: Path, *, directors: bool) -> Cost:
    """Append to lists, then save."""
    simulator, rod = new_simulator(n)
    kept: dict[str, list[np.ndarray]] = defaultdict(list)
    simulator.collect_diagnostics(rod).using(Appending, kept, directors=directors)
    simulator.finalize()
    taken = fire(simulator, frames)
    before = time.process_time()
    np.savez(folder / "list.npz", **{key: np.array(values) for key, values in kept.items()})
    return taken, taken + time.process_time() - before


def by_export(n: int, frames: int, folder: Path, *, directors: bool) -> Cost:
    """Let PyElastica export."""
    del directors  # it has no choice
    simulator, rod = new_simulator(n)
    simulator.collect_diagnostics(rod).using(
        ea.ExportCallBack,
        step_skip=1,
        filename="part",
        directory=str(folder / "export"),
        method="npz",
    )
    simulator.finalize()
    taken = fire(simulator, frames)
    before = time.process_time()
    simulator.close()
    return taken, taken + time.process_time() - before


def by_copy(n: int, frames: int, folder: Path, *, directors: bool) -> Cost:
    """Copy into memory that is made beforehand: the least that can be done."""
    del folder
    simulator, rod = new_simulator(n)
    simulator.finalize()
    rows = 256
    positions, velocities = np.empty((2, rows, 3, n + 1))
    turned = np.empty((rows, 3, 3, n))
    before = time.process_time()
    for step in range(frames):
        row = step % rows
        positions[row] = rod.position_collection
        velocities[row] = rod.velocity_collection
        if directors:
            turned[row] = rod.director_collection
    taken = time.process_time() - before
    return taken, taken


WAYS: dict[str, Callable[..., Cost]] = {
    "recorder": by_recorder,
    "list": by_list,
    "export": by_export,
    "copy": by_copy,
}


def measure(n: int, frames: int, rounds: int, *, directors: bool) -> list[dict[str, object]]:
    """Return two rows of the table: microseconds a callback, and ratios."""
    taken: dict[str, list[Cost]] = {name: [] for name in WAYS}
    for _ in range(rounds):
        for name, way in WAYS.items():
            with tempfile.TemporaryDirectory() as folder:
                calls, whole = way(n, frames, Path(folder), directors=directors)
                taken[name].append((1e6 * calls / frames, 1e6 * whole / frames))
    rows = []
    for part, label in enumerate(("callback", "+ file")):
        cost = {name: np.array([pair[part] for pair in pairs]) for name, pairs in taken.items()}
        rows.append(
            {
                "part": label,
                "elements": n,
                "directors": directors,
                **{f"{name}_us": float(np.median(values)) for name, values in cost.items()},
                **{
                    f"recorder_to_{name}": float(np.median(cost["recorder"] / cost[name]))
                    for name in ("list", "export", "copy")
                },
                "share_of_bar": float(np.median(cost["recorder"])) / BAR,
            }
        )
    return rows


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = [
        row
        for directors in (False, True)
        for n in ELEMENTS
        for row in measure(n, options.frames, options.rounds, directors=directors)
    ]
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    table = Table(title="a callback that fires: us, and the recorder's time over the others'")
    names = ("part", "n", "directors", *WAYS, "/list", "/export", "/copy", f"of {BAR:g} us")
    for name in names:
        table.add_column(name, justify="right")
    for row in sorted(rows, key=lambda row: row["part"] == "+ file"):
        table.add_row(
            row["part"],
            str(row["elements"]),
            "yes" if row["directors"] else "no",
            *(f"{row[f'{name}_us']:.2f}" for name in WAYS),
            *(f"{row[f'recorder_to_{name}']:.2f}" for name in ("list", "export", "copy")),
            f"{row['share_of_bar']:.0%}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
