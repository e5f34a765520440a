"""Small trajectory files with known content."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from openprc.schema import Provenance, TrajectoryWriter

HOLD_FRAMES = 5
DT = 0.01


def tapped_delay_line(symbols, n_taps, hold_frames):
    """Return (T, n_taps) channels: column k is the held input k symbols ago."""
    held = np.repeat(symbols, hold_frames)
    return np.stack(
        [
            np.concatenate([np.zeros(k * hold_frames), held[: len(held) - k * hold_frames]])
            for k in range(n_taps)
        ],
        axis=1,
    )


@pytest.fixture(scope="session")
def delay_line(tmp_path_factory):
    """Path of a file whose channels are a tapped delay line of 300 symbols, 8 taps."""
    rng = np.random.default_rng(7)
    symbols = rng.uniform(-1.0, 1.0, 300)
    taps = tapped_delay_line(symbols, 8, HOLD_FRAMES)
    path: Path = tmp_path_factory.mktemp("delay") / "simulation.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_channel("taps", [f"d{k}" for k in range(8)], unit="V")
        writer.declare_input(
            "drive",
            ["u"],
            quantity="voltage",
            unit="V",
            sequence=symbols[:, None],
            hold=HOLD_FRAMES * DT,
        )
        writer.append(
            np.arange(len(taps)) * DT,
            channels={"taps": taps},
            inputs={"drive": np.repeat(symbols, HOLD_FRAMES)[:, None]},
        )
    return path


@pytest.fixture
def make_body(tmp_path):
    """Return a function that writes a body of three nodes and two bars, and returns its path.

    Node 0 is fixed at the origin, node 1 moves as sin in y, node 2 as cos in z (if 3-D); the
    first sample of a node in `gaps` is missing where `gaps` says so.
    """

    def make(
        *,
        n_frames=40,
        dims=3,
        gaps=None,
        rest=True,
        rest_lengths=True,
        stored_lengths=False,
        time=None,
        time_unit="s",
        time_kind="physical",
        inputs=True,
        sequence=None,
        hold=None,
        start=0.0,
        name="simulation.h5",
    ):
        time = np.arange(n_frames) * DT if time is None else np.asarray(time)
        n_frames = len(time)
        phase = 2 * np.pi * np.arange(n_frames) / 20
        positions = np.zeros((n_frames, 3, dims))
        positions[:, :, 0] = np.arange(3)
        positions[:, 1, 1] = 0.1 * np.sin(phase)
        positions[:, 2, -1] += 0.2 * np.cos(phase)
        undeformed = np.zeros((3, dims))
        undeformed[:, 0] = np.arange(3)
        lengths = np.stack(
            [
                np.linalg.norm(positions[:, b] - positions[:, a], axis=1)
                for a, b in ((0, 1), (1, 2))
            ],
            axis=1,
        )
        observed = np.ones((n_frames, 3), dtype="u1")
        for node, frames in (gaps or {}).items():
            observed[frames, node] = 0
        positions[observed == 0] = np.nan
        path = tmp_path / name
        with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
            writer.declare_time(unit=time_unit, kind=time_kind)
            writer.declare_nodes(
                3,
                dims,
                unit="m",
                observed=gaps is not None,
                rest=undeformed if rest else None,
            )
            writer.declare_elements(
                "bars",
                np.array([[0, 1], [1, 2]]),
                series={"length": "m"} if stored_lengths else {},
                static={"rest_length": (np.array([1.0, 1.0]), "m")} if rest_lengths else {},
            )
            given = {}
            if inputs:
                writer.declare_input(
                    "base", ["x", "z"], quantity="position", unit="m", targets=["0"]
                )
                given["base"] = np.stack([np.zeros(n_frames), np.sin(phase)], axis=1)
            if sequence is not None:
                sequence = np.asarray(sequence, dtype=float).reshape(len(sequence), -1)
                writer.declare_input(
                    "symbols",
                    ["u"],
                    quantity="force",
                    unit="N",
                    sequence=sequence,
                    hold=hold,
                    start=start,
                )
                index = np.floor((time - start) / hold + 1e-6).astype(int)
                held = np.clip(index, 0, len(sequence) - 1)
                given["symbols"] = sequence[held]
            writer.append(
                time,
                positions=positions,
                observed=observed if gaps is not None else None,
                elements={("bars", "length"): lengths} if stored_lengths else None,
                inputs=given,
            )
        return path

    return make
