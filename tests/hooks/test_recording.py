"""Recording a loop that a script owns: what is left when it ends in each possible way."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from contextlib import contextmanager

import pytest

from openprc.errors import (
    ConfigError,
    IncompleteFile,
    PluginError,
    ResultExists,
    SchemaError,
    UnknownName,
)
from openprc.hooks import ProducerSpec, Registry, record_run
from openprc.schema import Trajectory


class Session:
    """Records a counter; what a script calls in its loop."""

    def __init__(self, world, writer):
        self.world, self.writer = world, writer

    def step(self):
        self.world["time"] += 0.5
        place = [[[float(self.world["time"]), 0.0]]]
        self.writer.append([self.world["time"]], positions=place)


class Recorder:
    ended: list = []  # noqa: RUF012 - the tests look at it and clear it

    @contextmanager
    def attach(self, simulator, writer, **options):
        if simulator is None:
            raise ZeroDivisionError("no simulator")
        writer.declare_nodes(1, 2, unit=options.get("unit", "m"))
        writer.append([simulator["time"]], positions=[[[0.0, 0.0]]])
        try:
            yield Session(simulator, writer)
        except BaseException as error:
            Recorder.ended.append(type(error))
            raise
        Recorder.ended.append(None)


@pytest.fixture
def registry(make_entry, make_code):
    Recorder.ended.clear()
    spec = ProducerSpec(
        "counter", "Counts", make_code("Recorder", Recorder), capabilities=("record",)
    )
    return Registry([make_entry("counter", openprc_producers=[spec])])


@pytest.fixture
def start(registry, tmp_path):
    def start(world=None, **options):
        world = {"time": 0.0} if world is None else world
        return record_run(
            world, tmp_path / "run.h5", producer="counter", registry=registry, **options
        )

    return start


def test_a_block_gives_a_complete_file(start, tmp_path):
    with start(unit="mm") as session:
        for _ in range(3):
            session.step()
        assert not (tmp_path / "run.h5").exists()
    with Trajectory(tmp_path / "run.h5") as run:
        assert run.time.tolist() == [0.0, 0.5, 1.0, 1.5]
        assert run.position_unit == "mm"
        assert run.provenance["producer"] == "counter"
    assert Recorder.ended == [None]


def test_without_a_block_close_ends_it(start, tmp_path):
    recording = start()
    recording.session.step()
    run = recording.close()
    assert (run.n_frames, run.n_nodes, run.producer) == (2, 1, "counter")
    assert run.path == recording.path == tmp_path / "run.h5"
    assert recording.close() is None
    assert Recorder.ended == [None]


def test_an_error_in_the_loop_keeps_the_frames_and_is_raised(start, tmp_path):
    def script():
        with start() as session:
            session.step()
            raise RuntimeError("the script is wrong")

    with pytest.raises(RuntimeError, match="the script is wrong"):
        script()
    assert Recorder.ended == [RuntimeError]
    assert not (tmp_path / "run.h5").exists()
    partial = tmp_path / "run.h5.partial"
    with pytest.raises(IncompleteFile, match="'failed': 2 frames"):
        Trajectory(partial)
    with Trajectory(partial, allow_incomplete=True) as run:
        assert (run.status, run.time.tolist()) == ("failed", [0.0, 0.5])


def test_stopping_it_is_told_apart(start, tmp_path):
    def script():
        with start() as session:
            session.step()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        script()
    with Trajectory(tmp_path / "run.h5.partial", allow_incomplete=True) as run:
        assert (run.status, run.n_frames) == ("interrupted", 2)


def test_a_recorder_that_cannot_attach_leaves_nothing(registry, tmp_path):
    with pytest.raises(PluginError, match="attaching to the simulator: ZeroDivisionError"):
        record_run(None, tmp_path / "run.h5", producer="counter", registry=registry)
    assert list(tmp_path.iterdir()) == []


def test_a_recorder_that_records_nothing(make_entry, make_code, tmp_path):
    class Idle:
        @contextmanager
        def attach(self, simulator, writer, **options):
            yield writer

    spec = ProducerSpec("idle", "Idle", make_code("Idle", Idle), capabilities=("record",))
    registry = Registry([make_entry("idle", openprc_producers=[spec])])
    recording = record_run(1, tmp_path / "run.h5", producer="idle", registry=registry)
    with pytest.raises(SchemaError, match="no frame was appended"):
        recording.close()
    assert list(tmp_path.iterdir()) == []


def test_results_are_not_replaced_unless_told(start, tmp_path):
    start().close()
    before = (tmp_path / "run.h5").read_bytes()
    with pytest.raises(ResultExists, match="a finished file of this name"):
        start()
    assert (tmp_path / "run.h5").read_bytes() == before
    start(overwrite=True).close()
    assert (tmp_path / "run.h5").read_bytes() != before


def test_a_misspelt_option_is_the_scripts_fault(make_entry, make_code, tmp_path):
    class Strict:
        @contextmanager
        def attach(self, simulator, writer, *, every=1, nodes="com"):
            raise AssertionError("it is not called")

    spec = ProducerSpec("strict", "S", make_code("Strict", Strict), capabilities=("record",))
    registry = Registry([make_entry("strict", openprc_producers=[spec])])
    with pytest.raises(ConfigError, match=r"no option 'evrey'(?s:.)*some of every, nodes"):
        record_run(1, tmp_path / "run.h5", producer="strict", registry=registry, evrey=2)
    assert list(tmp_path.iterdir()) == []


def test_who_cannot_record_is_said(tmp_path):
    with pytest.raises(UnknownName, match="demlat cannot record"):
        record_run(1, tmp_path / "run.h5", producer="demlat", registry=Registry([]))


SCRIPT = """
    import sys
    sys.path.insert(0, sys.argv[1])
    from openprc.hooks import ProducerSpec, Registry, record_run
    import recorder_of_a_script as module

    class Entry:
        name, value = "counter", "recorder_of_a_script"
        class dist:
            name, version = "openprc-counter", "1"
        def load(self):
            return module

    recording = record_run(
        {"time": 0.0}, sys.argv[2], producer="counter", registry=Registry([Entry()])
    )
    recording.session.step()
"""
MODULE = """
    from contextlib import contextmanager
    from openprc.hooks import ProducerSpec, hookimpl

    OPENPRC_PLUGIN_API = "1.0"

    @hookimpl
    def openprc_producers():
        return [ProducerSpec("counter", "Counts", "recorder_of_a_script:Recorder",
                             capabilities=("record",))]

    class Session:
        def __init__(self, world, writer):
            self.world, self.writer = world, writer

        def step(self):
            self.world["time"] += 0.5
            self.writer.append([self.world["time"]], positions=[[[1.0, 0.0]]])

    class Recorder:
        @contextmanager
        def attach(self, simulator, writer, **options):
            writer.declare_nodes(1, 2, unit="m")
            writer.append([0.0], positions=[[[0.0, 0.0]]])
            yield Session(simulator, writer)
"""


@pytest.mark.parametrize(
    ("ending", "status", "returned"),
    [
        ("", "complete", 0),
        ("sys.exit(3)", "complete", 3),
        ("1 / 0", "failed", 1),
    ],
)
def test_a_script_that_forgets_to_close(tmp_path, ending, status, returned):
    (tmp_path / "recorder_of_a_script.py").write_text(textwrap.dedent(MODULE))
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT) + ending + "\n")
    out = tmp_path / "run.h5"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(out)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENPRC_PLUGINS": "counter"},
    )
    assert done.returncode == returned, done.stderr
    found = out if status == "complete" else out.with_name("run.h5.partial")
    with Trajectory(found, allow_incomplete=True) as run:
        assert (run.status, run.time.tolist()) == (status, [0.0, 0.5])
    if status == "complete":
        assert done.stderr == ""
        assert not out.with_name("run.h5.partial").exists()
    else:
        assert done.stderr.count("ZeroDivisionError") == 1
        assert not out.exists()
