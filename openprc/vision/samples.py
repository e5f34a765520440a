"""A small synthetic video whose motion is known in closed form."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.hooks.protocols import Sample
from openprc.vision.synth import Photometry, Scene, speckle
from openprc.vision.synth.motions import TileMotion

FPS = 30.0
#: A symbol is held from one frame to the next.
N_SYMBOLS = 500
#: Patches down and across, and the side of each [px].
GRID, SIDE = (3, 4), 40

_AMPLITUDE = np.array([6.0, 4.0])


def symbols() -> NDArray[np.float64]:
    """Return the drive, (K, 1), uniform in [-1, 1]."""
    return np.random.default_rng(7).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def patch_centres() -> NDArray[np.float64]:
    """Return the places of the patches at rest, (12, 2) [px]."""
    x, y = np.meshgrid(np.arange(GRID[1]), np.arange(GRID[0]))
    return SIDE * (0.5 + np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))


def displacements() -> NDArray[np.float64]:
    """Return the motion of the patches at rest and after each symbol, (K + 1, 12, 2) [px].

    Patch i moves in x as a damped oscillator that the held drive u pulls along,
    ``x'' + 2 zeta w x' + w^2 (x - u) = 0``, with a frequency w of its own; its exact step over
    one symbol is that of the free oscillator in x - u. In y it shows a squashed view of its
    velocity, which is what makes the body nonlinear.
    """
    hold = 1.0 / FPS
    w = 2.0 * np.pi / (hold * np.geomspace(2.5, 25.0, 12))
    zeta = 0.6
    rate, ringing = zeta * w, w * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-rate * hold)
    cosine, sine = np.cos(ringing * hold), np.sin(ringing * hold) / ringing
    state = np.zeros((N_SYMBOLS + 1, 12, 2))
    x, v = np.zeros(12), np.zeros(12)
    for k, u in enumerate(symbols()[:, 0]):
        away = x - u
        x = u + decay * ((cosine + rate * sine) * away + sine * v)
        v = decay * ((cosine - rate * sine) * v - w**2 * sine * away)
        squashed = np.tanh(2.0 * (v / w + 0.6)) - np.tanh(1.2)
        state[k + 1] = np.stack([x / 1.5, squashed], axis=-1)
    return _AMPLITUDE * state


def clip() -> Scene:
    """Return the patches as a clip: every one speckled, seen through a window that stands still."""
    moved = displacements().reshape(-1, *GRID, 2)
    return Scene(
        texture=speckle(sigma=(1.2, 1.6), cell=5.0, seed=11),
        motion=TileMotion(moved, SIDE),
        n_frames=len(moved),
        shape=(GRID[0] * SIDE, GRID[1] * SIDE),
        photometry=Photometry(noise=1.0),
    )


@cache
def _video() -> bytes:
    # Rendering takes seconds, and whoever checks an importer asks for its sample many times.
    with tempfile.TemporaryDirectory() as folder:
        return clip().write(Path(folder) / "patches.avi", fps=FPS).read_bytes()


def write_sample(folder: Path) -> Sample:
    """Render the patches into a lossless AVI in `folder`: at rest, then after each symbol.

    Raises
    ------
    MissingDependency
        Without OpenCV.
    UnreadableFile
        When OpenCV cannot write the video.
    """
    path = Path(folder) / "patches.avi"
    path.write_bytes(_video())
    points = Path(folder) / "points.csv"
    lines = [f"{x:g},{y:g}\n" for x, y in patch_centres()]
    points.write_text("x,y\n" + "".join(lines))
    drive = {
        "sequence": symbols(),
        "hold": 1.0 / FPS,
        "start": 0.0,
        "unit": "1",
        "quantity": "drive",
    }
    return Sample(path=path, options={"points": str(points)}, inputs={"drive": drive})
