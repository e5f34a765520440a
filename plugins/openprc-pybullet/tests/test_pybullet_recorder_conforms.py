"""The recorder passes the kit: a pushed ball, whose motion is known step by step."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.hooks import record_run
from openprc.testing import RecorderCase, parametrize_with_checks

DT, MASS, HOLD = 0.01, 0.5, 5
PUSHES = np.array([0.2, -0.4, 0.1, 0.6, -0.5, 0.3])
#: The push of every step [N].
STEPS = np.repeat(PUSHES, HOLD)


def begin(out):
    """Load the scene and begin to record it."""
    bullet = pytest.importorskip("pybullet", reason="recording needs PyBullet")
    client = bullet.connect(bullet.DIRECT)
    bullet.setTimeStep(DT, physicsClientId=client)
    bullet.setGravity(0, 0, -9.81, physicsClientId=client)
    ball = bullet.createMultiBody(MASS, basePosition=(1, 2, 3), physicsClientId=client)
    bullet.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    signals = {
        "push": {
            "value": "given", "unit": "N", "quantity": "force", "sequence": PUSHES,
            "hold": HOLD * DT,
        }
    }  # fmt: skip
    recording = record_run(client, out, producer="pybullet", signals=signals)

    def step(push):
        bullet.applyExternalForce(
            ball, -1, (push, 0, 0), (0, 0, 0), bullet.LINK_FRAME, physicsClientId=client
        )
        recording.session.step(push=push)

    return recording, step, lambda: bullet.disconnect(client)


def script(out):
    """Record the whole run and close it."""
    recording, step, end = begin(out)
    for push in STEPS:
        step(push)
    recording.close()
    end()


def forget(out):
    """Record the whole run and leave."""
    _, step, _ = begin(out)
    for push in STEPS:
        step(push)


def crash(out):
    """Fail in the middle of the loop."""
    recording, step, end = begin(out)
    try:
        with recording:
            for push in STEPS[:12]:
                step(push)
            raise ZeroDivisionError("the script is wrong")
    finally:
        end()


def truth():
    """Return the semi-implicit steps ``v += a dt; x += v dt`` of the ball."""
    force = np.zeros((len(STEPS), 3))
    force[:, 0], force[:, 2] = STEPS, -9.81 * MASS
    velocities = np.vstack([np.zeros(3), np.cumsum(force / MASS * DT, axis=0)])
    positions = np.array([1.0, 2.0, 3.0]) + np.cumsum(velocities * DT, axis=0)
    return {
        "positions": positions[:, np.newaxis],
        "velocities": velocities[:, np.newaxis],
        "unit": "m",
        "time": np.arange(len(STEPS) + 1) * DT,
        "inputs": {"push": np.append(STEPS, STEPS[-1])},
        "sequences": {"push": PUSHES},
        "channels": {"body0.omega": np.zeros((len(STEPS) + 1, 3))},
    }


CASES = [RecorderCase("pybullet", script=script, truth=truth, forget=forget, crash=crash)]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
