"""A small synthetic video whose motion is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.hooks.protocols import Sample
from openprc.vision.video import load_cv2

FPS = 30.0
#: Frames per input symbol.
HOLD_FRAMES = 3
N_SYMBOLS = 100
SHAPE = (120, 160)

_SPACING = 40.0
_AMPLITUDE = np.array([6.0, 4.0])


def symbols() -> NDArray[np.float64]:
    """Return the drive, (K, 1), uniform in [-1, 1]."""
    return np.random.default_rng(7).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def patch_centres() -> NDArray[np.float64]:
    """Return the places of the patches at rest, (12, 2) [px]."""
    x, y = np.meshgrid(np.arange(4), np.arange(3))
    return 20.0 + _SPACING * np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def displacements() -> NDArray[np.float64]:
    """Return the motion of the patches, (T, 12, 2) [px].

    Each patch follows the held drive u through a first-order lag with its own time constant,
    x' = (u - x) / tau, whose exact step over a frame is x <- u + (x - u) exp(-dt / tau). Up
    and down it moves by the squashed state of a slower lag, which makes the body nonlinear.
    """
    held = np.repeat(symbols()[:, 0], HOLD_FRAMES)
    tau = np.geomspace(0.05, 0.6, 12)
    decay = np.exp(-1.0 / FPS / np.stack([tau, 1.5 * tau], axis=1))
    state = np.zeros((len(held), 12, 2))
    for i in range(1, len(held)):
        # Frame i shows what the drive did in the interval before it.
        state[i] = held[i - 1] + (state[i - 1] - held[i - 1]) * decay
    state[..., 1] = np.tanh(2.0 * state[..., 1])
    return _AMPLITUDE * state


def write_sample(folder: Path) -> Sample:
    """Render the patches into a lossless AVI in `folder`.

    Raises
    ------
    MissingDependency
        Without OpenCV.
    UnreadableFile
        When OpenCV cannot write the video.
    """
    cv2 = load_cv2()
    path = Path(folder) / "patches.avi"
    rng = np.random.default_rng(11)
    # Five Gaussian spots a patch, drawn at their exact sub-pixel places.
    offsets = rng.uniform(-6.0, 6.0, (12, 5, 2))
    weights = rng.uniform(-70.0, 90.0, (12, 5)).ravel()
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"FFV1"), FPS, SHAPE[::-1], isColor=False
    )
    try:
        for moved in displacements():
            spots = (patch_centres()[:, None] + moved[:, None] + offsets).reshape(-1, 2)
            columns = np.exp(-((np.arange(SHAPE[1]) - spots[:, :1]) ** 2) / (2 * 2.0**2))
            rows = np.exp(-((np.arange(SHAPE[0]) - spots[:, 1:]) ** 2) / (2 * 2.0**2))
            image = 110.0 + (rows * weights[:, None]).T @ columns
            writer.write(np.clip(np.round(image), 0, 255).astype(np.uint8))
    finally:
        writer.release()
    if not path.exists() or path.stat().st_size == 0:
        raise UnreadableFile(
            "OpenCV wrote no video",
            expected="a build of OpenCV with the FFV1 encoder",
            fix="install the wheel opencv-python-headless",
            file=path,
        )
    drive = {
        "sequence": symbols(),
        "hold": HOLD_FRAMES / FPS,
        "start": 0.0,
        "unit": "1",
        "quantity": "drive",
    }
    return Sample(path=path, options={"max_points": 24}, inputs={"drive": drive})
