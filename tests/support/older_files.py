"""Files as the older packages write them."""

from __future__ import annotations

import json

import h5py
import numpy as np

from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.schema.legacy import LegacyImporter

REST = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.2]], dtype="f4")


BARS = np.array([[0, 1], [1, 2], [2, 0]], dtype="i4")


N_FRAMES = 41


def motion(n_frames=N_FRAMES, *, planar=False):
    """Node 1 is driven along x, node 2 swings, the others rest: (T, 4, 3) [m]."""
    t = np.arange(n_frames) * 0.05
    x = np.repeat(REST[None].astype("f8"), n_frames, axis=0)
    x[:, 1, 0] += 0.1 * np.sin(2 * t)
    x[:, 2, 1] += 0.05 * np.sin(3 * t)
    x[:, 2, 2] += 0.05 * t
    if planar:
        x[..., 2] = 0.0
    return x.astype("f4")


def write_run(path, places, *, stored_drive=False, two_dimensional_energy=False, **attrs):
    """Write simulation.h5 as the engine does; `attrs` replace root attributes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    n = len(places)
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {
                "schema_version": "2.1.0",
                "frame_rate": 20.0,
                "completed": 1,
                "total_frames": n,
                "source_geometry": "../input/geometry.h5",
                **attrs,
            }
        )
        series = file.create_group("time_series")
        series["time"] = (np.arange(n) * 0.05).astype("f4")
        series["nodes/positions"] = places
        series["nodes/velocities"] = np.zeros_like(places)
        series["nodes/kinetic_energy"] = np.zeros(places.shape[:2], "f4")
        series["elements/bars/strain"] = np.zeros((n, len(BARS)), "f4")
        series["elements/bars/stress"] = np.zeros((n, len(BARS)), "f4")
        series["elements/hinges/angle"] = np.full((n, 1), 3.0, "f4")
        shape = (n, 1) if two_dimensional_energy else (n,)
        for name in ("kinetic_energy", "potential_energy", "total_energy"):
            series[f"system/{name}"] = np.arange(n, dtype="f4").reshape(shape)
        series["system/damping_loss"] = np.zeros((n, 1), "f4")
        if stored_drive:
            series["actuation_signals/1"] = (places[:, 1] - REST[1]).astype("f4")
            series["elements/bars/lengths"] = np.ones((n, len(BARS)), "f4")
    return path


def write_inputs(folder, **settings):
    """Write geometry.h5, config.json and signals.h5 of the older layout."""
    folder.mkdir(parents=True)
    with h5py.File(folder / "geometry.h5", "w") as file:
        file["nodes/positions"] = REST
        file["nodes/masses"] = np.full(4, 0.01, "f4")
        file["nodes/attributes"] = np.array([1, 3, 0, 0], "u1")
        file["elements/bars/indices"] = BARS
        file["elements/bars/stiffness"] = np.array([100, -1, 50], "f4")
        file["elements/bars/rest_length"] = np.array([1, 1.1, 1.1], "f4")
        file["elements/bars/damping"] = np.array([0.1, 0, 0.1], "f4")
        file["elements/hinges/indices"] = np.array([[0, 1, 2, 3]], "i4")
        file["elements/hinges/stiffness"] = np.array([0.5], "f4")
        file["elements/hinges/phi0"] = np.array([3.5], "f4")
    config = {
        "simulation": {"duration": 2.0, "dt_base": 0.01, "dt_save": 0.05},
        "global_physics": {"gravity": 0.0},
        "actuators": [{"node_idx": 1, "signal_name": "push", "type": "position", "dof": [1, 1, 1]}],
        **settings,
    }
    (folder / "config.json").write_text(json.dumps(config))
    t = np.arange(401) * 0.005
    signal = np.repeat(REST[1][None].astype("f8"), len(t), axis=0)
    signal[:, 0] += 0.1 * np.sin(2 * t)
    with h5py.File(folder / "signals.h5", "w") as file:
        file.attrs["dt_base"] = 0.005
        file["push"] = signal
        file["pull"] = np.linspace(0, 1, 401)
    return folder


def convert(path, out, **options):
    with TrajectoryWriter(out, provenance=Provenance("legacy"), on_failure="discard") as writer:
        LegacyImporter().import_run(path, writer, options=options)
    return Trajectory(out)


def notes(run):
    return "\n".join(run.provenance["notes"])
