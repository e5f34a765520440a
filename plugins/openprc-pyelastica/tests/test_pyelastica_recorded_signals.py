"""What drives the body, as the recorder stores it."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.schema import Trajectory


def record(stub, recording, signals, *, every=1, steps=10):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator, signals=signals, every=every) as run:
        simulator.finalize()
        simulator.run(steps)
    return Trajectory(run.path)


def test_a_function_of_time(stub, recording):
    with record(stub, recording, {"u": np.sin}, every=2) as result:
        np.testing.assert_array_equal(result.input("u").value[:, 0], np.sin(result.time))


def test_an_array_with_a_row_for_each_step(stub, recording):
    rows = np.random.default_rng(1).normal(size=(11, 3))
    with record(stub, recording, {"push": rows}, every=5) as result:
        drive = result.input("push")
        np.testing.assert_array_equal(drive.value, rows[[0, 5, 10]])
        assert list(drive.columns) == ["x", "y", "z"]


def test_symbols_that_are_held(stub, recording):
    symbols = np.array([0.5, -1.0, 2.0])
    told = {
        "sequence": symbols,
        "hold": 0.03,
        "unit": "N",
        "quantity": "force",
        "targets": ["rod0:3"],
    }
    with record(stub, recording, {"u": told}) as result:
        drive = result.input("u")
        # Symbol k acts from k hold on; the last one stays.
        held = symbols[[0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2]]
        np.testing.assert_array_equal(drive.value[:, 0], held)
        np.testing.assert_array_equal(drive.sequence[:, 0], symbols)
        assert (drive.hold, drive.unit, drive.quantity) == (0.03, "N", "force")
        assert list(drive.targets) == ["rod0:3"]


@pytest.mark.parametrize(
    ("signal", "match"),
    [
        ({"unit": "N"}, "signal 'u': neither a value nor a sequence"),
        ({"value": np.sin, "colums": ["a"]}, r"signal 'u': unknown keys \['colums'\]"),
        ({"sequence": [1.0, 2.0]}, "a sequence without a hold above 0 s"),
        ({"sequence": [1.0], "hold": 1.0, "start": 0.5}, "a sequence that starts after t = 0"),
        ({"value": np.sin, "columns": ["a", "b"]}, "2 columns for 1 values"),
        (np.zeros((2, 2, 2)), r"an array of shape \(2, 2, 2\)"),
        ([1.0, np.nan], r"an array of shape \(2,\)"),
        (lambda t: 1.0 / (1.0 - t) if t < 1.0 else np.inf, None),
        (lambda t: np.inf, r"returned \[inf\] at t = 0 s"),
    ],
)
def test_what_is_no_signal(stub, recording, signal, match):
    if match is None:
        record(stub, recording, {"u": signal}).close()
        return
    with pytest.raises(ConfigError, match=match):
        record(stub, recording, {"u": signal})


def test_an_array_that_is_too_short(stub, recording):
    with pytest.raises(ConfigError, match=r"5 rows, and the simulation is at step 6, t = 0.06 s"):
        record(stub, recording, {"u": np.zeros(5)}, every=3)


class Push:
    """A forcing in the manner of PyElastica's: 2 N along x from step to step, at the tip."""

    def __init__(self, size):
        self.size = size

    def apply_forces(self, system, time=0.0):
        system.external_forces[0, -1] += self.size * (1.0 + time)


def test_a_forcing_that_is_watched(stub, recording):
    rod = stub.Rod(4)
    simulator = stub.Simulator(rod)
    with recording(simulator) as run:
        forcing = run.session.watch(Push, name="push", targets=("rod0:3",))(2.0)
        assert type(forcing).__name__ == "WatchedPush"
        simulator.finalize()
        for step in range(5):
            rod.external_forces[:] = 7.0  # weight and the like, which is not the push
            forcing.apply_forces(rod, time=0.01 * (step + 0.5))
            simulator.run(1)
    with Trajectory(run.path) as result:
        middle = 0.01 * np.array([0.5, 0.5, 1.5, 2.5, 3.5, 4.5])  # the first step's, twice
        np.testing.assert_allclose(
            result.input("push").value, np.outer(2.0 * (1.0 + middle), [1.0, 0.0, 0.0]), rtol=1e-14
        )
        assert result.input("push").unit == "N"


def test_watching_in_vain(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator, signals={"u": np.sin}) as run:
        with pytest.raises(ConfigError, match="two inputs are called 'u'"):
            run.session.watch(Push, name="u")
        simulator.finalize()
        with pytest.raises(ConfigError, match="the simulator is finalized"):
            run.session.watch(Push, name="push")
