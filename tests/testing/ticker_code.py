"""A recorder of a loop that counts, and scripts that use it."""

from __future__ import annotations

import numpy as np

from openprc.hooks import Registry, record_run
from openprc.testing.lookup import find_record

N_STEPS, DT = 20, 0.05


class Ticker:
    """A simulator: two points on circles, pushed by u."""

    def __init__(self):
        self.n = 0

    @property
    def time(self):
        return self.n * DT

    def step(self):
        self.n += 1


def places(t):
    t = np.asarray(t)
    first = np.stack([np.cos(t), np.sin(t), 0.1 * t], axis=-1)
    second = np.stack([2.0 + np.sin(2.0 * t), -np.cos(3.0 * t), 0.0 * t + 0.5], axis=-1)
    return np.stack([first, second], axis=-2)


def push(t):
    return np.sin(5.0 * np.asarray(t))[..., np.newaxis]


def truth():
    t = DT * np.arange(N_STEPS + 1)
    return {"positions": places(t), "time": t, "inputs": {"u": push(t)},
            "channels": {"force": push(t) ** 2}}  # fmt: skip


class TickerRecorder:
    def attach(self, simulator, writer, **options):
        return self.session(simulator, writer)

    def session(self, simulator, writer):
        return Session(simulator, writer)


class Session:
    def __init__(self, simulator, writer):
        self.simulator, self.writer = simulator, writer

    def __enter__(self):
        self.writer.declare_nodes(2, 3, unit="m")
        self.writer.declare_input("u", ["u"], quantity="force", unit="N")
        self.writer.declare_channel("force", ["f"], unit="N")
        self.begin()
        return self

    def begin(self):
        self.record()

    def step(self):
        self.simulator.step()
        self.record()

    def record(self):
        self.append(self.instant())

    def instant(self):
        return self.simulator.time

    def places(self):
        return places(self.simulator.time)

    def push(self):
        return push(self.simulator.time)

    def force(self):
        return push(self.simulator.time) ** 2

    def append(self, time):
        self.writer.append(
            time, positions=self.places(), inputs={"u": self.push()},
            channels={"force": self.force()},
        )  # fmt: skip

    def finish(self):
        """What a script may call at the end, and may forget."""

    def __exit__(self, kind, error, trace):
        return None


def scripts(spec):
    """Return script, forget and crash for a record."""

    def recording(out):
        item, registry = find_record(
            spec, "openprc_producers", Registry([], wanted=""), "faulty_plugin"
        )
        return record_run(Ticker(), out, producer=item.qualified_name, registry=registry)

    def script(out):
        with recording(out) as session:
            for _ in range(N_STEPS):
                session.step()
            session.finish()

    def forget(out):
        kept = recording(out)
        for _ in range(N_STEPS):
            kept.session.step()
        return kept

    def crash(out):
        with recording(out) as session:
            for _ in range(5):
                session.step()
            raise ZeroDivisionError("the script's own mistake")

    return script, forget, crash
