"""Kill a writing process at random moments and look at what it leaves.

``python benchmarks/crash_trial.py --tries 100`` prints how many partial files kept every
committed frame. SIGKILL ends a process between any two machine instructions; a loss of power is
another matter, and nothing here says anything about it.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import IncompleteFile, OpenPRCError, UnreadableFile
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, streams, validate_file
from openprc.schema.derive import repair

N_NODES, DIMS, DT = 20, 3, 0.01
BAR = [[0, 1], [1, 2]]


@dataclass(frozen=True)
class Setting:
    """How the writer under trial works: bytes of a block, bytes of a chunk, frames of a file."""

    block: int
    chunk: int
    frames: int


#: Blocks as they are in earnest, and small ones that keep the writer committing all the time.
#: Files are too small for HDF5 to split its index of chunks.
STEADY = (Setting(4 << 20, 512 << 10, 30_000), Setting(16 << 10, 512 << 10, 30_000))
#: Files large enough, or chunks small enough, for HDF5 to split its index of chunks time and
#: again. It does not write the parts of the index in an order that a kill cannot break.
GROWING = (
    Setting(4 << 20, 512 << 10, 200_000),
    Setting(16 << 10, 4 << 10, 40_000),
    Setting(64 << 10, 8 << 10, 4_000),
)


@dataclass(frozen=True)
class Outcome:
    """What one try left: how the partial file fared, its committed frames, finished files."""

    verdict: str
    frames: int = 0
    finished: int = 0
    detail: str = ""


def known_frames(start: int, stop: int) -> dict[str, NDArray[np.float64]]:
    """Return what frames `start` to `stop` hold, exact in binary."""
    frame = np.arange(start, stop)
    node = np.arange(N_NODES * DIMS).reshape(N_NODES, DIMS)
    positions = ((frame[:, None, None] * 7919 + node * 31) % 10007) / 64.0
    return {
        "time": frame * DT,
        "positions": positions,
        "length": positions[:, :2, 0] + 1.0,
        "drive": positions[:, :1, 1],
    }


def write_for_ever(folder: Path, setting: Setting) -> None:
    """Write known files as fast as possible, saying on stdout what has been committed."""
    streams.BLOCK_BYTES, streams.CHUNK_BYTES = setting.block, setting.chunk
    frames = setting.frames
    rng = random.Random(setting.block + setting.chunk)
    for number in range(1_000_000):
        with TrajectoryWriter(folder / f"run-{number}.h5", provenance=Provenance("crash")) as w:
            w.declare_nodes(N_NODES, DIMS, unit="m")
            w.declare_elements("bars", BAR, series={"length": "m"})
            w.declare_input("drive", ["u"], quantity="force", unit="N")
            start = said = 0
            while start < frames:
                stop = min(frames, start + rng.randint(1, 40))
                known = known_frames(start, stop)
                w.append(
                    known["time"],
                    positions=known["positions"],
                    elements={("bars", "length"): known["length"]},
                    inputs={"drive": known["drive"]},
                )
                start = stop
                committed = w._live[1].committed if w._live else 0
                if committed != said:
                    said = committed
                    sys.stdout.write(f"{number} {committed}\n")
                    sys.stdout.flush()
        sys.stdout.write(f"{number} done\n")
        sys.stdout.flush()


def one_try(seed: int, setting: Setting, *, longest: float = 0.5) -> Outcome:
    """Start a writer, kill it at a moment drawn from `seed`, and judge what is left."""
    rng = random.Random(seed)
    folder = Path(tempfile.mkdtemp(prefix="openprc-crash-"))
    command = [sys.executable, str(Path(__file__).resolve()), "--child", str(folder)]
    try:
        with subprocess.Popen(
            [*command, *map(str, astuple(setting))], stdout=subprocess.PIPE, text=True
        ) as child:
            assert child.stdout is not None
            heard = child.stdout.readline()
            time.sleep(rng.uniform(0.0, longest))
            child.kill()
            heard += child.stdout.read()
        if not heard:
            return Outcome("lost", detail="the writer stopped before its first commit")
        return _judge(folder, heard, setting.frames)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _judge(folder: Path, heard: str, frames: int) -> Outcome:
    said: dict[int, int] = {}
    for line in heard.splitlines():
        if not heard.endswith("\n") and line == heard.splitlines()[-1]:
            continue  # cut off by the kill
        number, what = line.split()
        said[int(number)] = frames if what == "done" else int(what)
    finished = sorted(folder.glob("run-*.h5"))
    for path in finished:
        with Trajectory(path) as trajectory:
            if trajectory.n_frames != frames or not _prefix_is_known(trajectory):
                return Outcome("lost", detail=f"{path.name} is under its final name and not whole")
    left = sorted(folder.glob("*.partial"))
    if not left:
        return Outcome("between two files", finished=len(finished))
    promised = said.get(int(left[0].name.split("-")[1].split(".")[0]), 0)
    try:
        with Trajectory(left[0], allow_incomplete=True) as trajectory:
            n_frames = trajectory.n_frames
            if n_frames < promised:
                return Outcome("lost", n_frames, detail=f"{promised} frames were committed")
            if not _prefix_is_known(trajectory):
                return Outcome("lost", n_frames, detail="committed frames differ")
        if n_frames == 0:
            return Outcome("nothing committed yet", finished=len(finished))
        saved = repair(left[0])
        with Trajectory(saved) as trajectory:
            whole = trajectory.n_frames == n_frames and _prefix_is_known(trajectory)
        report = validate_file(saved)
    except OpenPRCError as error:
        if promised == 0 and isinstance(error, IncompleteFile | UnreadableFile):
            return Outcome("nothing committed yet", finished=len(finished))
        return Outcome("lost", promised, detail=error.found)
    if not whole or not report.ok:
        return Outcome("lost", n_frames, detail=f"repair: {report.findings}")
    return Outcome("prefix kept", n_frames, len(finished))


def _prefix_is_known(trajectory: Trajectory) -> bool:
    known = known_frames(0, trajectory.n_frames)
    found = {
        "time": trajectory.time,
        "positions": trajectory.positions(),
        "length": trajectory.element("bars", "length") if trajectory.n_frames else known["length"],
        "drive": trajectory.input("drive").value if trajectory.n_frames else known["drive"],
    }
    return all(np.array_equal(found[name], known[name]) for name in known)


def run_trials(
    tries: int, settings: Sequence[Setting] = STEADY, *, seed: int = 0, longest: float = 0.5
) -> list[Outcome]:
    """Return the outcome of every try, the settings taking turns."""
    return [
        one_try(seed + number, settings[number % len(settings)], longest=longest)
        for number in range(tries)
    ]


def summary(outcomes: list[Outcome]) -> dict[str, object]:
    """Count verdicts. `survivors` are partial files with at least one committed frame, all kept."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    with_frames = counts["prefix kept"] + counts["lost"]
    return {
        "tries": len(outcomes),
        "with_committed_frames": with_frames,
        "survivors": counts["prefix kept"],
        "lost": counts["lost"],
        "verdicts": dict(counts),
        "finished_files": sum(outcome.finished for outcome in outcomes),
        "details": sorted({outcome.detail for outcome in outcomes if outcome.verdict == "lost"}),
    }


def main() -> int:
    """Run from the command line; exit code 1 when a committed frame was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=float, default=0.5, help="latest kill [s]")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", nargs=4, metavar=("DIR", "BLOCK", "CHUNK", "FRAMES"))
    parser.add_argument("--growing", action="store_true", help="files whose index splits")
    arguments = parser.parse_args()
    if arguments.child:
        folder, *numbers = arguments.child
        write_for_ever(Path(folder), Setting(*map(int, numbers)))
        return 0
    settings = GROWING if arguments.growing else STEADY
    outcomes = run_trials(arguments.tries, settings, seed=arguments.seed, longest=arguments.longest)
    found = summary(outcomes)
    if arguments.json:
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
    else:
        sys.stdout.write(
            f"{found['tries']} tries, {found['with_committed_frames']} partial files with "
            f"committed frames: {found['survivors']} kept them all, {found['lost']} did not; "
            f"{found['finished_files']} files under their final name, all whole\n"
        )
        for detail in found["details"]:  # type: ignore[attr-defined]
            sys.stdout.write(f"  {detail}\n")
    return 1 if found["lost"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
