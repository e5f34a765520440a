"""A driven network as a simulation.h5, so that whatever reads a body's file reads it as well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from openprc.reservoir.networks.base import (
    DrivenNetwork,
    checked_count,
    checked_number,
    checked_symbols,
)
from openprc.schema import Provenance, TrajectoryWriter


def write_network_run(
    path: str | Path,
    network: DrivenNetwork,
    u: ArrayLike,
    *,
    hold: float = 1.0,
    frames_per_symbol: int = 1,
    initial: ArrayLike | None = None,
    noise: float = 0.0,
    seed: int | np.random.Generator = 0,
    overwrite: bool = False,
) -> Path:
    """Drive a network and write its states as the channel ``state`` of a trajectory file.

    The states of a symbol stand in all frames of that symbol, which lie strictly inside it:
    frame j of S in symbol k is at ``hold (k + (j + 1/2) / S)``.

    Parameters
    ----------
    u : (K,) or (K, C)
        Symbols, stored as those of the input ``drive``.
    hold : float [s]
        Duration of a symbol.
    frames_per_symbol : int
        S.
    initial : (N,), optional
        State to start from; zero by default.
    noise : float
        Standard deviation of independent normal noise on every state of every frame, as of a
        sensor.
    seed : int or numpy.random.Generator
        Of the noise.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    TaskError
        When a setting is out of range, or the input does not fit the network.
    ResultExists
        When the file exists and `overwrite` is False.
    """
    hold = checked_number(hold, key="hold", low=1e-12)
    noise = checked_number(noise, key="noise", low=0.0)
    per_symbol = checked_count(frames_per_symbol, key="frames_per_symbol")
    symbols = checked_symbols(u, network.n_inputs)
    states = np.repeat(network.drive(symbols, initial=initial), per_symbol, axis=0)
    if noise:
        states += noise * np.random.default_rng(seed).normal(size=states.shape)
    time = hold * (np.arange(len(states)) + 0.5) / per_symbol
    columns = [f"u{c}" for c in range(network.n_inputs)]
    names = [f"x{i}" for i in range(network.n_states)]
    made_by = Provenance("openprc.reservoir.networks", config=network.config())
    with TrajectoryWriter(path, provenance=made_by, overwrite=overwrite) as writer:
        writer.declare_channel("state", names, unit="1")
        writer.declare_input(
            "drive", columns, quantity="signal", unit="1", sequence=symbols, hold=hold
        )
        writer.append(
            time,
            channels={"state": states},
            inputs={"drive": np.repeat(symbols, per_symbol, axis=0)},
        )
    return Path(path)
