"""Recorders with one mistake each."""

from __future__ import annotations

import warnings

from ticker_code import Session, TickerRecorder, push, scripts
from wire_plugin import recorder

from openprc.errors import SchemaError

TABLE = [
    ("Warning", "recording warns", "RECORD-1"),
    ("Beginless", "the state before the loop is not recorded", "RECORD-2 VALUE-1 VALUE-2 VALUE-3 VALUE-4"),
    ("Unfinished", "frames are written by a call that a script may forget", "RECORD-3 RECORD-4"),
    ("Hoarding", "frames are written at a good end only", "RECORD-4"),
    ("Covering", "the error of the loop is covered by another", "RECORD-4"),
    ("Mirrored", "x and y are exchanged", "VALUE-1"),
    ("Milliseconds", "times are in ms and said to be in s", "VALUE-2"),
    ("Unpushed", "the input is zero", "VALUE-3"),
    ("Doubled", "the force is twice what it is", "VALUE-4"),
]  # fmt: skip


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


#: By name: the scripts that another process has to find.
_SCRIPTS = {}


def scripts_of(name, spec):
    """Return script, forget and crash; forget is a function of this module."""
    if name not in _SCRIPTS:
        script, forget, crash = scripts(spec)
        forget.__qualname__ = f"forget_{name}"
        _SCRIPTS[name] = script, forget, crash
    return _SCRIPTS[name]


def _forget(name):
    spec = recorder(load=f"faulty_recorders:{name}")
    return scripts(spec)[1]


for _name, *_ in TABLE:
    globals()[_name] = of(globals()[f"_{_name}"])


def __getattr__(name):
    if name == "forget_TickerRecorder":
        return scripts(recorder())[1]
    if name.startswith("forget_"):
        return _forget(name.removeprefix("forget_"))
    raise AttributeError(name)
