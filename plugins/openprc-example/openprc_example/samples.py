"""A small run whose every number is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.hooks import Sample

N_ARMS = 6
N_SYMBOLS = 240
DT = 0.02  # s, time between two frames
FRAMES_PER_SYMBOL = 5
HOLD = 0.1  # s
ARM = 40.0  # mm
SPACING = 25.0  # mm


def symbols() -> NDArray[np.float64]:
    """Return the drive, (K, 1), uniform in [-1, 1]."""
    return np.random.default_rng(2024).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def times() -> NDArray[np.float64]:
    """Return the frame times, (T,) [s]: start of the first symbol to end of the last."""
    return DT * np.arange(N_SYMBOLS * FRAMES_PER_SYMBOL + 1, dtype=np.float64)


def angles() -> NDArray[np.float64]:
    """Return the angles of the arms, (T, N) [rad].

    Each arm is a damped oscillator that is pulled towards the symbol u held at the time,
    theta'' + 2 zeta w theta' + w^2 theta = w^2 u / 2. While u is constant the distance y to
    the equilibrium u / 2 obeys, with wd = w sqrt(1 - zeta^2),

        y(t)  = exp(-zeta w t) (y0 cos wd t + (v0 + zeta w y0) / wd sin wd t)
        y'(t) = exp(-zeta w t) (v0 cos wd t - (zeta w v0 + w^2 y0) / wd sin wd t),

    so going from frame to frame with it is exact.
    """
    w = 2.0 * np.pi * np.geomspace(0.6, 4.0, N_ARMS)
    zeta = np.linspace(0.3, 0.1, N_ARMS)
    wd = w * np.sqrt(1.0 - zeta**2)
    decay, cos, sin = np.exp(-zeta * w * DT), np.cos(wd * DT), np.sin(wd * DT)
    theta = np.zeros((len(times()), N_ARMS))
    speed = np.zeros(N_ARMS)
    drive = symbols_at_frames()
    for i in range(1, len(theta)):
        rest = 0.5 * drive[i - 1]
        y = theta[i - 1] - rest
        theta[i] = rest + decay * (y * cos + (speed + zeta * w * y) / wd * sin)
        speed = decay * (speed * cos - (zeta * w * speed + w**2 * y) / wd * sin)
    return theta


def symbols_at_frames() -> NDArray[np.float64]:
    """Return the input on the clock of the frames, (T,); the last symbol stays."""
    held = np.repeat(symbols()[:, 0], FRAMES_PER_SYMBOL)
    return np.append(held, held[-1])


def positions() -> NDArray[np.float64]:
    """Return the tips of the arms, (T, N, 2) [mm], hanging from a row of pivots."""
    theta = angles()
    x = np.arange(N_ARMS) * SPACING + ARM * np.sin(theta)
    return np.stack([x, -ARM * np.cos(theta)], axis=-1)


def write_sample(folder: Path) -> Sample:
    """Write the run as a CSV file into `folder`.

    The input stands in the column u; with the option hold its symbols come along, so the
    sample has none to attach afterwards.
    """
    path = Path(folder) / "arms.csv"
    tips = positions()
    names = [f"{axis}{n} [mm]" for n in range(N_ARMS) for axis in "xy"]
    names = ["t", *names, *(f"angle/arm{n} [rad]" for n in range(N_ARMS)), "u [1]"]
    rows = np.column_stack([times(), tips.reshape(len(tips), -1), angles(), symbols_at_frames()])
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Sample(path=path, options={"hold": HOLD})
