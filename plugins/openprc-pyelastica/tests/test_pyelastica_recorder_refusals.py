"""What the recorder refuses, and how it says so."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError, Diverged
from openprc.schema import Trajectory


def attach(recording, simulator, **options):
    with recording(simulator, **options):
        simulator.finalize()


def test_after_finalize(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    simulator.finalize()
    with pytest.raises(ConfigError, match=r"is finalized and takes no more callbacks") as caught:
        attach(recording, simulator)
    assert "to before simulator.finalize()" in caught.value.fix


def test_without_the_mixin(stub, recording):
    with pytest.raises(ConfigError, match="list has no callbacks") as caught:
        attach(recording, [stub.Rod(4)])
    assert "add CallBacks to its base classes" in caught.value.fix


@pytest.mark.parametrize(("systems", "found"), [((), "no systems"), (("Plane",), "Plane")])
def test_nothing_that_moves(stub, recording, systems, found):
    simulator = stub.Simulator(*(getattr(stub, name)() for name in systems))
    with pytest.raises(ConfigError, match=f"holds {found}: nothing that has moving nodes"):
        attach(recording, simulator)


def test_blocks_are_no_bodies(stub, recording):
    block = type("MemoryBlockCosseratRod", (stub.Rod,), {})(4)
    with pytest.raises(ConfigError, match="holds MemoryBlockCosseratRod: nothing"):
        attach(recording, stub.Simulator(block))


def test_systems_that_cannot_be_recorded(stub, recording):
    simulator = stub.Simulator(stub.Rod(4), stub.Plane())
    with pytest.raises(ConfigError, match="plane0 is a Plane, which has no moving nodes"):
        attach(recording, simulator, systems=[simulator[1]])
    with pytest.raises(ConfigError, match="rod0 is not among the systems of the simulator"):
        attach(recording, simulator, systems=stub.Rod(3))
    with pytest.raises(ConfigError, match="systems is empty"):
        attach(recording, simulator, systems=[])
    with pytest.raises(ConfigError, match="are not different once cleaned"):
        attach(recording, simulator, systems={"a b": simulator[0], "a.b": simulator[0]})


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"every": 0}, "every is 0"),
        ({"every": 2.5}, "every is 2.5"),
        ({"max_stretch": 1.0}, "max_stretch is 1.0"),
        ({"plane": "zx"}, "plane is 'zx'"),
        ({"signals": [1.0]}, "signals is a list"),
        ({"evrey": 2}, "there is no option 'evrey'"),
    ],
)
def test_options(stub, recording, options, match):
    with pytest.raises(ConfigError, match=match):
        attach(recording, stub.Simulator(stub.Rod(4)), **options)


def test_a_simulator_that_is_never_finalized(stub, recording):
    with (
        pytest.raises(ConfigError, match="the simulator was never finalized"),
        recording(stub.Simulator(stub.Rod(4))),
    ):
        pass


def test_time_that_runs_backwards(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with (  # noqa: PT012
        pytest.raises(ConfigError, match=r"rod0 is at t = 0.01.* s after t = 0.03.* s"),
        recording(simulator),
    ):
        simulator.finalize()
        simulator.run(3)
        simulator.fire(0.01)


def break_at(simulator, how):
    """Let a rod blow up at step 8, and go on for four steps."""
    simulator.run(7)
    rod = simulator[0]
    for step in range(8, 13):
        how(rod)
        simulator.fire(0.01 * step)


def not_a_number(rod):
    rod.velocity_collection[2, 1] = np.nan


def stretched(rod):
    rod.position_collection[2, -1] = 1.5


def fast(rod):
    # c = sqrt(300 N / (2 kg / 0.3 m)) = 6.7 m/s
    rod.velocity_collection[0, -1] = 100.0


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        (not_a_number, "numbers that are not finite"),
        (stretched, "an element 15 times its rest length"),
        (fast, "a node 11.2 times as fast as waves along the rod"),
    ],
)
def test_a_simulation_that_blows_up(stub, recording, how, reason):
    simulator = stub.Simulator(stub.Rod(4), stub.Sphere())
    with (  # noqa: PT012
        pytest.raises(Diverged, match=f"rod0 diverged by t = 0.08 s: {reason}") as caught,
        recording(simulator) as run,
    ):
        simulator.finalize()
        break_at(simulator, how)
    # The limits of the stub: l/c = 0.1 m / 6.7 m/s, R/c = 0.01 m / 3.9 m/s.
    assert "below 0.00258 s" in caught.value.fix
    assert "the 8 frames before are in the partial file" in caught.value.fix
    partial = run.path.with_name("recorded.h5.partial")
    with Trajectory(partial, allow_incomplete=True) as result:
        np.testing.assert_array_equal(result.time, 0.01 * np.arange(8))
    assert not run.path.exists()


def test_a_fast_flight_is_no_divergence(stub, recording):
    """Speed counts as seen from the rod."""
    simulator = stub.Simulator(stub.Rod(4))
    with recording(simulator) as run:
        simulator.finalize()
        simulator[0].velocity_collection[0] = 1e4
        simulator.fire(0.01)
    with Trajectory(run.path) as result:
        assert result.velocities()[1, 0, 0] == 1e4


def test_the_loop_stops_when_a_block_is_full(stub, recording, monkeypatch):
    monkeypatch.setattr("openprc_pyelastica.track.MOST_ROWS", 16)
    simulator = stub.Simulator(stub.Rod(4))
    with pytest.raises(Diverged, match="not finite"), recording(simulator):  # noqa: PT012
        simulator.finalize()
        simulator[0].velocity_collection[0, 0] = np.nan
        simulator.run(40)
    assert simulator.step_number == 16


def test_an_error_of_the_script_is_not_hidden(stub, recording):
    simulator = stub.Simulator(stub.Rod(4))
    with pytest.raises(KeyError, match="mine"), recording(simulator) as run:  # noqa: PT012
        simulator.finalize()
        simulator[0].velocity_collection[0, 0] = np.nan
        simulator.run(3)
        raise KeyError("mine")
    with Trajectory(run.path.with_name("recorded.h5.partial"), allow_incomplete=True) as result:
        assert result.n_frames == 1  # the one at t = 0 was sound
