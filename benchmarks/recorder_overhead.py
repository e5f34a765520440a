"""What recording a PyBullet script costs, beside PyBullet's own state logger.

    python benchmarks/recorder_overhead.py [--rounds 9] [--blocks 12] [--json]

Two robots of pybullet_data move to a pose: laikago (base and 16 links, standing on a plane) and
an arm on a fixed base (7 links). The same deterministic run is made by each way in turn, in a
server of its own; CPU time is taken for blocks of steps. A cost is the mean over blocks of the
median over rounds. Writing to the file is part of it; opening, and validating the finished file,
which do not grow with every step, are not.

Ways:

- stepping: ``stepSimulation`` and nothing else;
- logger: ``startStateLogging(STATE_LOGGING_GENERIC_ROBOT)``, the peer, C++ inside the server.
  It writes the base and the joint coordinates in single precision, and no links;
- calls: the PyBullet calls that give base and links with velocities, results dropped: what no
  recorder in Python can go below;
- by hand: the same calls, their results kept in a list, as scripts do;
- recorder: `openprc.hooks.record_run`, positions and velocities of base and links, to the file;
- with joints: the same and joint positions, velocities and torques.

Beside the speed stands the largest deviation from what the API tells right after the step: of
the position of the base for the logger, of all nodes for the recorder.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
from openprc_pybullet.client import quiet
from openprc_pybullet.state_log import read_state_log
from rich.console import Console
from rich.table import Table

from openprc.hooks import record_run
from openprc.schema import Trajectory

STEPS = {"laikago": 128, "kuka": 1024}
WARM = 64
Look = Callable[[], object]


class Scene:
    """A server of its own with one robot that moves to a pose."""

    def __init__(self, robot: str) -> None:
        with quiet():
            self.client = pybullet.connect(pybullet.DIRECT)
            there = {"physicsClientId": self.client}
            pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), **there)
            pybullet.setGravity(0, 0, -9.81, **there)
            if robot == "laikago":
                pybullet.loadURDF("plane.urdf", **there)
                self.body = pybullet.loadURDF(
                    "laikago/laikago_toes.urdf", (0, 0, 0.48), (0, 0.5, 0.5, 0), **there
                )
            else:
                self.body = pybullet.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True, **there)
        self.links = list(range(pybullet.getNumJoints(self.body, self.client)))
        moving = [j for j in self.links if pybullet.getJointInfo(self.body, j, self.client)[2] < 2]
        self.n_moving = len(moving)
        pybullet.setJointMotorControlArray(
            self.body,
            moving,
            pybullet.POSITION_CONTROL,
            targetPositions=np.linspace(-0.3, 0.3, len(moving)).tolist(),
            **there,
        )

    def close(self) -> None:
        """Stop the server."""
        with quiet():
            pybullet.disconnect(self.client)

    def calls(self) -> Look:
        """Return a function that asks for base and links and drops the answers."""
        body, links, client = self.body, self.links, self.client
        pose, speed = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        states = pybullet.getLinkStates

        def look() -> object:
            pose(body, client)
            speed(body, client)
            return states(body, links, 1, 1, client)

        return look

    def by_hand(self) -> Look:
        """Return a function that keeps the answers, as scripts do."""
        kept: list[object] = []
        body, links, client = self.body, self.links, self.client

        def look() -> object:
            kept.append(pybullet.getBasePositionAndOrientation(body, physicsClientId=client))
            kept.append(pybullet.getBaseVelocity(body, physicsClientId=client))
            kept.append(
                pybullet.getLinkStates(
                    body, links, computeLinkVelocity=1, computeForwardKinematics=1,
                    physicsClientId=client,
                )
            )  # fmt: skip
            return None

        return look

    def positions(self) -> list[tuple[float, ...]]:
        """Return where base and links are now (N, 3) [m]."""
        base = pybullet.getBasePositionAndOrientation(self.body, self.client)[0]
        links = pybullet.getLinkStates(self.body, self.links, 1, 1, self.client)
        return [base, *(state[0] for state in links)]


def begin(way: str, scene: Scene, folder: Path, stack: ExitStack) -> tuple[Look, Look]:
    """Start a way; return what makes one step of it, and what writes all that waits."""
    client, simulate = scene.client, pybullet.stepSimulation
    if way in ("recorder", "with joints"):
        options = {"bodies": [scene.body], "joints": way == "with joints"}
        session = stack.enter_context(
            record_run(client, folder / "run.h5", producer="pybullet", overwrite=True, **options)
        )
        return session.step, session.flush
    if way == "logger":
        with quiet():
            logger = pybullet.startStateLogging(
                pybullet.STATE_LOGGING_GENERIC_ROBOT,
                str(folder / "run.log"),
                objectUniqueIds=[scene.body],
                maxLogDof=max(12, scene.n_moving),
                physicsClientId=client,
            )
        stack.callback(pybullet.stopStateLogging, logger, client)
    look = {"calls": scene.calls, "by hand": scene.by_hand}.get(way)
    if look is None:
        return lambda: simulate(client), nothing
    ask = look()

    def step_and_look() -> None:
        simulate(client)
        ask()

    return step_and_look, nothing


def nothing() -> None:
    """The logger writes every record through; the others write nothing."""


WAYS = ("stepping", "logger", "calls", "by hand", "recorder", "with joints")


def seconds_of(way: str, robot: str, folder: Path, n_blocks: int) -> list[float]:
    """Return CPU seconds a step for every block of one run, writing to the file included."""
    scene = Scene(robot)
    n = STEPS[robot]
    with ExitStack() as stack:
        stack.callback(scene.close)
        step, finish = begin(way, scene, folder, stack)
        for _ in range(WARM):
            step()
        finish()
        found = []
        for _ in range(n_blocks):
            start = time.process_time()
            for _ in range(n):
                step()
            found.append((time.process_time() - start) / n)
        start = time.process_time()
        finish()
        rest = (time.process_time() - start) / (n * n_blocks)
    return [value + rest for value in found]


def deviations(robot: str, folder: Path) -> dict[str, float]:
    """Return the largest deviation from the live API [m] of logger and recorder."""
    live: dict[str, list[list[tuple[float, ...]]]] = {}
    for way in ("logger", "recorder"):
        scene = Scene(robot)
        live[way] = []
        with ExitStack() as stack:
            stack.callback(scene.close)
            step, _ = begin(way, scene, folder, stack)
            for _ in range(500):
                step()
                live[way].append(scene.positions())
    records = read_state_log(folder / "run.log").records
    logged = np.stack([records[name] for name in ("posX", "posY", "posZ")], axis=1)
    with Trajectory(folder / "run.h5") as run:
        recorded = run.positions()[1:]
    return {
        "logger": float(np.abs(logged - np.array(live["logger"])[:, 0]).max()),
        "recorder": float(np.abs(recorded - np.array(live["recorder"])).max()),
    }


def measure(robot: str, folder: Path, *, rounds: int, n_blocks: int) -> dict[str, object]:
    """Let all ways take turns and return their costs in microseconds a step."""
    times = {way: np.empty((rounds, n_blocks)) for way in WAYS}
    for turn in range(rounds):
        for way in WAYS:
            times[way][turn] = seconds_of(way, robot, folder, n_blocks)
    # The same steps are in the same block each round: the median drops what disturbed a round,
    # the mean keeps the few blocks in which something is written.
    total = {way: 1e6 * float(np.median(t, axis=0).mean()) for way, t in times.items()}
    added = {way: total[way] - total["stepping"] for way in WAYS}
    return {
        "robot": robot,
        "total_us": total,
        "added_us": added,
        "total_over_logger": {way: total[way] / total["logger"] for way in WAYS},
        "added_over_logger": {way: added[way] / added["logger"] for way in WAYS},
        "added_over_calls": {way: added[way] / added["calls"] for way in WAYS},
        "deviation_m": deviations(robot, folder),
    }


def table_of(result: dict[str, object]) -> Table:
    """Return the costs of one robot as a table."""
    table = Table(title=f"{result['robot']}: CPU time of a step")
    heads = (
        "way",
        "us",
        "added us",
        "total / logger",
        "added / logger",
        "added / calls",
        "off by m",
    )
    for head in heads:
        table.add_column(head, justify="left" if head == "way" else "right")
    for way in WAYS:
        keys = ("total_over_logger", "added_over_logger", "added_over_calls")
        ratios = [f"{result[key][way]:.2f}" if way != "stepping" else "" for key in keys]  # type: ignore[index]
        off = result["deviation_m"].get(way)  # type: ignore[attr-defined]
        table.add_row(
            way,
            f"{result['total_us'][way]:.1f}",  # type: ignore[index]
            f"{result['added_us'][way]:.1f}",  # type: ignore[index]
            *ratios,
            "" if off is None else f"{off:.1e}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--blocks", type=int, default=12)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        results = [
            measure(robot, Path(name), rounds=options.rounds, n_blocks=options.blocks)
            for robot in STEPS
        ]
    if options.json:
        print(json.dumps(results, indent=2))
        return
    for result in results:
        Console().print(table_of(result))


if __name__ == "__main__":
    main()
