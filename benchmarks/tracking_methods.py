"""The trackers that the tracking benchmarks compare, ours and those of other projects.

A peer runs in an interpreter of its own, in which its package is installed; it is handed the
frames and the points as arrays and gives positions back.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from openprc.vision import KLTConfig, Tracker
from openprc.vision.source.arrays import ArraySource
from openprc.vision.tracking.refinement import RefineSettings

HERE = Path(__file__).parent

#: Ours by name. "plain KLT" is what the paper describes, and what its package does.
OURS: dict[str, KLTConfig] = {
    "ours": KLTConfig(),
    "ours, affine": KLTConfig(refinement=RefineSettings(model="affine")),
    "ours, translation": KLTConfig(refinement=RefineSettings(model="translation")),
    "plain KLT": KLTConfig(refine="none", fb_threshold=1.0, max_level=3),
}
#: Peers by name: module of `benchmarks/peers`, its method, and the option that names the
#: interpreter.
PEERS: dict[str, tuple[str, str, str]] = {
    "pyidi LK": ("pyidi_tracks", "lk", "pyidi"),
    "pyidi DIC": ("pyidi_tracks", "dic", "pyidi"),
    "pyvale": ("pyvale_tracks", "affine", "pyvale"),
    "trackpy": ("trackpy_tracks", "centroid", "trackpy"),
}


@dataclass
class Tracks:
    """What a tracker found.

    Attributes
    ----------
    positions : (T, N, 2) [px]
        NaN where it says that it does not know.
    sigma : (T, N, 2) [px], or None
    seconds : float
        CPU time of the tracking, without making or reading the frames.
    """

    positions: np.ndarray
    sigma: np.ndarray | None
    seconds: float


def track_ours(
    frames: np.ndarray, points: np.ndarray, config: KLTConfig, *, times: np.ndarray | None = None
) -> Tracks:
    """Track points (N, 2) [px] through frames (T, H, W)."""
    source = ArraySource(frames, fps=30.0) if times is None else ArraySource(frames, times=times)
    started = time.process_time()
    result = Tracker(source, points, config=config).run()
    return Tracks(result.positions, result.sigma, time.process_time() - started)


def track_peer(
    frames: np.ndarray, points: np.ndarray, name: str, interpreter: Path
) -> tuple[Tracks | None, str]:
    """Have a peer do the same; without tracks, the reason."""
    module, method, _ = PEERS[name]
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "given.npz", Path(folder) / "made.npz"
        np.savez(given, frames=frames, points=points)
        done = subprocess.run(
            [interpreter, "-m", f"peers.{module}", given, made, method],
            cwd=HERE,
            env=os.environ
            | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode or not made.exists():
            words = (done.stderr or done.stdout).strip().splitlines()
            return None, words[-1][:120] if words else f"exit {done.returncode}"
        with np.load(made) as data:
            return Tracks(data["positions"], None, float(data["seconds"])), ""


def add_peer_options(parser: Any) -> None:
    """Add ``--pyidi PYTHON`` and the like."""
    for option in dict.fromkeys(option for _, _, option in PEERS.values()):
        parser.add_argument(
            f"--{option}", type=Path, help=f"interpreter in which {option} is installed"
        )


def peers_given(arguments: Any) -> dict[str, Path]:
    """Return the interpreter of every peer that has one."""
    return {
        name: getattr(arguments, option)
        for name, (_, _, option) in PEERS.items()
        if getattr(arguments, option, None) is not None
    }


def write_json(path: Path | None, data: Any) -> None:
    """Write what was measured."""
    if path is not None:
        path.write_text(json.dumps(data, indent=1) + "\n")
