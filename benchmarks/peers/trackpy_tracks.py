"""trackpy (BSD): centroids of bright spots, linked from frame to frame.

python -m peers.trackpy_tracks GIVEN.npz MADE.npz centroid
"""

from __future__ import annotations

import sys
import time

import numpy as np
import trackpy

DIAMETER = 11


def main() -> None:
    """Track and write positions (T, N, 2) [px] and CPU seconds.

    trackpy chooses the points itself; a given point is taken for the spot nearest to it in the
    first frame, and what counts is how that spot moves.
    """
    given, made, _ = sys.argv[1:4]
    with np.load(given) as data:
        frames, points = data["frames"], data["points"]
    trackpy.quiet()
    began = time.process_time()
    found = trackpy.batch(frames, DIAMETER, processes=1)
    linked = trackpy.link(found, search_range=5, memory=3)
    seconds = time.process_time() - began
    first = linked[linked.frame == 0]
    positions = np.full((len(frames), len(points), 2), np.nan)
    places = first[["x", "y"]].to_numpy()
    for n, point in enumerate(points):
        nearest = int(np.argmin(np.hypot(*(places - point).T)))
        particle = first.particle.iloc[nearest]
        path = linked[linked.particle == particle]
        moved = path[["x", "y"]].to_numpy() - places[nearest]
        positions[path.frame.to_numpy(), n] = point + moved
    np.savez(made, positions=positions, seconds=seconds)


if __name__ == "__main__":
    main()
