"""pyidi (MIT): Lucas-Kanade translation, or its affine correlation, against the first frame.

python -m peers.pyidi_tracks GIVEN.npz MADE.npz lk|dic
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import time

import numpy as np
import pyidi


def main() -> None:
    """Track and write positions (T, N, 2) [px] and CPU seconds."""
    given, made, method = sys.argv[1:4]
    with np.load(given) as data:
        frames, points = data["frames"], data["points"]
    start = np.rint(points)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        video = pyidi.VideoReader(frames, root=folder)
        kind = pyidi.LucasKanade if method == "lk" else pyidi.DIC
        tracker = kind(video)
        tracker.set_points(start[:, ::-1].astype(int))
        tracker.configure(roi_size=(21, 21), show_pbar=False, verbose=0, processes=1)
        # Once on two frames, so that compiling is not timed.
        began = time.process_time()
        moved = np.asarray(tracker.get_displacements(autosave=False))
        seconds = time.process_time() - began
    positions = points[None] + np.moveaxis(moved, 0, 1)[:, :, ::-1]
    np.savez(made, positions=positions, seconds=seconds)


if __name__ == "__main__":
    os.environ.setdefault("MPLBACKEND", "agg")
    main()
