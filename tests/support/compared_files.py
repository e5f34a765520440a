"""Files of a body whose motion is a formula, so that every deviation between them is known."""

from __future__ import annotations

import numpy as np

from openprc.compare.alignment.settings import AlignmentSettings
from openprc.compare.comparison import compare_files
from openprc.schema import Provenance, TrajectoryWriter

#: Places that no rotation, reflection or permutation maps onto each other.
REST = np.array(
    [[0.0, 0, 0], [1, 0, 0.1], [0.2, 1.3, 0], [1.1, 1.6, 0.4], [2.3, 0.1, 0.7], [0.4, 2.9, 1.0]]
)
SPEED = 2 * np.pi * np.array([1.0, 1.3, 1.7, 2.1, 2.4, 3.0])


def motion(t, *, amplitude=0.05):
    """Return places (T, 6, 3) and velocities at times t."""
    phase = SPEED[:, None] * np.asarray(t)[:, None, None] + np.array([0.0, 0.7, 1.9])
    places = REST + amplitude * (np.sin(phase) + 0.3 * np.cos(2 * phase))
    return places, amplitude * SPEED[:, None] * (np.cos(phase) - 0.6 * np.sin(2 * phase))


def write(path, t, places, *, velocities=None, unit="m", kind="physical", time_unit=None,
          seen=None, block=97, system=None, drive=None, sequence=None, bars=None, hinges=None,
          channel=None, **nodes):  # fmt: skip
    """Write a trajectory; `drive` is (T, C), `system` maps names to (T,)."""
    t, places = np.asarray(t, dtype="f8"), np.asarray(places)
    if seen is not None:
        places = np.where(seen[..., None] == 0, np.nan, places)
    with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
        writer.declare_time(unit=time_unit or ("s" if kind == "physical" else "1"), kind=kind)
        writer.declare_nodes(
            places.shape[1], places.shape[2], unit=unit, velocities=velocities is not None,
            observed=seen is not None, **nodes,
        )  # fmt: skip
        if bars is not None:
            writer.declare_elements("bars", bars)
        if hinges is not None:
            writer.declare_elements("hinges", hinges)
        for name in system or {}:
            writer.declare_system(name)
        if drive is not None:
            drive = np.asarray(drive, dtype="f8").reshape(len(t), -1)
            columns = [f"c{k}" for k in range(drive.shape[1])]
            writer.declare_input(
                "drive", columns, quantity="force", unit="N",
                **({} if sequence is None else {"sequence": sequence, "hold": 0.1}),
            )  # fmt: skip
        if channel is not None:
            writer.declare_channel("load", ["factor"], unit="1")
        for a in range(0, len(t), block):
            rows = slice(a, a + block)
            writer.append(
                t[rows],
                positions=places[rows],
                velocities=None if velocities is None else velocities[rows],
                observed=None if seen is None else seen[rows],
                system={k: v[rows] for k, v in (system or {}).items()},
                inputs={} if drive is None else {"drive": drive[rows]},
                channels={} if channel is None else {"load": np.asarray(channel)[rows, None]},
            )
    return path


def compared(reference, other, **settings):
    """Compare two files and return the pair."""
    pair = compare_files(reference, [other], settings=AlignmentSettings(**settings)).pairs[0]
    # Everything has to be plain for JSON.
    assert pair.as_dict()["n_samples"] == pair.n_samples
    return pair


def rotation(angles=(0.3, -0.8, 1.2)):
    """Return a rotation by Euler angles: (3, 3)."""
    a, b, c = (np.array([[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]]) for x in angles)
    x, y, z = np.eye(3), np.eye(3), np.eye(3)
    x[1:, 1:], y[::2, ::2], z[:2, :2] = a, b, c
    return x @ y @ z


def rms(apart):
    """Return the root of the mean squared distance of (..., d)."""
    return np.sqrt(np.nanmean((apart**2).sum(axis=-1)))
