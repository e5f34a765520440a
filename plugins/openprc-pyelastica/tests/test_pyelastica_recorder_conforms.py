"""The recorder passes the kit: a rod that falls freely keeps its shape."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.hooks import record_run
from openprc.testing import RecorderCase, parametrize_with_checks

N_ELEMENTS, LENGTH, DT, EVERY, N_STEPS, GRAVITY = 6, 0.3, 5e-4, 10, 60, 9.81


def begin(out):
    """Put a rod into a simulator, begin to record, and return what a loop needs."""
    elastica = pytest.importorskip("elastica", reason="recording needs PyElastica")

    class Simulator(elastica.BaseSystemCollection, elastica.Forcing, elastica.CallBacks):
        pass

    simulator = Simulator()
    rod = elastica.CosseratRod.straight_rod(
        N_ELEMENTS, np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), LENGTH,
        0.01, 1000.0, youngs_modulus=1e5, shear_modulus=3.3e4,
    )  # fmt: skip
    simulator.append(rod)
    simulator.add_forcing_to(rod).using(
        elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -GRAVITY])
    )
    recording = record_run(simulator, out, producer="pyelastica", every=EVERY)
    simulator.finalize()
    return recording, simulator, elastica.PositionVerlet()


def advance(simulator, stepper, count):
    """Take some steps."""
    time = 0.0
    for _ in range(count):
        time = stepper.step(simulator, time, DT)


def script(out):
    """Record the whole run and close it."""
    recording, simulator, stepper = begin(out)
    with recording:
        advance(simulator, stepper, N_STEPS)


def forget(out):
    """Record the whole run and leave."""
    _, simulator, stepper = begin(out)
    advance(simulator, stepper, N_STEPS)


def crash(out):
    """Fail in the middle of the loop."""
    recording, simulator, stepper = begin(out)
    with recording:
        advance(simulator, stepper, N_STEPS // 2)
        raise ZeroDivisionError("the script is wrong")


def truth():
    """Return ``x0 - g t^2 / 2``: position Verlet is exact for a constant force."""
    time = DT * EVERY * np.arange(N_STEPS // EVERY + 1)
    places = np.zeros((len(time), N_ELEMENTS + 1, 3))
    places[:, :, 0] = np.linspace(0.0, LENGTH, N_ELEMENTS + 1)
    places[:, :, 2] = -0.5 * GRAVITY * time[:, np.newaxis] ** 2
    return {"positions": places, "unit": "m", "time": time, "tolerance": 1e-9}


CASES = [
    RecorderCase(
        "pyelastica", script=script, forget=forget, crash=crash, truth=truth,
        # The simulator compiles for most of a minute where it has no cache yet.
        slow=("RECORD", "VALUE"),
    )
]  # fmt: skip


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
