"""Recorders with one mistake each."""

from __future__ import annotations

import warnings

import faulty_plugin
import wire_plugin
from ticker_code import Session, TickerRecorder, push, scripts

from openprc.errors import SchemaError


def of(session):
    """Return a recorder with that session."""

    class Recorder(TickerRecorder):
        def session(self, simulator, writer):
            return session(simulator, writer)

    return Recorder


class _Warning(Session):
    def begin(self):
        warnings.warn("recording has begun", stacklevel=2)
        super().begin()


class _Beginless(Session):
    def begin(self):
        pass


class _Keeping(Session):
    def begin(self):
        self.kept = []
        super().begin()

    def append(self, time):
        self.kept.append((time, self.places(), self.push(), self.force()))

    def flush(self):
        for time, x, u, f in self.kept:
            self.writer.append(time, positions=x, inputs={"u": u}, channels={"force": f})
        self.kept = []


class _Unfinished(_Keeping):
    def finish(self):
        self.flush()


class _Hoarding(_Keeping):
    def __exit__(self, kind, error, trace):
        if error is None:
            self.flush()


class _Covering(Session):
    def __exit__(self, kind, error, trace):
        if error is not None:
            raise SchemaError("the loop failed", expected="none", fix="none")


class _Mirrored(Session):
    def places(self):
        return super().places()[:, [1, 0, 2]]


class _Milliseconds(Session):
    def instant(self):
        return 1e3 * super().instant()


class _Unpushed(Session):
    def push(self):
        return 0.0 * push(self.simulator.time)


class _Doubled(Session):
    def force(self):
        return 2.0 * super().force()


def scripts_of(name, spec):
    """Return script, forget and crash; another process finds forget in this module."""
    script, forget, crash = scripts(spec)
    forget.__qualname__, forget.__module__ = f"forget_{name}", __name__
    return script, forget, crash


for _name in faulty_plugin.RECORDERS:
    globals()[_name] = of(globals()[f"_{_name}"])


def __getattr__(name):
    if not name.startswith("forget_"):
        raise AttributeError(name)
    name = name.removeprefix("forget_")
    good = name == "TickerRecorder"
    return scripts(wire_plugin.recorder() if good else faulty_plugin.recorder_record(name))[1]
