"""Write the golden files of a schema version: ``python tests/golden/make_golden.py v1.0``.

They are made once per version and then never again: whatever the package becomes, it has to read
them and give the recorded values. Run this for a new version only; it refuses to replace a file.
One tiny file a producer, each with what is typical of that producer.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from openprc.schema import SCHEMA_VERSION, Provenance, Trajectory, TrajectoryWriter

HERE = Path(__file__).resolve().parent


def _writer(path: Path, producer: str, **options: Any) -> TrajectoryWriter:
    provenance = Provenance(
        producer, producer_version="1.0", plugin=f"openprc-{producer}", plugin_version="1.0.0",
        seed=1, deterministic=True, config={"made": "by hand", "n": 3},
    )  # fmt: skip
    return TrajectoryWriter(path, provenance=provenance, title=f"golden {producer}", **options)


def demlat(path: Path) -> None:
    """Bars and a hinge, energies, a held force."""
    n = 8
    phase = np.arange(n)[:, None] * 0.25 + np.arange(4)
    positions = np.stack([np.arange(4) + 0 * phase, np.sin(phase), np.cos(phase)], axis=2)
    symbols = np.array([[0.5], [-0.25]])
    with _writer(path, "demlat") as writer:
        writer.declare_nodes(
            4, 3, unit="m", velocities=True, rest=positions[0], mass=[0.01] * 4,
            fixed=[True, True, False, False], labels=["n0", "n1", "n2", "n3"],
        )  # fmt: skip
        writer.declare_elements(
            "bars", [[0, 1], [1, 2], [2, 3]], series={"length": "m", "force": "N"},
            static={"rest_length": ([1.0, 1.0, 1.0], "m"), "stiffness": ([222.0] * 3, "N/m")},
        )  # fmt: skip
        writer.declare_elements("hinges", [[1, 2, 0, 3]], series={"angle": "rad"})
        for name in ("kinetic_energy", "potential_energy", "total_energy"):
            writer.declare_system(name)
        writer.declare_input(
            "push", ["fz"], quantity="force", unit="N", targets=["n3"], sequence=symbols, hold=0.04
        )
        length = np.linalg.norm(np.diff(positions, axis=1), axis=2)
        energy = np.arange(n) / 16.0
        writer.append(
            np.arange(n) * 0.01,
            positions=positions,
            velocities=np.gradient(positions, 0.01, axis=0),
            elements={("bars", "length"): length, ("bars", "force"): 222.0 * (length - 1.0),
                      ("hinges", "angle"): np.pi - phase[:, :1] / 8},
            system={"kinetic_energy": energy, "potential_energy": 1.0 - energy,
                    "total_energy": np.ones(n)},
            inputs={"push": np.repeat(symbols, 4, axis=0)},
        )  # fmt: skip


def vision(path: Path) -> None:
    """Pixels in the plane, single precision, points that were missed and points filled in."""
    rng = np.random.default_rng(1)
    n = 10
    positions = rng.uniform(0, 640, (n, 3, 2)).astype("f4")
    observed = np.ones((n, 3), "u1")
    observed[2:4, 1], observed[7, 0], observed[0, 2] = 0, 2, 0
    positions[observed == 0] = np.nan
    with _writer(path, "vision") as writer:
        writer.declare_nodes(
            3, 2, unit="px", frame="image", dtype="f4", observed=True, labels=["p0", "p1", "p2"]
        )
        writer.note("4 of 30 points are missing")
        writer.append(np.arange(n) / 30, positions=positions, observed=observed)


def merlin(path: Path) -> None:
    """Load steps of a quasi-static path, in millimetres."""
    n = 6
    steps = np.arange(1, n + 1, dtype=float)
    rest = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0.0]])
    positions = rest + steps[:, None, None] * np.array([0, 0, 0.5]) * (np.arange(4) == 3)[:, None]
    with _writer(path, "merlin") as writer:
        writer.declare_time(kind="pseudo", unit="1")
        writer.declare_nodes(4, 3, unit="mm", rest=rest, ids=[1, 2, 3, 4])
        writer.declare_elements("faces", [[0, 1, 2], [1, 3, 2]])
        writer.declare_elements("hinges", [[1, 2, 0, 3]], series={"angle": "rad"})
        writer.declare_channel("load_factor", ["lambda"], unit="1", quantity="load factor")
        writer.append(
            steps,
            positions=positions,
            elements={("hinges", "angle"): np.pi - 0.1 * steps[:, None]},
            channels={"load_factor": steps[:, None] ** 2 / 36},
        )


def pybullet(path: Path) -> None:
    """Links of a robot, joint channels, a commanded angle."""
    n = 12
    angle = 0.2 * np.sin(np.arange(n) / 3)
    positions = np.stack(
        [np.zeros((n, 3)), np.stack([np.cos(angle), np.sin(angle), 0.1 + 0 * angle], axis=1)],
        axis=1,
    )
    with _writer(path, "pybullet") as writer:
        writer.declare_nodes(2, 3, unit="m", labels=["base", "arm"], mass=[0.0, 1.5])
        writer.declare_channel("joint_position", ["shoulder"], unit="rad", quantity="angle")
        writer.declare_channel("joint_torque", ["shoulder"], unit="N*m", quantity="torque")
        writer.declare_input(
            "command", ["shoulder"], quantity="angle", unit="rad", targets=["shoulder"]
        )
        writer.append(
            np.arange(n) / 240,
            positions=positions,
            channels={"joint_position": angle[:, None], "joint_torque": -angle[:, None] / 2},
            inputs={"command": 0.25 * np.sin(np.arange(n) / 3)[:, None]},
        )


def pyelastica(path: Path) -> None:
    """A rod: nodes in a row, segments, times that are not even, data of an extension."""
    time = np.array([0.0, 0.01, 0.02, 0.035, 0.05])
    positions = np.zeros((5, 4, 3))
    positions[:, :, 0] = np.arange(4) / 3
    positions[:, :, 2] = time[:, None] * np.arange(4) ** 2
    with _writer(path, "pyelastica") as writer:
        writer.declare_nodes(4, 3, unit="m")
        writer.declare_elements(
            "rod", [[0, 1], [1, 2], [2, 3]], series={"tangent": "1"}, widths={"tangent": 3}
        )
        writer.declare_extension("openprc-pyelastica", "1.0")
        writer.put_extension(
            "openprc-pyelastica", "directors", np.broadcast_to(np.eye(3), (3, 3, 3)), comment="D E"
        )
        tangent = np.diff(positions, axis=1)
        tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
        writer.append(time, positions=positions, elements={("rod", "tangent"): tangent})


def csv(path: Path) -> None:
    """A table of a sensor: no nodes, milliseconds, a gap, an arbitrary unit."""
    values = np.array([[1.0, 0.5], [1.5, np.nan], [2.0, 0.25], [2.5, 0.125]])
    with _writer(path, "csv") as writer:
        writer.declare_time(unit="ms")
        writer.declare_channel("strain gauge", ["left", "Größe"], unit="arb")
        writer.declare_input("pump", ["p"], quantity="pressure", unit="kPa")
        writer.append(
            [0.0, 20.0, 40.0, 60.0],
            channels={"strain gauge": values},
            inputs={"pump": [[100.0], [101.0], [102.0], [101.0]]},
        )


def legacy(path: Path) -> None:
    """What the importer of the 0.1 packages makes: bars with codes and names, a driven node."""
    n = 9
    move = 0.05 * np.sin(np.arange(n))
    positions = np.tile(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), (n, 1, 1))
    positions[:, 2, 1] = move
    positions[:, 1, 1] = move / 2
    with _writer(path, "legacy", comment="converted") as writer:
        writer.declare_nodes(3, 3, unit="m", dtype="f4", ids=[0, 1, 2])
        writer.declare_elements(
            "bars", [[0, 1], [1, 2]],
            static={"kind": (["soft", "rigid"], None), "flags": ([1, 0], None)},
        )  # fmt: skip
        writer.declare_input(
            "shaker", ["y"], quantity="position", unit="m", targets=["2"],
            sequence=move[:, None], hold=0.5, start=-0.25,
        )  # fmt: skip
        writer.append(np.arange(n) * 0.5, positions=positions, inputs={"shaker": move[:, None]})


PRODUCERS: dict[str, Callable[[Path], None]] = {
    make.__name__: make for make in (demlat, vision, merlin, pybullet, pyelastica, csv, legacy)
}


def expectations(path: Path) -> dict[str, Any]:
    """Return the digest of a file and some of its values, to be recorded."""
    with Trajectory(path) as trajectory:
        found: dict[str, Any] = {
            "digest": trajectory.content_digest(),
            "producer": trajectory.provenance["producer"],
            "run_id": trajectory.run_id,
            "n_frames": trajectory.n_frames,
            "n_nodes": trajectory.n_nodes,
            "dims": trajectory.dims,
            "time": [trajectory.time_kind, trajectory.time_unit, *trajectory.time[[0, 1, -1]]],
            "dt": trajectory.dt if trajectory.uniform else None,
            "element_kinds": {
                kind: trajectory.indices(kind).tolist() for kind in trajectory.element_kinds
            },
            "channels": {
                name: {
                    "columns": trajectory.channel_columns(name),
                    "last": trajectory.channel(name)[-1].tolist(),
                }
                for name in trajectory.channels
            },
            "inputs": {
                name: {
                    "columns": trajectory.input(name).columns,
                    "unit": trajectory.input(name).unit,
                    "last": trajectory.input(name).value[-1].tolist(),
                    "hold": trajectory.input(name).hold,
                }
                for name in trajectory.inputs
            },
            "systems": trajectory.systems,
        }
        if trajectory.dims:
            last = trajectory.positions(slice(-1, None))[0]
            found["position_unit"] = trajectory.position_unit
            found["last_positions"] = [[repr(float(x)) for x in node] for node in last]
            found["n_missing"] = int(np.isnan(trajectory.positions()[..., 0]).sum())
    return json.loads(json.dumps(found))


def main() -> int:
    """Make the files of the present version."""
    name = f"v{SCHEMA_VERSION}"
    if sys.argv[1:] != [name]:
        sys.stderr.write(f"say {name}: these are the files of schema {SCHEMA_VERSION}\n")
        return 2
    folder = HERE / name
    recorded: dict[str, Any] = {}
    for producer, make in PRODUCERS.items():
        path = folder / f"{producer}.h5"
        make(path)  # the writer refuses to replace what is there
        recorded[producer] = expectations(path)
    text = json.dumps(recorded, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "expected.json").write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
