"""A small synthetic video whose motion is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.hooks.protocols import Sample
from openprc.vision.opencv import load_cv2

FPS = 30.0
#: A symbol is held from one frame to the next.
N_SYMBOLS = 500
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


def write_sample(folder: Path) -> Sample:
    """Render the patches into a lossless AVI in `folder`: at rest, then after each symbol.

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
        "hold": 1.0 / FPS,
        "start": 0.0,
        "unit": "1",
        "quantity": "drive",
    }
    return Sample(path=path, options={"max_points": 12}, inputs={"drive": drive})
