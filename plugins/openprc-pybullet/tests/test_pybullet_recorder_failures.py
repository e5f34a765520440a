"""Scripts that fail, forget, or change the scene under the recorder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest

from openprc.errors import ConfigError, Diverged, UnsupportedScene
from openprc.hooks import record_run
from openprc.schema import Trajectory


@pytest.fixture
def scene(world, tmp_path):
    """Two free balls, and a recording of them that has not begun."""
    p, start = world
    client = start()
    balls = [p.createMultiBody(1.0, basePosition=(k, 0, 0), physicsClientId=client) for k in (0, 1)]

    def begin(**options):
        return record_run(client, tmp_path / "run.h5", producer="pybullet", **options)

    return p, client, balls, begin


def drive(recording, act, *, n_steps=1):
    """Call `act` before each of some steps, as a script would."""
    with recording as session:
        for step in range(n_steps):
            act(step)
            session.step()


@pytest.fixture
def rest(tmp_path):
    """What an unfinished recording left."""

    def look():
        path = tmp_path / "run.h5.partial"
        assert not (tmp_path / "run.h5").exists()
        with Trajectory(path, allow_incomplete=True) as run:
            return run.status, run.n_frames, list(run.provenance["notes"])

    return look


def test_an_error_in_the_loop_keeps_the_frames(scene, rest):
    _, _, _, begin = scene
    with pytest.raises(ZeroDivisionError):
        drive(begin(), lambda step: 1 / (50 - step), n_steps=100)
    assert rest()[:2] == ("failed", 51)


def test_an_interrupt_keeps_the_frames(scene, rest):
    _, _, _, begin = scene

    def interrupt(step):
        if step == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        drive(begin(), interrupt, n_steps=20)
    assert rest()[:2] == ("interrupted", 11)


def test_a_removed_body_is_named(scene, rest):
    p, client, balls, begin = scene

    def remove(step):
        if step == 2:
            p.removeBody(balls[0], physicsClientId=client)

    with pytest.raises(
        UnsupportedScene, match=rf"bodies {balls[0]} are gone at 0\.0125 s"
    ) as raised:
        drive(begin(), remove, n_steps=5)
    assert "before removeBody" in raised.value.fix
    assert rest()[:2] == ("failed", 3)


def test_a_body_that_took_the_id_of_another_is_noticed(scene):
    p, client, balls, begin = scene
    with begin() as session:
        session.step()
        p.removeBody(balls[1], physicsClientId=client)
        assert p.createMultiBody(1.0, physicsClientId=client) == balls[1]
        with pytest.raises(UnsupportedScene, match=f"bodies {balls[1]} are gone"):
            session.step()


def test_a_reset_is_noticed_even_when_everything_is_loaded_again(scene):
    p, client, _, begin = scene
    with begin() as session:
        session.step()
        p.resetSimulation(physicsClientId=client)
        for _ in range(2):
            p.createMultiBody(1.0, physicsClientId=client)
        with pytest.raises(UnsupportedScene, match="bodies 0, 1 are gone"):
            session.step()


def test_recording_again_after_a_reset(scene, tmp_path, recorded):
    p, client, _, _ = scene
    for episode in range(3):
        p.resetSimulation(physicsClientId=client)
        p.createMultiBody(1.0 + episode, physicsClientId=client)
        path = tmp_path / f"{episode}.h5"
        with record_run(client, path, producer="pybullet") as session:
            session.step()
        assert recorded(path).node("mass").tolist() == [1.0 + episode]


def test_a_server_that_was_disconnected(scene, rest):
    p, client, _, begin = scene

    def leave(step):
        if step == 1:
            p.disconnect(physicsClientId=client)

    with pytest.raises(UnsupportedScene, match=rf"client {client} was disconnected at 0\.0041"):
        drive(begin(), leave, n_steps=2)
    assert rest()[:2] == ("failed", 2)


def test_closing_after_the_server_is_gone(scene, recorded):
    p, client, _, begin = scene
    recording = begin()
    for _ in range(3):
        recording.session.step()
    p.disconnect(physicsClientId=client)
    assert recording.close().n_frames == 4
    assert recorded().status == "complete"


def test_bodies_that_come_later_are_noted(scene, recorded):
    p, client, _, begin = scene
    with begin() as session:
        session.step()
        new = p.createMultiBody(1.0, physicsClientId=client)
        session.step()
    run = recorded()
    assert run.n_nodes == 2
    assert any(f"bodies {new} appeared before" in note for note in run.provenance["notes"])


def test_marks_are_taken_away(scene):
    p, client, balls, begin = scene
    with begin() as session:
        assert p.getNumUserData(balls[0], client) == 1
        session.step()
    assert p.getNumUserData(balls[0], client) == 0


@pytest.mark.parametrize(("speed", "words"), [
    (np.nan, "the position of body0.link0 is nan at 0.02083"),
    (1e5, "body0.link0 is .* m away"),
    (np.inf, "at 0.02083"),
])  # fmt: skip
def test_a_simulation_that_blows_up(scene, rest, speed, words):
    p, client, balls, begin = scene
    p.changeDynamics(balls[0], -1, maxJointVelocity=1e9, physicsClientId=client)

    def push(step):
        if step == 4:
            p.resetBaseVelocity(balls[0], (speed, 0, 0), physicsClientId=client)

    with pytest.raises(Diverged, match=words) as raised:
        drive(begin(limit=10), push, n_steps=20)
    assert "(step 5)" in raised.value.found
    assert raised.value.key == "positions"
    status, frames, _ = rest()
    assert (status, frames) == ("failed", 5)


def test_a_scene_that_has_blown_up_already(scene, tmp_path):
    p, client, balls, begin = scene
    p.resetBaseVelocity(balls[0], (np.nan, 0, 0), physicsClientId=client)
    p.stepSimulation(physicsClientId=client)
    with pytest.raises(Diverged, match=r"position of body0\.link0 is nan at 0 s"):
        begin()
    assert not list(tmp_path.iterdir())
    assert p.getNumUserData(balls[0], client) == 0


def test_a_node_that_goes_too_far(scene, rest):
    p, client, balls, begin = scene
    p.changeDynamics(balls[1], -1, linearDamping=0, physicsClientId=client)
    p.setGravity(0, 0, 0, physicsClientId=client)
    p.resetBaseVelocity(balls[1], (24, 0, 0), physicsClientId=client)
    # The balls are 1 m apart.
    with pytest.raises(Diverged, match=r"body1.link0 is 8\.1 m away") as raised:
        drive(begin(limit=8), lambda step: None, n_steps=3000)
    assert raised.value.expected.startswith("less than 8, from limit and the size of the scene")
    assert rest()[1] == 81


def test_far_is_fine_without_a_limit(scene, recorded):
    p, client, balls, begin = scene
    p.setGravity(0, 0, 0, physicsClientId=client)
    with begin(limit=None) as session:
        for _ in range(10):
            session.step()
        p.resetBasePositionAndOrientation(
            balls[1], (1e8, 0, 0), (0, 0, 0, 1), physicsClientId=client
        )
        session.step()
    assert recorded().positions()[-1, 1, 0] == pytest.approx(1e8)


def test_divergence_does_not_hide_what_stopped_the_script(scene, rest):
    p, client, balls, begin = scene

    def fail(step):
        if step == 1:
            p.resetBaseVelocity(balls[0], (np.nan, 0, 0), physicsClientId=client)
        if step == 2:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        drive(begin(), fail, n_steps=5)
    status, frames, notes = rest()
    assert (status, frames) == ("failed", 2)
    assert any("the simulation blew up" in note for note in notes)


def test_a_time_step_that_changes(scene, recorded):
    p, client, _, begin = scene
    with begin(variable_dt=True) as session:
        for dt in (0.01, 0.01, 0.02, 0.04):
            p.setTimeStep(dt, physicsClientId=client)
            session.step()
    assert recorded().time == pytest.approx([0, 0.01, 0.02, 0.04, 0.08])


def test_a_time_step_that_changes_unsaid(scene, rest):
    p, client, _, begin = scene

    def slow_down(step):
        if step == 1:
            p.setTimeStep(0.01, physicsClientId=client)

    with pytest.raises(ConfigError, match=r"changed from 0\.00416666667 to 0\.01 s"):
        drive(begin(), slow_down, n_steps=2)
    assert rest()[0] == "failed"


def test_gravity_that_changes_is_noted(scene, recorded):
    p, client, _, begin = scene
    with begin() as session:
        session.step()
        p.setGravity(0, 0, 1, physicsClientId=client)
        session.step()
    assert any("gravity is (0.0, 0.0, 1.0)" in note for note in recorded().provenance["notes"])


def test_sub_steps_are_noted(scene, recorded):
    p, client, _, begin = scene
    p.setPhysicsEngineParameter(numSubSteps=4, physicsClientId=client)
    with begin() as session:
        session.step()
    run = recorded()
    assert any("4 sub-steps" in note for note in run.provenance["notes"])
    assert run.extension("openprc-pybullet", "sub_steps") == 4
    assert run.time[1] == 1 / 240


def test_real_time_is_refused(scene):
    p, client, _, begin = scene
    p.setRealTimeSimulation(1, physicsClientId=client)
    with pytest.raises(UnsupportedScene, match="runs in real time"):
        begin()


def test_flushing_makes_the_frames_safe(scene, tmp_path):
    _, _, _, begin = scene
    with begin() as session:
        for step in range(5):
            session.step(u=step)
        session.flush()
        # What a process that is killed now would leave.
        left = shutil.copy(tmp_path / "run.h5.partial", tmp_path / "left.h5")
        with h5py.File(left, "r") as file:
            # The last one waits for the command that follows it.
            assert file["committed"][()] == 5
        session.step(u=5)
        assert session.n_frames == 7


def test_a_session_ends(scene):
    _, _, _, begin = scene
    with begin() as session:
        session.step()
    for call in (session.step, session.record, session.flush):
        with pytest.raises(ConfigError, match="the recording is over"):
            call()


@pytest.mark.parametrize(("simulator", "words"), [
    ("client", "the simulator is a str"), (True, "the simulator is a bool"),
    (-1, "client -1 is not connected"), (777, "client 777 is not connected"),
])  # fmt: skip
def test_simulators_that_are_none(tmp_path, simulator, words):
    pytest.importorskip("pybullet", reason="recording needs PyBullet")
    with pytest.raises(ConfigError, match=words):
        record_run(simulator, tmp_path / "run.h5", producer="pybullet")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("options", "words"), [
    ({"nodes": "centre"}, "nodes is 'centre'"), ({"every": 0}, "every is 0"),
    ({"every": True}, "every is True"), ({"limit": 0}, "limit is 0"),
    ({"t0": np.inf}, "t0 is inf"), ({"contacts": "feet"}, "contacts is 'feet'"),
    ({"bodies": [0, 7]}, "there is no body 7"), ({"soft": {9: None}}, "there is no body 9"),
    ({"soft": {0: None}}, "body 0 \\(link0\\) is not soft"),
    ({"soft": {0: 3}}, "soft body 0 is given as 3"),
    ({"soft": {"cloth": None}}, "soft body 'cloth' is given as None"),
    ({"soft": 3}, "'soft' is given as 3"), ({"bodies": 0}, "bodies is 0"),
    ({"bodies": ["arm"]}, "there is no body 'arm'"), ({"signals": [1.0]}, "signals is a list"),
    ({"soft": {0: {"mass": -1.0}}}, "soft body 0 is given as"),
    ({"body": [0]}, "there is no option 'body'(?s:.)*some of bodies, nodes, soft"),
])  # fmt: skip
def test_options_that_are_wrong(scene, tmp_path, options, words):
    _, _, _, begin = scene
    with pytest.raises(ConfigError, match=words) as raised:
        begin(**options)
    assert raised.value.expected
    assert raised.value.fix
    assert not list(tmp_path.iterdir())


def test_scenes_in_which_nothing_moves(world, tmp_path):
    p, start = world
    client = start()
    with pytest.raises(UnsupportedScene, match="the scene is empty"):
        record_run(client, tmp_path / "run.h5", producer="pybullet")
    p.createMultiBody(0.0, physicsClientId=client)
    with pytest.raises(UnsupportedScene, match="nothing in this scene moves"):
        record_run(client, tmp_path / "run.h5", producer="pybullet")


SCRIPT = """
import pybullet
from openprc.hooks import record_run
client = pybullet.connect(pybullet.DIRECT)
pybullet.createMultiBody(1.0)
session = record_run(client, "run.h5", producer="pybullet").session
for step in range(10):
    session.step(u=step)
{end}
"""


@pytest.mark.parametrize(("end", "name", "status"), [
    ("", "run.h5", "complete"),
    ("pybullet.disconnect()", "run.h5", "complete"),
    ("1 / 0", "run.h5.partial", "failed"),
])  # fmt: skip
def test_a_script_that_forgets_to_close(tmp_path, recorded, end, name, status):
    pytest.importorskip("pybullet", reason="recording needs PyBullet")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(end=end)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONWARNINGS": "error"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ("ZeroDivisionError" in done.stderr) == (status == "failed")
    run = recorded(tmp_path / name, allow_incomplete=True)
    assert (run.status, run.n_frames) == (status, 11)
    assert [path.name for path in tmp_path.iterdir()] == [name]
