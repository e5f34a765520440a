"""pyvale (MIT): affine digital image correlation on a grid of its own.

    python -m peers.pyvale_tracks GIVEN.npz MADE.npz affine

It correlates every node of a grid and takes no points: windows begin at multiples of the step, so
with 20 px its nodes are at 10, 30, 50 ... px. The given points have to be among them.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from pyvale import dic

STEP = 20


def main() -> None:
    """Track and write positions (T, N, 2) [px] and CPU seconds."""
    given, made, _ = sys.argv[1:4]
    with np.load(given) as data:
        frames, points = data["frames"], data["points"]
    height, width = frames.shape[1:]
    mask = np.zeros((height, width), bool)
    low, high = points.min(axis=0) - STEP, points.max(axis=0) + STEP
    mask[int(max(low[1], 0)) : int(high[1]) + 1, int(max(low[0], 0)) : int(high[0]) + 1] = True
    positions = np.full((len(frames), len(points), 2), np.nan)
    positions[0] = points
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k, frame in enumerate(frames):
            cv2.imwrite(str(folder / f"frame_{k:05d}.tiff"), frame)
        seed = points[len(points) // 2].astype(int)
        began = time.process_time()
        dic.calculate_2d(
            reference=folder / "frame_00000.tiff",
            deformed=str(folder / "frame_*.tiff"),
            roi_mask=mask,
            seed=[int(seed[0]), int(seed[1])],
            subset_size=21,
            subset_step=STEP,
            num_threads=1,
            max_displacement=32,
            output_basepath=folder,
            print_level=0,
        )
        seconds = time.process_time() - began
        for k in range(1, len(frames)):
            # The line of names ends with a comma and so has a column more than the others.
            table = np.genfromtxt(
                folder / f"dic_results_frame_{k:05d}.csv", delimiter=",", skip_header=1
            )
            x, y, u, v = table[:, :4].T
            for n, point in enumerate(points):
                hit = np.flatnonzero((np.abs(x - point[0]) < 0.6) & (np.abs(y - point[1]) < 0.6))
                if len(hit):
                    positions[k, n] = point + np.array([u[hit[0]], v[hit[0]]])
    np.savez(made, positions=positions, seconds=seconds)


if __name__ == "__main__":
    main()
