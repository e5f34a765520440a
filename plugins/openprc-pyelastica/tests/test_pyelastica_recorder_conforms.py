"""The kit on the recorder: a free rod that flies straight on, which is exact."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from openprc.hooks import record_run
from openprc.testing import RecorderCase, parametrize_with_checks

STEP, STEPS, EVERY, HOLD = 1e-4, 40, 4, 1e-3
SYMBOLS = np.array([0.25, -0.5, 1.0, 2.0])
VELOCITY = np.array([0.3, -0.1, 0.2])


class Broken(Exception):
    """What goes wrong in the middle of a loop."""


def begin(out: Path):
    """Return a simulator, its recording, and its loop."""
    # The kit also asks about machines without PyElastica.
    import elastica as ea

    simulator = type("Simulator", (ea.BaseSystemCollection, ea.CallBacks), {})()
    rod = ea.CosseratRod.straight_rod(
        5,
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        np.array([0.0, 1.0, 0.0]),
        0.5,
        0.02,
        1000.0,
        youngs_modulus=1e6,
        shear_modulus=3e5,
    )
    rod.velocity_collection[:] = VELOCITY[:, np.newaxis]
    simulator.append(rod)
    recording = record_run(
        simulator,
        out,
        producer="pyelastica",
        every=EVERY,
        signals={"u": {"sequence": SYMBOLS, "hold": HOLD, "unit": "N", "quantity": "force"}},
    )

    def loop(fails_at=None):
        simulator.finalize()
        stepper, time = ea.PositionVerlet(), np.float64(0.0)
        for step in range(STEPS):
            if step == fails_at:
                raise Broken
            time = stepper.step(simulator, time, np.float64(STEP))

    return recording, loop


def script(out: Path):
    """Record and close."""
    recording, loop = begin(out)
    with recording:
        loop()


def forget(out: Path):
    """Record without closing."""
    _, loop = begin(out)
    loop()


def crash(out: Path):
    """Fail in the loop."""
    recording, loop = begin(out)
    with recording:
        loop(fails_at=25)


def truth():
    """Return the motion in closed form."""
    time = STEP * EVERY * np.arange(STEPS // EVERY + 1)
    rest = np.zeros((6, 3))
    rest[:, 2] = 0.1 * np.arange(6)
    symbol = np.minimum(np.floor(time / HOLD + 1e-9).astype(int), len(SYMBOLS) - 1)
    return {
        "time": time,
        "positions": rest + time[:, np.newaxis, np.newaxis] * VELOCITY,
        "velocities": np.broadcast_to(VELOCITY, (len(time), 6, 3)),
        "inputs": {"u": SYMBOLS[symbol]},
        "sequences": {"u": SYMBOLS},
        "elements": {("bars", "length"): np.full((len(time), 5), 0.1)},
    }


CASES = [
    RecorderCase(
        "pyelastica",
        script=script,
        truth=truth,
        forget=forget,
        crash=crash,
        # The simulator compiles for most of a minute where its cache cannot be written.
        slow=("RECORD", "VALUE", "REPEAT", "PIPE"),
    )
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
