"""Points survive what interrupts a study."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from openprc.errors import ConfigError, UnreadableFile
from openprc.tradeoff.point import Point
from openprc.tradeoff.store import PointStore


def point(number, *, error=1e-3):
    return Point(
        group="integrator", label="rk4", setting={"steps_per_frame": number}, trajectory_error=error
    )


def test_points_are_read_back_as_they_were(tmp_path):
    path = tmp_path / "points.jsonl"
    store = PointStore(path, scene="a")
    store.put(point(1), seconds=[0.5, 0.25])
    store.put(Point(group="backend", label="cuda", setting={}, status="refused", note="no device"))
    again = PointStore(path, scene="a")
    assert again.points == store.points
    assert again.get("integrator", {"steps_per_frame": 1}).seconds == (0.5, 0.25)
    assert again.get("precision", {"steps_per_frame": 1}) is None


def test_a_setting_has_one_point_the_last_one(tmp_path):
    path = tmp_path / "points.jsonl"
    store = PointStore(path, scene="a")
    for seconds in ([1.0], [1.0, 2.0]):
        store.put(point(1), seconds=seconds)
    assert len(PointStore(path, scene="a")) == 1
    # Opening it has left one line for it.
    assert len(path.read_text().splitlines()) == 2
    assert PointStore(path, scene="a").get("integrator", {"steps_per_frame": 1}).seconds == (
        1.0,
        2.0,
    )


def test_a_line_that_was_cut_off_is_dropped_and_others_follow(tmp_path):
    path = tmp_path / "points.jsonl"
    store = PointStore(path, scene="a")
    store.put(point(1))
    store.put(point(2))
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    resumed = PointStore(path, scene="a")
    assert [p.setting["steps_per_frame"] for p in resumed.points] == [1]
    resumed.put(point(3))
    found = [p.setting["steps_per_frame"] for p in PointStore(path, scene="a").points]
    assert found == [1, 3]


def test_a_crash_in_the_first_line_leaves_nothing_to_mind(tmp_path):
    path = tmp_path / "points.jsonl"
    path.write_bytes(b'{"openprc_tradeoff": "1", "openp')
    store = PointStore(path, scene="a")
    store.put(point(1))
    assert len(PointStore(path, scene="a")) == 1


def test_points_of_another_scene_are_refused(tmp_path):
    path = tmp_path / "points.jsonl"
    PointStore(path, scene="a").put(point(1))
    before = path.read_bytes()
    with pytest.raises(ConfigError, match=r"another scene.*\n.*digest b.*\n.*another folder"):
        PointStore(path, scene="b")
    assert path.read_bytes() == before


def test_points_of_another_version_are_refused(tmp_path):
    path = tmp_path / "points.jsonl"
    PointStore(path, scene="a").put(point(1))
    head, *rest = path.read_text().splitlines()
    head = json.dumps(json.loads(head) | {"openprc": "0.9"})
    path.write_text("\n".join([head, *rest]) + "\n")
    with pytest.raises(ConfigError, match=r"another version: openprc '0\.9'"):
        PointStore(path, scene="a")


@pytest.mark.parametrize(
    "content", ["time,error\n1,2\n", '{"a": 1}\n', "[1]\n", "no line end", "\x00\x01\n"]
)
def test_a_file_of_another_kind_is_refused_and_left_alone(tmp_path, content):
    path = tmp_path / "points.jsonl"
    path.write_text(content)
    with pytest.raises(UnreadableFile, match="line 1 is no point of a trade-off study"):
        PointStore(path, scene="a")
    assert path.read_text() == content


def test_damage_in_the_middle_is_named_by_its_line(tmp_path):
    path = tmp_path / "points.jsonl"
    store = PointStore(path, scene="a")
    store.put(point(1))
    store.put(point(2))
    lines = path.read_text().splitlines()
    lines[1] = lines[1][:-30]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(UnreadableFile, match="line 2 is no point"):
        PointStore(path, scene="a")


def test_what_is_no_number_is_never_written(tmp_path):
    path = tmp_path / "points.jsonl"
    bad = Point(group="g", label="l", setting={}, status="failed", trajectory_error=float("nan"))
    with pytest.raises(ValueError, match="not JSON compliant"):
        PointStore(path, scene="a").put(bad)
    assert not path.exists()


KILLED = """
import sys
from openprc.tradeoff.point import Point
from openprc.tradeoff.store import PointStore
store = PointStore(sys.argv[1], scene="a")
for number in range(len(store), 100_000):
    store.put(Point(group="g", label="l", setting={"n": number}, trajectory_error=0.1))
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_killed_while_writing_points_are_whole_and_go_on(tmp_path):
    path = tmp_path / "points.jsonl"
    last = 0
    for _ in range(2):
        writer = subprocess.Popen([sys.executable, "-c", KILLED, str(path)])
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and writer.poll() is None:
            if path.exists() and path.read_bytes().count(b"\n") > last + 20:
                break
            time.sleep(0.01)
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        found = [p.setting["n"] for p in PointStore(path, scene="a").points]
        assert found == list(range(len(found)))
        assert len(found) > last
        last = len(found)
