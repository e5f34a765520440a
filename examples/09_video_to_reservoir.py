"""From a video to what the filmed body remembers.

Twelve patches hang on springs and are driven by random symbols; they are rendered, so that their
motion is known. The video is tracked, calibrated by a scale bar, and what it shows becomes the
states of a reservoir, as those of a simulation would.

python examples/09_video_to_reservoir.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from openprc.analysis.benchmarks.memory_benchmark import MemoryBenchmark
from openprc.hooks import import_file
from openprc.reservoir import NodeDisplacements, Ridge, Split, StateLoader, Trainer
from openprc.schema import Trajectory
from openprc.vision.samples import FPS, displacements, patch_centres, symbols, write_sample

#: The edge of a pixel [mm]: 120 px are 30 mm.
SCALE = 0.25


def main(folder: Path) -> None:
    """Film, track, calibrate, and measure the memory of the body."""
    clip = write_sample(folder).path
    times = np.arange(len(symbols())) / FPS
    np.savetxt(
        folder / "drive.csv", np.column_stack([times, symbols()]), delimiter=",",
        header="t [s],u", comments="",
    )  # fmt: skip
    np.savetxt(folder / "points.csv", patch_centres(), delimiter=",")
    options = {
        "points": folder / "points.csv",
        "drive": folder / "drive.csv",
        "scale_bar": "20,60,140,60,30 mm",
    }
    run = import_file(clip, folder / "run.h5", as_name="vision", options=options)
    with Trajectory(run.path) as trajectory:
        places = trajectory.positions()
        sigma = np.nanmedian(trajectory.extension("openprc-vision", "sigma"))
    moved = (places - places[0]) / SCALE
    error = moved - displacements()
    rms = float(np.sqrt(np.nanmean(error**2)))
    print(f"{run.n_frames} frames, {run.n_nodes} points, unit mm")
    print(f"rms error {rms:.4f} px = {1e3 * rms * SCALE:.2g} um; told: sigma {1e3 * sigma:.2g} um")

    print("states                     memory  capacity")
    figures = {}
    with StateLoader(run.path) as loader:
        rows = (
            ("x of all points", NodeDisplacements(dims=[0])),
            ("x of three points", NodeDisplacements(node_ids=[0, 5, 11], dims=[0])),
            ("x and y of all points", NodeDisplacements(dims=[0, 1])),
        )
        for name, features in rows:
            trainer = Trainer(
                features, Ridge(), loader=loader, split=Split(), experiment_dir=folder
            )
            score = MemoryBenchmark("memory").run(
                trainer, loader.symbols().sequence[:, 0], delays={1: 20, 2: 6}
            )
            m = score.metrics
            print(f"{name:26s} {m['mc_jaeger']:6.2f}  {m['ipc_total']:8.2f}")
            figures[name] = m
    # What was filmed is what was rendered, and more sensors see more.
    assert rms < 0.05
    few, many = figures["x of three points"], figures["x of all points"]
    assert few["mc_jaeger"] < many["mc_jaeger"] <= 12
    # x answers linearly, y does not: only with y there is capacity of the second degree.
    assert figures["x and y of all points"]["mc_nonlinear"] > many["mc_nonlinear"] + 0.5


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
