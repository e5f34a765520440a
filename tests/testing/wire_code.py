"""The code behind the good plugin: a text table with a header in JSON, and a file of symbols.

Every step is a method of its own, so that a fault replaces one and leaves the others right.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from openprc.errors import UnreadableFile
from openprc.hooks import Sample

SIGNATURE = "# wire 1"
N_FRAMES, DT, HOLD, N_SYMBOLS = 601, 0.02, 0.1, 120


# --- the sample, in closed form ----------------------------------------------------------------


def times():
    return DT * np.arange(N_FRAMES)


def symbols():
    return np.random.default_rng(8).uniform(-1.0, 1.0, (N_SYMBOLS, 1))


def drive():
    index = np.minimum(np.arange(N_FRAMES) // round(HOLD / DT), N_SYMBOLS - 1)
    return symbols()[index]


def angles():
    """Return two leaky integrals of the drive, (T, 2) [rad]: a body that remembers."""
    rates, u = np.array([10.0, 30.0]), drive()
    out = np.zeros((N_FRAMES, 2))
    for i in range(1, N_FRAMES):
        out[i] = u[i - 1] + (out[i - 1] - u[i - 1]) * np.exp(-rates * DT)
    return out


def seen():
    mask = np.ones((N_FRAMES, 3), np.uint8)
    mask[40:43, 1] = 0
    return mask


def positions():
    """Return three nodes, (T, 3, 3) [m]; one of them is not seen in three frames."""
    a, b = angles().T
    still = np.ones_like(a)
    x = np.stack(
        [
            np.stack([0.1 * still, 0.0 * a, -0.3 * still], axis=1),
            np.stack([1.0 + 0.2 * a, 0.3 * b, 0.05 * a * b], axis=1),
            np.stack([2.0 - 0.1 * b, 0.2 * a, 0.1 + 0.1 * b], axis=1),
        ],
        axis=1,
    )
    x[seen() == 0] = np.nan
    return x


def truth():
    return {
        "positions": positions(),
        "unit": "m",
        "observed": seen(),
        "time": times(),
        "inputs": {"u": drive()},
        "sequences": {"u": symbols()},
        "channels": {"angle": angles()},
        "tolerance": 1e-12,
    }


def write_table(path, *, time, places, channels, inputs):
    """Write a table; `channels` is {name: (columns, unit, values)}, `inputs` {name: values}."""
    head = {
        "shape": list(places.shape[1:]) if places is not None else [0, 0],
        "channels": {name: [list(columns), unit] for name, (columns, unit, _) in channels.items()},
        "inputs": {name: values.shape[1] for name, values in inputs.items()},
        "rows": len(time),
    }
    blocks = [time[:, np.newaxis]]
    if places is not None:
        blocks.append(places.reshape(len(time), -1))
    blocks += [values for _, _, values in channels.values()]
    blocks += list(inputs.values())
    rows = np.concatenate(blocks, axis=1).tolist()
    lines = [SIGNATURE, json.dumps(head), *(" ".join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_sample(folder):
    path = write_table(
        Path(folder) / "run.wire",
        time=times(),
        places=positions(),
        channels={"angle": (("a", "b"), "rad", angles())},
        inputs={"u": drive()},
    )
    (Path(folder) / "run.symbols").write_text(
        json.dumps({"hold": HOLD, "u": symbols().tolist()}), encoding="utf-8"
    )
    return Sample(path)


# --- importer ----------------------------------------------------------------------------------


class WireImporter:
    def sniff(self, path):
        try:
            with Path(path).open("rb") as stream:
                head = stream.read(len(SIGNATURE) + 1)
        except OSError:
            return 0.0
        return 1.0 if head == f"{SIGNATURE}\n".encode() else 0.0

    def import_run(self, path, writer, *, options):
        head, rows = self.read(Path(path))
        rows = rows[:: options["every"]]
        n, dims = head["shape"]
        width = n * dims
        place = 1 + width
        content = {"channels": {}, "inputs": {}}
        if n:
            x = self.places(rows[:, 1:place].reshape(len(rows), n, dims))
            seen = self.seen(x)
            writer.declare_nodes(n, dims, unit=self.unit(), observed=bool((seen != 1).any()))
            content["positions"] = x
            if (seen != 1).any():
                content["observed"] = seen
        for name, (columns, unit) in head["channels"].items():
            writer.declare_channel(name, columns, unit=unit)
            values = rows[:, place : place + len(columns)]
            content["channels"][name] = self.readings(values)
            place += len(columns)
        held = self.symbols(Path(path), writer)
        for name, count in head["inputs"].items():
            columns = [name] if count == 1 else [f"{name}{c}" for c in range(count)]
            given = {}
            if name in held:
                given = {"sequence": held[name], "hold": held["hold"], "start": 0.0}
            writer.declare_input(name, columns, quantity="force", unit="N", **given)
            content["inputs"][name] = self.input(rows[:, place : place + count])
            place += count
        writer.append(self.time(rows[:, 0]), **content)

    def read(self, path):
        """Return the header and the numbers, (T, columns)."""
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise self.damaged(path, f"it cannot be read: {error}") from error
        if len(lines) < 3 or lines[0] != SIGNATURE:
            raise self.damaged(path, "the signature or the rows are missing")
        try:
            head = json.loads(lines[1])
            (n, dims), count = head["shape"], head["rows"]
            width = 1 + n * dims
            width += sum(len(columns) for columns, _ in head["channels"].values())
            width += sum(head["inputs"].values())
            rows = np.array([[float(cell) for cell in line.split(" ")] for line in lines[2:]])
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise self.damaged(path, f"a line makes no sense: {error}") from error
        if rows.shape != (count, width):
            raise self.damaged(path, f"{rows.shape} numbers, {(count, width)} announced")
        return head, rows

    def damaged(self, path, found):
        return UnreadableFile(found, expected="a whole table", fix="copy the file again", file=path)

    def symbols(self, path, writer):
        beside = path.with_suffix(".symbols")
        if not beside.is_file():
            return {}
        self.add_source(writer, beside)
        try:
            held = json.loads(beside.read_text(encoding="utf-8"))
            math.isfinite(held["hold"])
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise self.damaged(beside, f"it makes no sense: {error}") from error
        return held

    def add_source(self, writer, path):
        writer.add_source(path, role="symbols")

    def places(self, x):
        return x

    def seen(self, x):
        return np.isfinite(x).all(axis=2).astype("u1")

    def unit(self):
        return "m"

    def readings(self, values):
        return values

    def input(self, values):
        return values

    def time(self, values):
        return values


# --- exporter ----------------------------------------------------------------------------------


class WireExporter:
    def export(self, trajectory, path, *, options):
        del options
        write_table(
            path,
            time=self.time(trajectory),
            places=self.places(trajectory) if trajectory.n_nodes else None,
            channels={
                name: (
                    trajectory.channel_columns(name),
                    trajectory.unit(f"/time_series/channels/{name}"),
                    trajectory.channel(name),
                )
                for name in trajectory.channels
            },
            inputs={name: trajectory.input(name).value for name in trajectory.inputs},
        )
        return [path]

    def time(self, trajectory):
        return trajectory.time

    def places(self, trajectory):
        return trajectory.positions(unit="m")
