"""The ridge node of reservoirpy, as a process of its own: ``STATES.npz PREDICTION.npy``.

For every line on standard input it fits once and answers with the CPU seconds; the prediction of
the test rows is left in PREDICTION.npy.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from reservoirpy.nodes import Ridge


def main() -> None:
    """Fit as often as told."""
    with np.load(sys.argv[1]) as file:
        states, target, n_train = file["states"], file["target"][:, None], int(file["n_train"])
        penalty = float(file["penalty"])
    # It scales nothing itself; states arrive standardised, which is not timed.
    mean, scale = states[:n_train].mean(axis=0), states[:n_train].std(axis=0)
    states = (states - mean) / scale
    print(json.dumps({"ready": True}), flush=True)
    for _ in sys.stdin:
        start = time.process_time()
        node = Ridge(ridge=penalty).fit(states[:n_train], target[:n_train])
        seconds = time.process_time() - start
        np.save(sys.argv[2], np.asarray(node.run(states[n_train:])))
        print(json.dumps({"cpu_s": seconds}), flush=True)


if __name__ == "__main__":
    main()
