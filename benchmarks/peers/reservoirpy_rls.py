"""reservoirpy's recursive least squares, timed when it is told to.

``python -m peers.reservoirpy_rls ROWS.npz WEIGHTS.npy`` answers every line on its standard input
with the CPU seconds that learning all rows took, and leaves bias and weights (1 + F,) in the file.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from reservoirpy.nodes import RLS

if __name__ == "__main__":
    rows = np.load(sys.argv[1])
    x, y = rows["x"], rows["y"][:, np.newaxis]
    settings = {"alpha": float(rows["penalty"]), "forgetting": float(rows["forgetting"])}
    RLS(**settings).partial_fit(x[:10], y[:10])
    print(json.dumps({"ready": True}), flush=True)
    for _ in sys.stdin:
        node = RLS(**settings)
        start = time.process_time()
        node.partial_fit(x, y)
        took = time.process_time() - start
        np.save(sys.argv[2], np.concatenate([node.bias.ravel(), node.Wout.ravel()]))
        print(json.dumps({"cpu_s": took}), flush=True)
