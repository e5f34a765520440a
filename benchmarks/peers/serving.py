"""How a peer is run: a process of its own that times blocks of steps when it is told to.

``python -m peers.NAME SCENE.npz POSITIONS.npy`` builds and compiles everything, leaves the
positions after `CHECKED_STEPS` steps in POSITIONS.npy and answers with one line of JSON. For
every number n on its standard input it then runs n steps from the start of the scene and
answers with the CPU and wall-clock seconds that they took. So peers in different interpreters
can take turns, and none compiles while another one is timed.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from engine_scenes import Scene, load_scene

CHECKED_STEPS = 20
#: Distance of the frames that runs to a file save.
SAVE_EVERY = 100

#: Runs n steps from the start of the scene; returns the positions (N, 3) [m] or None.
Run = Callable[[int], "np.ndarray | None"]


class NotExpressible(Exception):
    """The peer cannot model the scene."""


def serve(prepare: Callable[[Scene], Run], *, threads: int = 1, scenes: int = 1) -> None:
    """Answer the benchmark until standard input ends.

    Parameters
    ----------
    prepare : callable
        Builds everything for a scene and returns what runs it.
    threads : int
        Threads that a run keeps busy.
    scenes : int
        Copies of the scene that a run advances side by side.
    """
    # Banners and progress bars of a peer go to standard error; the answers have their own pipe.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(**values: Any) -> None:
        answers.write(json.dumps(values) + "\n")
        answers.flush()

    start = time.perf_counter()
    try:
        run = prepare(load_scene(Path(sys.argv[1])))
    except NotExpressible as reason:
        answer(skip=str(reason))
        return
    positions = run(CHECKED_STEPS)
    if positions is not None:
        np.save(sys.argv[2], positions)
    answer(threads=threads, scenes=scenes, ready_s=time.perf_counter() - start)
    for line in sys.stdin:
        cpu, wall = time.process_time(), time.perf_counter()
        run(int(line))
        answer(cpu_s=time.process_time() - cpu, wall_s=time.perf_counter() - wall)
